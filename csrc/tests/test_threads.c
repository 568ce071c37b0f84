/* test_threads.c - a coupler with a team: the same bits as alone, whatever happens. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "coupler.h"
#include "models.h"
#include "naive.h"
#include "subdomain.h"
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

/* ---- all of them ----------------------------------------------------------------------------- */

const test THREADS_TESTS[] = {
    TEST(a_run_has_the_same_bits_for_any_number_of_threads),
    TEST(step_by_step_and_not_recorded_it_has_the_same_bits_too),
    TEST(a_stopped_run_goes_on_as_if_never_stopped),
    TEST(a_value_that_is_not_finite_is_named_and_the_run_can_go_on),
    END_OF_TESTS,
};
