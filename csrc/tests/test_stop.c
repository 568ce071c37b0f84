/* test_stop.c - runs that end early: stopped by the caller, or no longer finite. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "check.h"
#include "couple/coupler.h"
#include "forces/load.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

/* ---- stopped -------------------------------------------------------------------------------- */

/* Stopped before fine step `stop_at` of the run, then to the end. */
static void check_stopped(size_t stop_at, const snapshot *at_macro, const tape *expected)
{
    static model m;
    static tape t;
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    stopper a = {0, stop_at};
    const pma_poll poll = {poll_stopper, &a, 0};
    pma_coupler_record_present(m.coupler, &t.record);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, &t.record, &poll), PMA_STOPPED);
    const size_t whole = (stop_at - 1) / FINE;
    CHECK_INT(pma_coupler_step_count(m.coupler), whole);
    check_same_present(&m, &at_macro[whole]);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - (int64_t)whole, &t.record, &poll), PMA_OK);
    check_same_present(&m, &at_macro[STEPS]);
    for (size_t i = 0; i < m.count; i++)
        CHECK_BITS(LEVELS * MOST, t.w[i], expected->w[i]);
    CHECK_BITS(LEVELS * CONSTRAINTS, t.lam, expected->lam);
    CHECK_BITS(LEVELS * CONSTRAINTS, t.velocity, expected->velocity);
    destroy_model(&m);
}

static void a_stopped_run_is_at_a_macro_step_and_goes_on_as_if_never_stopped(void)
{
    static model m;
    static tape t;
    snapshot at_macro[STEPS + 1];
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    pma_coupler_record_present(m.coupler, &t.record);
    at_macro[0] = present(&m);
    for (size_t i = 1; i <= STEPS; i++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, &t.record, NULL), PMA_OK);
        at_macro[i] = present(&m);
    }
    for (size_t stop_at = 1; stop_at <= 4 * FINE; stop_at++)
        check_stopped(stop_at, at_macro, &t);
    destroy_model(&m);
}

/* Calls of the poll in a whole run, when it is called about every `entries` entries. */
static size_t count_polls(size_t entries)
{
    static model m;
    stopper a = {0, 0};
    const pma_poll poll = {poll_stopper, &a, entries};
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_OK);
    destroy_model(&m);
    return a.polled;
}

static void a_run_polls_about_every_given_number_of_entries(void)
{
    static model m;
    size_t entries = 0; /* of a macro step */
    make_chain(&m, MIXED, 1.0);
    for (size_t i = 0; i < m.count; i++)
        entries += m.subdomains[i].substeps * m.members[i].entries;
    entries += FINE * 2 * pma_factor_entries(&m.interfaces[1].factor);
    CHECK_INT(count_polls(0), STEPS * FINE);
    CHECK_INT(count_polls(SIZE_MAX), 0);
    /* at the first fine step after every macro step; the last one is not followed by any */
    CHECK_INT(count_polls(entries), STEPS - 1);
    CHECK_INT(count_polls(2 * entries), (STEPS - 1) / 2);
    destroy_model(&m);
}

/* ---- not finite ----------------------------------------------------------------------------- */

/* A heavy mass, implicit, and B, explicit, with a small one on a stiff spring inside: omega h = 3
 * when the interface is held, beyond the limit 2. It overflows a thousand times before A. */
static void make_unstable(model *m, bool doubled, size_t substeps)
{
    *m = (model){.count = 2, .p = 1, .dt = 0.1 * (double)substeps, .rebased = true};
    m->subdomains[0] = one_mass(1000.0, 1.0, 1.0, TRAPEZOIDAL, true);
    m->subdomains[0].doubled = doubled;
    m->subdomains[1] = (subdomain){.n = 2,
                                   .nb = 1,
                                   .p = 1,
                                   .substeps = substeps,
                                   .scheme = CENTRAL_DIFFERENCE,
                                   .M = {1.0, 0.0, 0.0, 1.0},
                                   .K = {900.0, -900.0, -900.0, 900.0},
                                   .L = {0.0, -1.0},
                                   .u0 = {1.0}};
    make_model(m);
}

/* The coupler stops in the macro step in which B overflows, and stays before it. */
static void check_unstable(bool doubled, size_t substeps)
{
    static model m;
    const int64_t forever = 100000;
    make_unstable(&m, doubled, substeps);
    CHECK_STATUS(pma_coupler_advance(m.coupler, forever, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), 1);
    const snapshot kept = present(&m);
    for (size_t i = 0; i < kept.count; i++)
        CHECK(isfinite(kept.values[i]));
    const int64_t done = pma_coupler_step_count(m.coupler);
    CHECK(done > 0 && done < forever);

    /* again, and the same */
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), 1);
    CHECK_INT(pma_coupler_step_count(m.coupler), done);
    check_same_present(&m, &kept);

    /* as far as that the run is a run like any other */
    start_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, done, NULL, NULL), PMA_OK);
    check_same_present(&m, &kept);
    destroy_model(&m);
}

static void an_explicit_subdomain_above_its_limit_is_named_and_the_state_kept(void)
{
    check_unstable(false, 1);
    check_unstable(true, 1);
    check_unstable(false, 2);
    check_unstable(true, 2);
}

static void after_a_load_that_is_not_finite_the_run_can_go_on_as_if_it_had_not_been(void)
{
    static const size_t places[5][2] = {
        {0, 2}, {0, 0}, {1, 0}, {2, 0}, {2, 1}}; /* subdomain, dof */
    static model m, n;
    for (size_t k = 0; k < 20; k++) {
        make_chain(&m, MIXED, 1.0);
        make_chain(&n, MIXED, 1.0);
        const int64_t after = k < 15 ? (int64_t)(k / 5) : STEPS - 1;
        check_infinite_load(&m, places[k % 5][0], places[k % 5][1], after, &n);
    }
}

/* Two masses that nothing ties: the second has no interface on which it could be seen early. */
static void an_unstable_subdomain_without_an_interface_is_named_too(void)
{
    static model m;
    m = (model){.count = 2, .dt = 1.0};
    m.subdomains[0] = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true);
    m.subdomains[1] = one_mass(1.0, 9.0, 0.0, CENTRAL_DIFFERENCE, false); /* omega h = 3 */
    m.subdomains[1].u0[0] = 1.0;
    make_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 10000, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_failed(m.coupler), 1);
    CHECK(isfinite(pma_subdomain_present(m.subdomains[1].core)->u[0]));
    destroy_model(&m);
}

/* All free velocities are finite, the multipliers are not. */
static void an_interface_matrix_that_is_not_finite_is_named_as_the_interface(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    m.inverse[1][0] = INFINITY; /* of H, from the second macro step on */
    const snapshot before = present(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 5, NULL, NULL), PMA_NOT_FINITE);
    CHECK(pma_coupler_failed(m.coupler) == PMA_INTERFACE);
    CHECK_INT(pma_coupler_step_count(m.coupler), 1);
    start_model(&m);
    check_same_present(&m, &before);
    destroy_model(&m);
}

/* ---- all of them ---------------------------------------------------------------------------- */

const test STOP_TESTS[] = {
    TEST(a_stopped_run_is_at_a_macro_step_and_goes_on_as_if_never_stopped),
    TEST(a_run_polls_about_every_given_number_of_entries),
    TEST(an_explicit_subdomain_above_its_limit_is_named_and_the_state_kept),
    TEST(after_a_load_that_is_not_finite_the_run_can_go_on_as_if_it_had_not_been),
    TEST(an_unstable_subdomain_without_an_interface_is_named_too),
    TEST(an_interface_matrix_that_is_not_finite_is_named_as_the_interface),
    END_OF_TESTS,
};
