/* test_threads.c - a coupler with a team: the same bits as alone, whatever happens. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "coupling/coupler.h"
#include "member/subdomain.h"
#include "models.h"
#include "naive.h"
#include "tests.h"

enum { MOST_THREADS = 4, PLANS = 40 };

static plan random_plan(uint64_t *seed)
{
    static const size_t divisors[4] = {1, 2, 3, 6};
    plan chosen = {.A_doubled = draw(seed, 2), .C_doubled = draw(seed, 2),
                   .rebased = draw(seed, 2), .moved = draw(seed, 2)};
    for (size_t i = 0; i < PARTS; i++)
        chosen.substeps[i] = divisors[draw(seed, 4)];
    chosen.substeps[1] = 6; /* B is at the finest step and single */
    return chosen;
}

static void check_tape(const tape *actual, const tape *expected)
{
    for (size_t i = 0; i < PARTS; i++) {
        CHECK_BITS(NODES * MOST, actual->u[i], expected->u[i]);
        CHECK_BITS(NODES * MOST, actual->v[i], expected->v[i]);
        CHECK_BITS(NODES * MOST, actual->w[i], expected->w[i]);
    }
    CHECK_BITS(NODES * CONDITIONS, actual->lam, expected->lam);
    CHECK_BITS(NODES * CONDITIONS, actual->velocity, expected->velocity);
    CHECK_BITS(NODES * CONDITIONS, actual->displacement, expected->displacement);
}

static void a_run_has_the_same_bits_for_any_number_of_threads(void)
{
    static model m;
    static tape expected, actual;
    uint64_t seed = 11;
    for (size_t k = 0; k < PLANS; k++) {
        const plan chosen = random_plan(&seed);
        for (size_t threads = 1; threads <= MOST_THREADS; threads++) {
            tape *t = threads == 1 ? &expected : &actual;
            make_threaded_chain(&m, chosen, threads);
            CHECK_INT(pma_coupler_threads(m.coupler), threads < PARTS ? threads : PARTS);
            make_tape(t, &m, 0, 0);
            run_taped(&m, t, STEPS);
            destroy_model(&m);
            if (threads > 1)
                check_tape(&actual, &expected);
        }
    }
}

static void step_by_step_and_not_recorded_it_has_the_same_bits_too(void)
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
            const snapshot expected = present(&m);
            check_same_present(&n, &expected);
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
        asker a = {0, stop_at};
        const pma_poll poll = {ask, &a, 0};
        make_threaded_chain(&m, MIXED, 2 + stop_at % 3);
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_STOPPED);
        const int64_t done = pma_coupler_step_count(m.coupler);
        CHECK_INT(done, (stop_at - 1) / FINE);
        CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - done, NULL, &poll), PMA_OK);
        check_same_present(&m, &expected);
        destroy_model(&m);
    }
}

/* An infinite load at dof `dof` of part i after so many steps. */
static void check_infinite_load(size_t i, size_t dof, int64_t after, size_t threads)
{
    static model m, n;
    double F[MOST] = {0.0};
    F[dof] = INFINITY;
    make_chain(&n, MIXED, 1.0);
    make_threaded_chain(&m, MIXED, threads);
    CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
    const snapshot before = present(&m);
    const pma_load good = *pma_subdomain_load(m.parts[i].core);
    const pma_load bad = {.kind = PMA_LOAD_CONSTANT, .n = m.parts[i].n, .values = F};
    pma_subdomain_set_load(m.parts[i].core, bad);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), i);
    CHECK_INT(pma_coupler_step_count(m.coupler), after);
    check_same_present(&m, &before);
    pma_subdomain_set_load(m.parts[i].core, good);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&n);
    check_same_present(&m, &expected);
    destroy_model(&m);
    destroy_model(&n);
}

static void a_value_that_is_not_finite_is_named_and_the_run_can_go_on(void)
{
    for (size_t threads = 2; threads <= MOST_THREADS; threads++) {
        for (int64_t after = 0; after <= 3; after++) {
            check_infinite_load(0, 2, after, threads);
            check_infinite_load(0, 0, after, threads);
            check_infinite_load(1, 0, after, threads);
            check_infinite_load(2, 0, after, threads);
        }
    }
}

/* ---- of several values that are not finite, the one that one thread would have met ----------- */

enum { COARSE = 2, SPAN = 6 }; /* substeps of A, macro steps */

/* A double, B with three times its substeps; each has a small mass that nothing touches, with
 * a load in one own step under which it overflows: that is seen when the step is closed and not
 * before. */
static const double SMALL = 1e-3;

static void make_isolated(model *m, size_t threads, bool A_first, size_t A_step, size_t B_step)
{
    *m = (model){.count = 2, .p = 1, .dt = 0.3, .rebased = true, .threads = threads};
    part *A = &m->parts[A_first ? 0 : 1], *B = &m->parts[A_first ? 1 : 0];
    *A = (part){.n = 2, .nb = 1, .p = 1, .substeps = COARSE, .implicit = true, .doubled = true,
                .scheme = generalized_alpha(0.5), .M = {SMALL, 0, 0, 1}, .K = {SMALL, 0, 0, 2},
                .L = {0, 1}, .u0 = {0.5, 1.0}};
    *B = (part){.n = 2, .nb = 1, .p = 1, .substeps = 3 * COARSE,
                .scheme = generalized_alpha(0.5), .M = {SMALL, 0, 0, 1}, .K = {SMALL, 0, 0, 2},
                .L = {0, -1}, .u0 = {0.5, 1.0}};
    A->loads[2 * A_step] = B->loads[2 * B_step] = 1e308;
    for (size_t i = 0; i < m->count; i++)
        m->parts[i].load = (pma_load){.kind = PMA_LOAD_TABLE, .values = m->parts[i].loads,
                                      .rows = NODES};
    make_model(m);
}

static void check_isolated(bool A_first, size_t A_step, size_t B_step)
{
    static model m, n;
    make_isolated(&m, 1, A_first, A_step, B_step);
    make_isolated(&n, 2, A_first, A_step, B_step);
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

/* ---- all of them ----------------------------------------------------------------------------- */

const test THREADS_TESTS[] = {
    TEST(a_run_has_the_same_bits_for_any_number_of_threads),
    TEST(step_by_step_and_not_recorded_it_has_the_same_bits_too),
    TEST(a_stopped_run_goes_on_as_if_never_stopped),
    TEST(of_several_failures_the_first_is_named_as_by_one_thread),
    TEST(a_value_that_is_not_finite_is_named_and_the_run_can_go_on),
    END_OF_TESTS,
};
