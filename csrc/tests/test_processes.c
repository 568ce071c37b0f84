/* test_processes.c - a coupler in several processes does what it does in one: here in two threads,
 * each with a coupler of its own that has the members of the other as remote ones. */
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "models.h"
#include "subdomain/remote.h"
#include "tests.h"
#include "workers/thread.h"

enum { RANKS = 2, NUMBERS = 1024 };

/* Where all ranks meet, twice in a round: when their numbers are there, and when they are read. */
typedef struct {
    atomic_uint arrived, met;
    double all[NUMBERS];
} meeting;

typedef struct {
    size_t rank;
    int64_t first[RANKS + 1];
    meeting *place;
    model m;
    tape t;
    pma_remote *remotes[SUBDOMAINS];
    double all[NUMBERS];
    int counts[RANKS], starts[RANKS];
    pma_exchange_parts exchange;
    pma_status status;
} process;

static void meet(meeting *place)
{
    const unsigned met = atomic_load(&place->met);
    if (atomic_fetch_add(&place->arrived, 1) + 1 == RANKS) {
        atomic_store(&place->arrived, 0);
        atomic_fetch_add(&place->met, 1);
    }
    while (atomic_load(&place->met) == met)
        pma_thread_yield();
}

static bool gather(void *ctx, double *all, const int *counts, const int *starts)
{
    const process *q = ctx;
    const size_t own = q->rank;
    memcpy(q->place->all + starts[own], all + starts[own], (size_t)counts[own] * sizeof *all);
    meet(q->place);
    for (size_t r = 0; r < RANKS; r++)
        memcpy(all + starts[r], q->place->all + starts[r], (size_t)counts[r] * sizeof *all);
    meet(q->place);
    return true;
}

static bool is_own(const process *q, size_t i)
{
    return (int64_t)i >= q->first[q->rank] && (int64_t)i < q->first[q->rank + 1];
}

/* The model, coupled anew with the members of the others as remote ones. */
static void make_process(process *q, const chain *chosen, meeting *place, size_t rank)
{
    *q = (process){.rank = rank, .first = {0, 1, SUBDOMAINS}, .place = place};
    build_chain(&q->m, chosen);
    for (size_t i = 0; i < SUBDOMAINS; i++) {
        subdomain *x = &q->m.subdomains[i];
        const pma_remote_parts parts = {.link = pma_subdomain_parts(x->core)->link,
                                        .substeps = x->substeps,
                                        .h = x->h,
                                        .doubled = x->doubled};
        if (is_own(q, i))
            continue;
        CHECK_STATUS(pma_remote_create(&parts, &q->remotes[i]), PMA_OK);
        q->m.members[i] = pma_remote_member(q->remotes[i]);
    }
    pma_coupler_destroy(q->m.coupler);
    pma_coupler_parts parts = describe_coupler(&q->m);
    q->exchange = (pma_exchange_parts){.ranks = RANKS,
                                       .rank = rank,
                                       .first = q->first,
                                       .all = q->all,
                                       .counts = q->counts,
                                       .starts = q->starts,
                                       .gather = gather,
                                       .ctx = q};
    CHECK(pma_exchange_size(RANKS, SUBDOMAINS, q->m.members) <= NUMBERS);
    parts.exchange = &q->exchange;
    CHECK_STATUS(pma_coupler_create(&parts, &q->m.coupler), PMA_OK);
    start_model(&q->m);
    make_tape(&q->t, &q->m, 0, 0);
    for (size_t i = 0; i < SUBDOMAINS; i++)
        q->t.selections[i].count = is_own(q, i) ? q->t.selections[i].count : 0;
}

static void destroy_process(process *q)
{
    destroy_model(&q->m);
    for (size_t i = 0; i < SUBDOMAINS; i++)
        pma_remote_destroy(q->remotes[i]);
}

static void run_process(void *ctx)
{
    process *q = ctx;
    q->status = pma_coupler_meet(q->m.coupler, PMA_OK);
    if (q->status != PMA_OK)
        return;
    pma_coupler_record_present(q->m.coupler, &q->t.record);
    q->status = pma_coupler_advance(q->m.coupler, STEPS, &q->t.record, NULL);
}

static void check_process(const process *q, const model *m, const tape *expected)
{
    CHECK_STATUS(q->status, PMA_OK);
    CHECK_BITS(LEVELS * CONSTRAINTS, q->t.lam, expected->lam);
    CHECK_BITS(LEVELS * CONSTRAINTS, q->t.velocity, expected->velocity);
    CHECK_BITS(LEVELS * CONSTRAINTS, q->t.displacement, expected->displacement);
    for (size_t i = 0; i < m->count; i++) {
        if (!is_own(q, i))
            continue;
        CHECK_BITS(LEVELS * MOST, q->t.u[i], expected->u[i]);
        CHECK_BITS(LEVELS * MOST, q->t.v[i], expected->v[i]);
        CHECK_BITS(LEVELS * MOST, q->t.w[i], expected->w[i]);
    }
}

/* In one process, which the naive program checks, and in two. */
static void check(chain chosen)
{
    static model m;
    static tape t;
    static meeting place;
    static process ranks[RANKS];
    pma_thread thread;
    build_chain(&m, &chosen);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    for (size_t r = 0; r < RANKS; r++)
        make_process(&ranks[r], &chosen, &place, r);
    CHECK(pma_thread_start(&thread, run_process, &ranks[1]));
    run_process(&ranks[0]);
    pma_thread_join(&thread);
    for (size_t r = 0; r < RANKS; r++) {
        check_process(&ranks[r], &m, &t);
        destroy_process(&ranks[r]);
    }
    destroy_model(&m);
}

static void fine_steps_in_two_processes_are_those_of_one(void)
{
    check((chain){.plan = {{1, 6, 2}, false, false, true, false, false}});
    check((chain){.plan = {{1, 4, 2}, true, false, true, false, true}});
    check((chain){.plan = MIXED});
}

static void macro_steps_in_two_processes_are_those_of_one(void)
{
    check((chain){.plan = {{1, 3, 7}, true, false, true, true, false}, .macro = true});
    check((chain){.plan = {{1, 3, 5}, false, false, true, true, false}, .mean = true});
    check((chain){
        .plan = {{1, 4, 1}, true, false, true, true, false}, .mean = true, .undamped = true});
}

const test PROCESSES_TESTS[] = {
    TEST(fine_steps_in_two_processes_are_those_of_one),
    TEST(macro_steps_in_two_processes_are_those_of_one),
    END_OF_TESTS,
};
