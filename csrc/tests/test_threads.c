/* test_threads.c - a coupler with a team: bitwise what it is alone, whatever happens. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <time.h>

#include "check.h"
#include "couple/coupler.h"
#include "couple/inside.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

enum { MOST_THREADS = 4, PLANS = 25, EXCHANGED = 64 };

/* ---- a process that exchanges with itself ---------------------------------------------------- */

static bool gather_alone(void *ctx, double *all, const int *counts, const int *starts)
{
    (void)ctx, (void)all, (void)counts, (void)starts;
    return true;
}

/* The same model in several processes, of which there is one. */
static void make_exchanging_chain(model *m, plan chosen, size_t threads)
{
    static const int64_t first[2] = {0, SUBDOMAINS};
    static double all[EXCHANGED];
    static int count, start;
    const pma_exchange_parts exchange = {.ranks = 1,
                                         .first = first,
                                         .all = all,
                                         .counts = &count,
                                         .starts = &start,
                                         .gather = gather_alone};
    make_threaded_chain(m, chosen, threads);
    pma_coupler_destroy(m->coupler);
    pma_coupler_parts parts = describe_coupler(m);
    parts.exchange = &exchange;
    CHECK(pma_exchange_size(1, SUBDOMAINS, m->members) <= EXCHANGED);
    CHECK_STATUS(pma_coupler_create(&parts, &m->coupler), PMA_OK);
    start_model(m);
}

typedef void (*maker)(model *m, plan chosen, size_t threads);
static const maker MAKERS[2] = {make_threaded_chain, make_exchanging_chain};

static plan random_plan(uint64_t *seed)
{
    static const size_t divisors[4] = {1, 2, 3, 6};
    plan chosen = {.A_doubled = draw(seed, 2),
                   .C_doubled = draw(seed, 2),
                   .rebased = draw(seed, 2),
                   .moved = draw(seed, 2)};
    for (size_t i = 0; i < SUBDOMAINS; i++)
        chosen.substeps[i] = divisors[draw(seed, 4)];
    chosen.substeps[1] = 6; /* B is at the finest step and single */
    return chosen;
}

static void a_run_is_bitwise_identical_for_any_number_of_threads(void)
{
    static model m;
    static tape expected, actual;
    uint64_t seed = 11;
    for (size_t k = 0; k < PLANS; k++) {
        const plan chosen = random_plan(&seed);
        for (size_t i = 0; i <= MOST_THREADS; i++) { /* of one thread both, then either in turn */
            const size_t threads = i == 0 ? 1 : i;
            tape *t = i == 0 ? &expected : &actual;
            MAKERS[i < 2 ? i : (i + k) % 2](&m, chosen, threads);
            CHECK_INT(pma_coupler_threads(m.coupler), threads < SUBDOMAINS ? threads : SUBDOMAINS);
            make_tape(t, &m, 0, 0);
            run_taped(&m, t, STEPS);
            destroy_model(&m);
            if (i > 0)
                check_tape(&actual, &expected);
        }
    }
}

static void step_by_step_and_not_recorded_it_is_bitwise_identical_too(void)
{
    static model m, n;
    uint64_t seed = 12;
    for (size_t k = 0; k < PLANS; k++) {
        const plan chosen = random_plan(&seed);
        make_chain(&m, chosen, 1.0);
        make_threaded_chain(&n, chosen, 2 + k % 3);
        for (int64_t step = 0; step < STEPS; step += 2) {
            CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_OK);
            for (int64_t i = 0; i < 2; i++)
                CHECK_STATUS(pma_coupler_advance(n.coupler, 1, NULL, NULL), PMA_OK);
            check_same(&n, &m);
        }
        destroy_model(&m);
        destroy_model(&n);
    }
}

/* Stopped in every fine step, and on to the end. */
static void a_stopped_run_goes_on_as_if_never_stopped(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    destroy_model(&m);
    for (size_t stop_at = 1; stop_at <= 5 * FINE; stop_at++) {
        stopper a = {0, stop_at};
        const pma_poll poll = {poll_stopper, &a, 0};
        make_threaded_chain(&m, MIXED, 2 + stop_at % 3);
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_STOPPED);
        const int64_t done = pma_coupler_step_count(m.coupler);
        CHECK(done <= (int64_t)(stop_at - 1) / FINE); /* a long wait polls as well */
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - done, NULL, &poll), PMA_OK);
        check_same_present(&m, &expected);
        destroy_model(&m);
    }
}

static void a_value_that_is_not_finite_is_named_and_the_run_can_go_on(void)
{
    static const size_t places[4][2] = {{0, 2}, {0, 0}, {1, 0}, {2, 0}}; /* subdomain, dof */
    static model m, n;
    for (size_t threads = 2; threads <= MOST_THREADS; threads++) {
        for (size_t k = 0; k < 32; k++) {
            make_chain(&n, MIXED, 1.0);
            MAKERS[k % 2](&m, MIXED, threads);
            check_infinite_load(&m, places[k / 2 % 4][0], places[k / 2 % 4][1], (int64_t)(k / 8),
                                &n);
        }
    }
}

/* ---- of several values that are not finite, the one that one thread would have met first ---- */

enum { COARSE = 2, SPAN = 6 }; /* substeps of A, macro steps */

/* A double, B with three times its substeps; each has a small mass that nothing touches, with
 * a load in one substep under which it overflows: that is seen when the step is closed and not
 * before. */
static const double SMALL = 1e-3;

static void fill_isolated(model *m, size_t threads, bool A_first, size_t A_step, size_t B_step)
{
    *m = (model){.count = 2, .p = 1, .dt = 0.3, .rebased = true, .threads = threads};
    subdomain *A = &m->subdomains[A_first ? 0 : 1], *B = &m->subdomains[A_first ? 1 : 0];
    *A = (subdomain){.n = 2,
                     .nb = 1,
                     .p = 1,
                     .substeps = COARSE,
                     .implicit = true,
                     .doubled = true,
                     .scheme = generalized_alpha(0.5),
                     .M = {SMALL, 0, 0, 1},
                     .K = {SMALL, 0, 0, 2},
                     .L = {0, 1},
                     .u0 = {0.5, 1.0}};
    *B = (subdomain){.n = 2,
                     .nb = 1,
                     .p = 1,
                     .substeps = 3 * COARSE,
                     .scheme = generalized_alpha(0.5),
                     .M = {SMALL, 0, 0, 1},
                     .K = {SMALL, 0, 0, 2},
                     .L = {0, -1},
                     .u0 = {0.5, 1.0}};
    A->loads[2 * A_step] = B->loads[2 * B_step] = 1e308;
    for (size_t i = 0; i < m->count; i++)
        m->subdomains[i].load =
            (pma_load){.kind = PMA_LOAD_TABLE, .values = m->subdomains[i].loads, .rows = LEVELS};
}

static void check_isolated(bool A_first, size_t A_step, size_t B_step)
{
    static model m, n;
    fill_isolated(&m, 1, A_first, A_step, B_step);
    fill_isolated(&n, 2, A_first, A_step, B_step);
    make_model(&m);
    make_model(&n);
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, NULL), PMA_NOT_FINITE);
    CHECK_STATUS(pma_coupler_advance(n.coupler, SPAN, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(n.coupler), pma_coupler_failed(m.coupler));
    CHECK_INT(pma_coupler_step_count(n.coupler), pma_coupler_step_count(m.coupler));
    const snapshot expected = present(&m);
    check_same_present(&n, &expected);
    for (size_t i = 0; i < expected.count; i++)
        CHECK(isfinite(expected.values[i]));
    destroy_model(&m);
    destroy_model(&n);
}

static void of_several_failures_the_first_is_named_as_by_one_thread(void)
{
    for (size_t A_step = 0; A_step < SPAN * COARSE; A_step++) {
        for (size_t B_step = 0; B_step < SPAN * COARSE * 3; B_step++) {
            check_isolated(true, A_step, B_step);
            check_isolated(false, A_step, B_step);
        }
    }
}

/* ---- what was opened ahead ------------------------------------------------------------------ */

static size_t most_opened(const model *m)
{
    size_t most = 0;
    for (size_t i = 0; i < m->count; i++) {
        const size_t opened = m->members[i].table->opened(m->members[i].self);
        most = opened > most ? opened : most;
    }
    return most;
}

/* The same loads, doubled, for the rest of a run. */
static void double_load(model *m, size_t i)
{
    subdomain *x = &m->subdomains[i];
    for (size_t k = 0; k < LEVELS * MOST; k++)
        x->loads[k] *= 2.0;
    pma_subdomain_set_load(x->core, *pma_subdomain_load(x->core));
    CHECK_INT(m->members[i].table->opened(m->members[i].self), 0);
}

static void a_substep_opened_ahead_under_another_load_is_opened_again(void)
{
    static model m, n;
    for (int64_t after = 2; after <= 4; after++) {
        make_threaded_chain(&m, MIXED, 2);
        make_chain(&n, MIXED, 1.0);
        CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
        CHECK_STATUS(pma_coupler_advance(n.coupler, after, NULL, NULL), PMA_OK);
        CHECK(most_opened(&m) > 0 && most_opened(&n) == 0); /* or this shows nothing */
        for (size_t i = 0; i < m.count; i++) {
            double_load(&m, i);
            double_load(&n, i);
        }
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
        CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS - after, NULL, NULL), PMA_OK);
        check_same(&m, &n);
        destroy_model(&m);
        destroy_model(&n);
    }
}

static void a_substep_opened_ahead_is_forgotten_at_a_second_start(void)
{
    static model m, n;
    make_chain(&n, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&n);
    for (int64_t after = 2; after <= 4; after++) {
        make_threaded_chain(&m, MIXED, 2);
        CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
        CHECK(most_opened(&m) > 0);
        start_model(&m);
        CHECK_INT(most_opened(&m), 0);
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
        check_same_present(&m, &expected);
        destroy_model(&m);
    }
    destroy_model(&n);
}

/* f = t, and the number of evaluations */
static int count_force(double t, intptr_t n, double *f, void *user)
{
    for (intptr_t i = 0; i < n; i++)
        f[i] = t;
    ++*(size_t *)user;
    return 0;
}

/* A function is evaluated in turn, for the substeps of the macro steps that are taken alone. */
static void a_load_that_is_called_is_not_evaluated_ahead(void)
{
    static model m, n;
    const int64_t order[MOST] = {0, 1, 2};
    double work[2][MOST];
    size_t evaluated[2] = {0, 0};
    make_threaded_chain(&m, MIXED, 2);
    make_chain(&n, MIXED, 1.0);
    pma_load load = {.kind = PMA_LOAD_CALLED,
                     .n = m.subdomains[0].n,
                     .function = count_force,
                     .user = &evaluated[0],
                     .order = order,
                     .work = work[0]};
    pma_subdomain_set_load(m.subdomains[0].core, load);
    load.user = &evaluated[1];
    load.work = work[1];
    pma_subdomain_set_load(n.subdomains[0].core, load);
    for (size_t step = 1; step <= STEPS; step++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        CHECK_INT(evaluated[0], step * m.subdomains[0].substeps);
    }
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
    CHECK_INT(evaluated[1], STEPS * m.subdomains[0].substeps);
    check_same(&m, &n);
    destroy_model(&m);
    destroy_model(&n);
}

/* A table that ends with the run is not read beyond, which the core asserts. */
static void a_table_is_not_read_ahead_of_its_end(void)
{
    static model m, n;
    make_threaded_chain(&m, MIXED, 2);
    make_chain(&n, MIXED, 1.0);
    for (size_t i = 0; i < m.count; i++) {
        const pma_load table = {.kind = PMA_LOAD_TABLE,
                                .n = m.subdomains[i].n,
                                .values = m.subdomains[1].loads,
                                .rows = STEPS * m.subdomains[i].substeps};
        pma_subdomain_set_load(m.subdomains[i].core, table);
        pma_subdomain_set_load(n.subdomains[i].core, table);
    }
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same(&m, &n);
    destroy_model(&m);
    destroy_model(&n);
}

/* A closing that fails beside the fine steps ends its macro step before the forces of the next one
 * are evaluated: these are evaluated once for every substep of the macro steps that count. B has
 * such a force; A has none, and overflows at its last substep of macro step `macro`. */
static void check_evaluations(size_t macro, size_t threads)
{
    static model m;
    const size_t failing = COARSE * macro + COARSE - 1;
    fill_isolated(&m, threads, true, failing, 0);
    m.subdomains[1].restored = true;
    m.subdomains[1].M[0] = 1.0; /* nothing of B overflows */
    m.subdomains[1].loads[0] = 0.0;
    make_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), 0);
    CHECK_INT(pma_coupler_step_count(m.coupler), macro);
    CHECK_INT(m.subdomains[1].pulled.evaluated, (macro + 1) * 3 * COARSE);

    /* and on, with one macro step that was given up */
    m.subdomains[0].loads[2 * failing] = 0.0;
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN - (int64_t)macro, NULL, NULL), PMA_OK);
    CHECK_INT(m.subdomains[1].pulled.evaluated, (SPAN + 1) * 3 * COARSE);
    destroy_model(&m);
}

static void forces_are_not_evaluated_beyond_a_macro_step_that_may_still_fail(void)
{
    for (size_t macro = 0; macro + 1 < SPAN; macro++) {
        check_evaluations(macro, 1);
        check_evaluations(macro, 2);
    }
}

/* ---- polls of a caller that waits ----------------------------------------------------------- */

/* A poll that a worker can see, and what an opening waits for: a number of calls of it. */
typedef struct {
    atomic_size_t polled, awaited;
    bool stops;
} meeting;

static meeting met;

static bool poll_meeting(void *ctx)
{
    (void)ctx;
    atomic_fetch_add(&met.polled, 1);
    return met.stops;
}

static pma_member_table naively;

static void pause(void)
{
    nanosleep(&(struct timespec){0, 1000000}, NULL);
}

/* Until the caller, which waits for this, has polled again; a minute at most, after which the test
 * finds too few polls. */
static pma_status open_when_polled(void *self, const pma_substep *closed, const pma_substep *opened,
                                   const double *lam, const pma_workers *workers)
{
    if (!opened)
        return naively.advance(self, closed, opened, lam, workers);
    for (int i = 0; i < 60000 && atomic_load(&met.polled) < atomic_load(&met.awaited); i++)
        pause();
    if (!met.stops && atomic_load(&met.awaited) > 0)
        atomic_fetch_add(&met.awaited, 1);
    for (int i = 0; i < 50 && met.stops && atomic_load(&met.awaited) > 0; i++)
        pause(); /* long enough for a second poll, were there one */
    return naively.advance(self, closed, opened, lam, workers);
}

/* An oscillator cut in two naive members; the second is worker 1's, whose opening waits. */
static void make_waiting(model *m, bool macro)
{
    *m =
        (model){.count = 2, .p = 1, .dt = 0.1, .threads = 2, .macro = macro, .naive = {true, true}};
    m->subdomains[0] = one_mass(M_A, K_A, 1.0, TRAPEZOIDAL, true);
    m->subdomains[1] = one_mass(M_B, K_B, -1.0, TRAPEZOIDAL, true);
    m->subdomains[0].u0[0] = m->subdomains[1].u0[0] = 1.0;
    make_model(m);
    CHECK_INT(m->coupler->coupled[0].worker, 0);
    CHECK_INT(m->coupler->coupled[1].worker, 1);
    naively = m->wrapped[1].table;
    m->wrapped[1].table.advance = open_when_polled;
}

static void check_run(model *m, int64_t steps)
{
    naive_run(m, (size_t)steps);
    CHECK_INT(pma_coupler_step_count(m->coupler), steps);
    CHECK_NEAR(m->wrapped[1].levels[steps].u[0], m->levels[1][steps].u[0], AGREE);
    CHECK_NEAR(pma_coupler_multipliers(m->coupler)[0], m->lam[steps][0], AGREE);
}

/* Never called for what the caller reads itself: only while it waits. Every opening of the second
 * member waits for one more call. */
static void a_caller_that_waits_for_a_worker_polls(void)
{
    static model m;
    const pma_poll poll = {poll_meeting, NULL, SIZE_MAX};
    for (int macro = 0; macro <= 1; macro++) {
        make_waiting(&m, macro);
        met = (meeting){.polled = 0, .awaited = 1};
        CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, &poll), PMA_OK);
        CHECK(atomic_load(&met.awaited) == 3 && atomic_load(&met.polled) >= 2);
        atomic_store(&met.awaited, 0);
        check_run(&m, 2);
        destroy_model(&m);
    }
}

/* With fine steps what is waited for is finished; in macro coupling the macro step is given up. */
static void a_caller_that_waits_can_be_stopped(void)
{
    static model m;
    const pma_poll poll = {poll_meeting, NULL, SIZE_MAX};
    for (int macro = 0; macro <= 1; macro++) {
        for (int64_t steps = 1; steps <= 2; steps++) {
            make_waiting(&m, macro);
            met = (meeting){.polled = 0, .awaited = 1, .stops = true};
            CHECK_STATUS(pma_coupler_advance(m.coupler, steps, NULL, &poll), PMA_STOPPED);
            const int64_t done = pma_coupler_step_count(m.coupler);
            CHECK_INT(atomic_load(&met.polled), 1); /* not again: what it raised is pending */
            CHECK_INT(done, !macro);
            atomic_store(&met.awaited, 0);
            CHECK_STATUS(pma_coupler_advance(m.coupler, 2 - done, NULL, NULL), PMA_OK);
            check_run(&m, 2);
            destroy_model(&m);
        }
    }
}

/* ---- all of them ---------------------------------------------------------------------------- */

const test THREADS_TESTS[] = {
    TEST(a_run_is_bitwise_identical_for_any_number_of_threads),
    TEST(step_by_step_and_not_recorded_it_is_bitwise_identical_too),
    TEST(a_stopped_run_goes_on_as_if_never_stopped),
    TEST(of_several_failures_the_first_is_named_as_by_one_thread),
    TEST(a_value_that_is_not_finite_is_named_and_the_run_can_go_on),
    TEST(a_substep_opened_ahead_under_another_load_is_opened_again),
    TEST(a_substep_opened_ahead_is_forgotten_at_a_second_start),
    TEST(a_load_that_is_called_is_not_evaluated_ahead),
    TEST(a_table_is_not_read_ahead_of_its_end),
    TEST(forces_are_not_evaluated_beyond_a_macro_step_that_may_still_fail),
    TEST(a_caller_that_waits_for_a_worker_polls),
    TEST(a_caller_that_waits_can_be_stopped),
    END_OF_TESTS,
};
