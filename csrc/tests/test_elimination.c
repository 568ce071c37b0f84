/* test_elimination.c - a factor in panels made by several workers is bitwise that of one. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "factor/elimination.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"
#include "workers/team.h"
#include "workers/thread.h"

enum { WORKERS = 4 };

/* A problem, of whose R, Q and inverses there are room for one after the other. */
typedef struct {
    structure m;
    pma_panels_input input;
    double values[2 * UNKNOWNS * UNKNOWNS], inverse[UNKNOWNS];
} problem;

typedef struct {
    pma_status status;
    size_t column;
    double values[2 * UNKNOWNS * UNKNOWNS], inverse[UNKNOWNS];
} result;

/* ---- problems ------------------------------------------------------------------------------- */

/* The entries of m->A with ascending rows; `unsymmetric`: with half of what is above the
 * diagonal. */
static void prepare(problem *q, bool unsymmetric)
{
    structure *m = &q->m;
    int64_t k = 0;
    analyse(m);
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = 0; j < m->n; j++) {
            if (m->A[i * m->n + j] == 0.0)
                continue;
            m->index[k] = (int32_t)j;
            m->entries[k++] = m->A[i * m->n + j] * (unsymmetric && j > i ? 0.5 : 1.0);
        }
        m->ptr[i + 1] = k;
    }
    m->panels.values = q->values;
    m->panels.Q = unsymmetric ? (size_t)m->panels.start[m->panels.count] : 0;
    q->input = (pma_panels_input){.n = m->n,
                                  .ptr = m->ptr,
                                  .index = m->index,
                                  .values = m->entries,
                                  .lost = 1e-12,
                                  .growth = 1e8};
}

/* Trees side by side: blocks of `block` unknowns, each a chain; of one unknown each: a diagonal. */
static void draw_forest(structure *m, size_t n, size_t block)
{
    *m = (structure){.n = n};
    for (size_t i = 0; i < n; i++) {
        m->A[i * n + i] = 4.0 + (double)i / 16.0;
        if (i % block > 0)
            m->A[i * n + i - 1] = m->A[(i - 1) * n + i] = -1.0 - (double)i / 32.0;
    }
}

/* ---- workers -------------------------------------------------------------------------------- */

static void work(void *ctx, size_t worker)
{
    pma_elimination_work(ctx, worker);
}

/* Begun for `workers`, of which `present` come. */
static void make(problem *q, size_t workers, size_t present, const pma_patience *patience,
                 result *out)
{
    pma_elimination *e;
    pma_team *t;
    const pma_panels *p = &q->m.panels;
    CHECK_STATUS(pma_elimination_create(p, q->m.n, q->m.owner, &NAIVE_BLAS, workers, &e), PMA_OK);
    CHECK_STATUS(pma_team_create(present, &t), PMA_OK);
    CHECK_STATUS(pma_team_gather(t), PMA_OK);
    pma_elimination_begin(e, &q->input, q->inverse, patience);
    for (size_t w = 1; w < present; w++)
        pma_team_post(t, w, work, e);
    pma_elimination_work(e, 0);
    for (size_t w = 1; w < present; w++)
        pma_team_await(t, w, NULL, NULL);
    *out = (result){.column = SIZE_MAX};
    out->status = pma_elimination_end(e, &out->column);
    memcpy(out->values, q->values, sizeof q->values);
    memcpy(out->inverse, q->inverse, sizeof q->inverse);
    pma_team_destroy(t);
    pma_elimination_destroy(e);
}

static void check_alike(problem *q)
{
    static result one, other;
    const pma_panels *p = &q->m.panels;
    const size_t size = (size_t)p->start[p->count] * (p->Q > 0 ? 2 : 1);
    const pma_patience resting = {.stop = NEVER.stop, .rest = pma_thread_rest};
    make(q, 1, 1, &NEVER, &one);
    for (size_t workers = 2; workers <= WORKERS; workers++) {
        memset(q->values, 0xff, sizeof q->values);
        make(q, workers, workers == 3 ? 1 : workers, workers == 4 ? &NEVER : &resting, &other);
        CHECK_STATUS(other.status, one.status);
        CHECK_INT(other.column, one.column);
        if (one.status != PMA_OK)
            continue;
        CHECK_BITS(size, other.values, one.values);
        CHECK_BITS(q->m.n, other.inverse, one.inverse);
    }
}

static void check_both_kinds(problem *q)
{
    prepare(q, false);
    check_alike(q);
    q->input.indefinite = true;
    for (int64_t k = q->m.ptr[q->m.n] / 2; k < q->m.ptr[q->m.n]; k++)
        q->m.entries[k] *= -1.0; /* of a row those from the diagonal on are read */
    check_alike(q);
    prepare(q, true);
    check_alike(q);
}

static void a_factor_is_bitwise_the_same_for_any_number_of_workers(void)
{
    static problem q;
    uint64_t seed = 71;
    draw_grid(&q.m);
    check_both_kinds(&q);
    for (uint32_t one_in = 1; one_in <= 64; one_in *= 2) {
        draw_definite(&q.m, UNKNOWNS, draw(&seed, 8), one_in, &seed);
        check_both_kinds(&q);
    }
    for (size_t n = 0; n <= 24; n += 3) {
        draw_definite(&q.m, n, draw(&seed, (uint32_t)n + 1), 1 + draw(&seed, 9), &seed);
        check_both_kinds(&q);
    }
    for (size_t block = 1; block <= UNKNOWNS; block *= 2) {
        draw_forest(&q.m, UNKNOWNS, block);
        check_both_kinds(&q);
    }
    draw_forest(&q.m, 1, 1);
    check_both_kinds(&q);
}

/* ---- what goes wrong ------------------------------------------------------------------------ */

/* Several pivots fail: the first of them is named, whoever comes to it, and whenever. */
static void the_first_column_that_fails_is_named_by_any_number_of_workers(void)
{
    static problem q;
    static result one;
    uint64_t seed = 72;
    for (size_t block = 1; block <= UNKNOWNS; block *= 4) {
        for (size_t round = 0; round < 20; round++) {
            size_t first = UNKNOWNS;
            draw_forest(&q.m, UNKNOWNS, block);
            prepare(&q, round % 2);
            for (size_t k = 0; k < 3; k++) {
                const size_t bad = draw(&seed, UNKNOWNS);
                first = bad < first ? bad : first;
                for (int64_t i = q.m.ptr[bad]; i < q.m.ptr[bad + 1]; i++) {
                    if (q.m.index[i] == (int32_t)bad)
                        q.m.entries[i] = (double)NAN;
                }
            }
            make(&q, 1, 1, &NEVER, &one);
            CHECK_STATUS(one.status, PMA_NOT_DEFINITE);
            CHECK_INT(one.column, first);
            check_alike(&q);
        }
    }
}

/* An entry that no panel has, and no entry across from one. */
static void an_entry_outside_the_pattern_is_refused_by_any_number_of_workers(void)
{
    static problem q;
    static result one;
    draw_forest(&q.m, UNKNOWNS, 8);
    prepare(&q, true);
    const int64_t last = q.m.ptr[5] - 1; /* of row 4, right of the diagonal */
    q.m.index[last] = UNKNOWNS - 1;
    make(&q, 1, 1, &NEVER, &one);
    CHECK_STATUS(one.status, PMA_BAD_INDEX);
    check_alike(&q);
}

static void several_workers_can_be_stopped_and_begin_again(void)
{
    static problem q;
    static result first, again;
    draw_grid(&q.m);
    prepare(&q, false);
    make(&q, 1, 1, &NEVER, &first);
    for (size_t stop_at = 1; stop_at <= 3; stop_at++) {
        for (size_t workers = 1; workers <= WORKERS; workers++) {
            stopper a = {0, stop_at};
            const pma_patience patience = {.stop = poll_stopper, .ctx = &a};
            make(&q, workers, 1, &patience, &again);
            CHECK_STATUS(again.status, PMA_STOPPED);
            CHECK_INT(a.polled, stop_at);
            a = (stopper){0, stop_at};
            make(&q, workers, workers, &patience, &again); /* the others may do it all */
            CHECK(again.status == PMA_OK || again.status == PMA_STOPPED);
            make(&q, workers, workers, &NEVER, &again);
            CHECK_STATUS(again.status, PMA_OK);
            CHECK_BITS(UNKNOWNS, again.inverse, first.inverse);
        }
    }
}

const test ELIMINATION_TESTS[] = {
    TEST(a_factor_is_bitwise_the_same_for_any_number_of_workers),
    TEST(the_first_column_that_fails_is_named_by_any_number_of_workers),
    TEST(an_entry_outside_the_pattern_is_refused_by_any_number_of_workers),
    TEST(several_workers_can_be_stopped_and_begin_again),
    END_OF_TESTS,
};
