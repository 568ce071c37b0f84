/* test_coupler.c - the coupler as an object, and against the naive program. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "algebra/factor.h"
#include "allocations.h"
#include "check.h"
#include "couple/coupler.h"
#include "forces/load.h"
#include "models.h"
#include "naive.h"
#include "solve/interface.h"
#include "subdomain/subdomain.h"
#include "tests.h"

/* ---- the coupler as an object --------------------------------------------------------------- */

static void a_coupler_with_sizes_that_do_not_agree_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts good = describe_coupler(&m);
    pma_coupler_parts bad[5] = {good, good, good, good, good};
    CHECK_STATUS(coupler_status(&good), PMA_OK);
    bad[0].p = 1;
    bad[1].H_start.p = 1;
    bad[2].H_start.p = 3;
    bad[3].H.p = 3;
    bad[4].H.p = 0;
    for (size_t i = 0; i < 5; i++)
        CHECK_STATUS(coupler_status(&bad[i]), PMA_BAD_SIZE);
    destroy_model(&m);
    pma_coupler_destroy(NULL);
}

static void a_motion_of_rows_that_do_not_exist_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts parts = describe_coupler(&m);
    const int64_t many[3] = {0, 1, 0};
    CHECK_STATUS(coupler_status(&parts), PMA_OK);
    m.moved_row = 2;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_INDEX);
    m.moved_row = -1;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_INDEX);
    m.motion = (pma_motion){many, {.kind = PMA_LOAD_NONE, .n = 2}};
    CHECK_STATUS(coupler_status(&parts), PMA_OK);
    m.motion.load.n = 3;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_SIZE);
    destroy_model(&m);
}

static void a_coupler_of_a_subdomain_with_other_constraints_is_refused(void)
{
    static model m, n;
    make_chain(&m, MIXED, 1.0);
    make_oscillator(&n, (split){0.1, 1, false, false, TRAPEZOIDAL, CENTRAL_DIFFERENCE});
    pma_coupler_parts parts = describe_coupler(&m);
    m.members[2] = pma_subdomain_member(n.subdomains[0].core);
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_SIZE);
    m.members[2] = pma_subdomain_member(m.subdomains[2].core);
    CHECK_STATUS(coupler_status(&parts), PMA_OK);
    destroy_model(&m);
    destroy_model(&n);
}

/* Two single masses without an interface, with these substeps of a macro step of 0.1. */
static pma_status status_of_substeps(size_t first, size_t second)
{
    const double H = 1.0;
    subdomain x = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true), y = x;
    pma_interface empty;
    x.substeps = first;
    y.substeps = second;
    x.h = 0.1 / (double)first;
    y.h = 0.1 / (double)second;
    make_subdomain(&x);
    make_subdomain(&y);
    const pma_factor factor = {.form = PMA_DIAGONAL, .inverse = &H};
    CHECK_STATUS(pma_interface_create(&factor, &empty), PMA_OK);
    const pma_member both[2] = {pma_subdomain_member(x.core), pma_subdomain_member(y.core)};
    const pma_coupler_parts parts = {.count = 2,
                                     .members = both,
                                     .H_start = empty,
                                     .H = empty,
                                     .dt = 0.1,
                                     .schedule = &pma_fine_schedule};
    const pma_status status = coupler_status(&parts);
    pma_subdomain_destroy(x.core);
    pma_subdomain_destroy(y.core);
    pma_interface_destroy(&empty);
    return status;
}

static void substeps_that_do_not_divide_the_largest_are_refused(void)
{
    CHECK_STATUS(status_of_substeps(1, 1), PMA_OK);
    CHECK_STATUS(status_of_substeps(3, 6), PMA_OK);
    CHECK_STATUS(status_of_substeps(6, 2), PMA_OK);
    CHECK_STATUS(status_of_substeps(2, 3), PMA_BAD_SIZE);
    CHECK_STATUS(status_of_substeps(6, 4), PMA_BAD_SIZE);
}

static void check_steps(const chain *chosen)
{
    static model m;
    build_chain(&m, chosen);
    pma_coupler_parts parts = describe_coupler(&m);
    const double eighth = 0.125, bad[6] = {-1.0, 0.0, 1.0 + 1e-12, 1.0 - 1e-12, INFINITY, NAN};
    for (size_t i = 0; i < SUBDOMAINS; i++) {
        const double h = m.members[i].h;
        for (size_t k = 0; k < 6; k++) {
            m.members[i].h = bad[k] * h;
            CHECK_STATUS(coupler_status(&parts), PMA_BAD_STEP);
        }
        m.members[i].h = nextafter(h, 1.0); /* dt / substeps may have been rounded */
        CHECK_STATUS(coupler_status(&parts), PMA_OK);
        m.members[i].h = nextafter(h, 0.0);
        CHECK_STATUS(coupler_status(&parts), PMA_OK);
        m.members[i].h = h;
    }
    parts.dt *= 1.0 + eighth;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_STEP);
    parts.dt = NAN;
    CHECK_STATUS(coupler_status(&parts), PMA_BAD_STEP);
    destroy_model(&m);
}

static void substeps_that_do_not_make_up_the_macro_step_are_refused(void)
{
    const chain fine = {.plan = MIXED};
    const chain macro = {.plan = {{1, 3, 7}, true, false, true, true, false}, .macro = true};
    check_steps(&fine);
    check_steps(&macro);
}

static void a_coupler_without_an_initial_state_does_not_run(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts parts = describe_coupler(&m);
    pma_coupler *fresh = NULL;
    CHECK_STATUS(pma_coupler_create(&parts, &fresh), PMA_OK);
    const snapshot before = present(&m);
    CHECK_STATUS(pma_coupler_advance(fresh, 1, NULL, NULL), PMA_NOT_READY);
    CHECK_STATUS(pma_coupler_advance(fresh, 0, NULL, NULL), PMA_NOT_READY);
    CHECK_INT(pma_coupler_step_count(fresh), 0);
    check_same_present(&m, &before);
    pma_coupler_start(fresh, 0, m.lam0, (double[]){0.0, 0.0});
    CHECK_STATUS(pma_coupler_advance(fresh, 0, NULL, NULL), PMA_OK);
    CHECK_INT(pma_coupler_step_count(fresh), 0);
    CHECK_STATUS(pma_coupler_advance(fresh, 1, NULL, NULL), PMA_OK);
    CHECK_INT(pma_coupler_step_count(fresh), 1);
    pma_coupler_destroy(fresh);
    destroy_model(&m);
}

static void a_started_coupler_shows_its_parts_and_its_multipliers(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_INT(pma_coupler_get_parts(m.coupler)->count, 3);
    CHECK_INT(pma_coupler_get_parts(m.coupler)->p, 2);
    CHECK_NEAR(pma_coupler_get_parts(m.coupler)->dt, 0.3, 0.0);
    CHECK_BITS(2, pma_coupler_multipliers(m.coupler), m.lam0);
    destroy_model(&m);
}

static void macro_steps_can_be_counted_as_long_as_their_substeps_can(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_INT(pma_coupler_most_steps(m.coupler), ((int64_t)1 << 53) / 6);
    CHECK_INT(pma_coupler_instants(m.coupler), 6);
    destroy_model(&m);
    build_chain(&m, &(chain){.plan = {{1, 3, 7}, true, false, true, true, false}, .macro = true});
    CHECK_INT(pma_coupler_most_steps(m.coupler), ((int64_t)1 << 53) / 7);
    CHECK_INT(pma_coupler_instants(m.coupler), 1);
    destroy_model(&m);
}

/* ---- the schedule, against the naive program ------------------------------------------------ */

static void check_against_naive_coupler(plan chosen)
{
    check_chain(&(chain){.plan = chosen});
}

static void gc_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, false, false, true, false, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, false, false});
    check_against_naive_coupler((plan){{6, 3, 1}, false, false, true, false, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, true, false});
}

static void pm_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, true, false, true, false, false});
    check_against_naive_coupler((plan){{1, 4, 2}, true, false, true, false, false});
    check_against_naive_coupler((plan){{3, 6, 1}, true, true, true, false, false});
    check_against_naive_coupler(MIXED);
    check_against_naive_coupler((plan){{2, 6, 3}, true, true, false, false, false});
}

static void restoring_forces_and_lagged_damping_act_where_they_are_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, false, false, true, false, true});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, true, true});
    check_against_naive_coupler((plan){{1, 1, 1}, true, false, true, false, true});
    check_against_naive_coupler((plan){{3, 6, 1}, true, true, true, false, true});
    check_against_naive_coupler((plan){{2, 6, 3}, true, true, true, true, true});
}

/* ---- bitwise identical ---------------------------------------------------------------------- */

static void a_run_of_many_steps_equals_many_runs_of_one(void)
{
    static model m, n;
    static tape t;
    make_chain(&m, MIXED, 1.0);
    make_chain(&n, MIXED, 1.0);
    make_tape(&t, &n, 0, 2);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < STEPS; i++)
        CHECK_STATUS(pma_coupler_advance(n.coupler, 1, &t.record, NULL), PMA_OK);
    check_same(&n, &m);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

/* Every step is linear in state and load, and a power of two passes every rounding. */
static void scaling_by_a_power_of_two_scales_all_results_bitwise(void)
{
    static model m, n;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (int k = -60; k <= 60; k += 30) {
        snapshot expected = present(&m);
        for (size_t i = 0; i < expected.count; i++)
            expected.values[i] = ldexp(expected.values[i], k);
        make_chain(&n, MIXED, ldexp(1.0, k));
        CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
        check_same_present(&n, &expected);
        destroy_model(&n);
    }
    destroy_model(&m);
}

static void check_second_start(const chain *chosen)
{
    static model m;
    build_chain(&m, chosen);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    start_model(&m);
    CHECK_INT(pma_coupler_step_count(m.coupler), 0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same_present(&m, &expected);
    destroy_model(&m);
}

/* ... also what its springs remember */
static void a_second_start_forgets_the_first_run(void)
{
    check_second_start(&(chain){.plan = MIXED});
    check_second_start(&(chain){.plan = MIXED, .sprung = true});
}

/* All kept levels of one model into another, which goes on as if it had been there all the time. */
static void check_taken_over(plan chosen, int64_t after)
{
    static model m, n;
    make_chain(&m, chosen, 1.0);
    make_chain(&n, chosen, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < m.count; i++) {
        const subdomain *x = &m.subdomains[i];
        CHECK_INT(copy_levels(x->core, n.subdomains[i].core), x->doubled ? 14 : 7);
    }
    double g[CONSTRAINTS];
    prescribe(&m, (size_t)after * m.fine, g);
    pma_coupler_start(n.coupler, after, pma_coupler_multipliers(m.coupler), g);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS - after, NULL, NULL), PMA_OK);
    check_same(&n, &m);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

static void a_run_goes_on_from_time_levels_that_were_written(void)
{
    for (int64_t after = 0; after <= 3; after++) {
        check_taken_over(MIXED, after);
        check_taken_over((plan){{1, 4, 2}, true, false, true, false, false}, after);
    }
}

static void check_kept(const subdomain *x, const pma_state_array *kept, const level *expected)
{
    const pma_state state = {
        .u = kept[0].values, .v = kept[1].values, .w = kept[2].values, .a = kept[3].values};
    check_state(x, &state, expected);
    CHECK_INT(kept[4].count, x->nb);
    for (size_t b = 0; b < x->nb; b++)
        CHECK_NEAR(kept[4].values[b], expected->vf[x->n - x->nb + b], AGREE);
}

/* Against the naive program: the present, the level before, and both free velocities. */
static void check_levels(size_t substeps)
{
    static model m;
    make_chain(&m, (plan){{substeps, 6, 3}, true, true, true, true, false}, 1.0);
    naive_run(&m, 4);
    for (size_t macro = 1; macro <= 4; macro++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        for (size_t i = 0; i < m.count; i++) {
            const subdomain *x = &m.subdomains[i];
            const level *now = &m.levels[i][macro * x->substeps];
            pma_state_array kept[PMA_LEVEL_ARRAYS];
            (void)pma_subdomain_arrays(x->core, kept);
            check_kept(x, kept, now);
            if (x->doubled)
                check_kept(x, kept + 7, now - 1);
        }
    }
    destroy_model(&m);
}

static void the_kept_levels_of_a_subdomain_are_its_present_and_the_level_before(void)
{
    check_levels(1);
    check_levels(2);
    check_levels(3);
    check_levels(6);
}

/* ---- no allocation in a step ---------------------------------------------------------------- */

static void check_allocations(const chain *chosen)
{
    static model m;
    static tape t;
    stopper a = {0, 0};
    const pma_poll poll = {poll_stopper, &a, 0};
    const size_t none = allocations_counted();
    build_chain(&m, chosen);
    make_tape(&t, &m, 0, 0);
    const size_t before = allocations_counted();
    CHECK(before - none >=
          2 * SUBDOMAINS + 2); /* the counter counts: a struct and a block for each */
    run_taped(&m, &t, 3);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - 3, NULL, &poll), PMA_OK);
    if (!has_inner(&m))
        start_model(&m); /* to evaluate internal forces for it belongs to set-up */
    CHECK_INT(allocations_counted(), before);
    destroy_model(&m);
}

/* Nor does an iteration, whatever is factored in it. */
static void a_step_does_not_allocate(void)
{
    chain chosen = {.plan = MIXED};
    if (!count_allocations()) {
        printf("allocations are counted under AddressSanitizer only\n");
        return;
    }
    check_allocations(&chosen);
    for (size_t i = 0; i < SUBDOMAINS; i++)
        chosen.inner[i] = true;
    chosen.nonlinear = true;
    chosen.newton = (pma_newton){.tolerance = 1e-10, .iterations = 40, .reuse = true};
    check_allocations(&chosen);
    chosen.plan.A_doubled = chosen.plan.C_doubled = false;
    chosen.macro = true;
    check_allocations(&chosen);
}

/* ---- all of them ---------------------------------------------------------------------------- */

const test COUPLER_TESTS[] = {
    TEST(a_coupler_with_sizes_that_do_not_agree_is_refused),
    TEST(a_motion_of_rows_that_do_not_exist_is_refused),
    TEST(a_coupler_of_a_subdomain_with_other_constraints_is_refused),
    TEST(substeps_that_do_not_divide_the_largest_are_refused),
    TEST(substeps_that_do_not_make_up_the_macro_step_are_refused),
    TEST(a_coupler_without_an_initial_state_does_not_run),
    TEST(a_started_coupler_shows_its_parts_and_its_multipliers),
    TEST(macro_steps_can_be_counted_as_long_as_their_substeps_can),
    TEST(gc_is_the_schedule_as_it_is_written),
    TEST(pm_is_the_schedule_as_it_is_written),
    TEST(restoring_forces_and_lagged_damping_act_where_they_are_written),
    TEST(a_run_of_many_steps_equals_many_runs_of_one),
    TEST(scaling_by_a_power_of_two_scales_all_results_bitwise),
    TEST(a_second_start_forgets_the_first_run),
    TEST(a_run_goes_on_from_time_levels_that_were_written),
    TEST(the_kept_levels_of_a_subdomain_are_its_present_and_the_level_before),
    TEST(a_step_does_not_allocate),
    END_OF_TESTS,
};
