/* test_iterated_runs.c - runs with internal forces that end early, go on, or are shared by threads:
 * bitwise what a run is that nothing has happened to. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "couple/coupler.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

enum { SPAN = 3, KINDS = 8 }; /* macro steps of a run; kinds of runs */

/* Both schedules, with tangents that are kept or fresh, and with double steps or not; in the middle
 * of some substeps of C there are time levels of the others. */
static chain kind(int k)
{
    const bool macro = k & 1, doubled = k & 4;
    chain c = {.macro = macro, .nonlinear = true, .sprung = true, .inner = {true, true, true}};
    c.plan = (plan){{macro && doubled ? 1 : 2, 6, 3}, doubled, doubled && !macro, true, true, true};
    c.newton = (pma_newton){.tolerance = 1e-10, .iterations = 40, .reuse = k & 2};
    return c;
}

static void make_kind(model *m, int k, size_t threads)
{
    chain c = kind(k);
    c.threads = threads;
    build_chain(m, &c);
}

/* All macro steps of a run that nothing happens to. */
static void run_whole(int k, snapshot *at_macro)
{
    static model m;
    make_kind(&m, k, 1);
    at_macro[0] = present(&m);
    for (size_t step = 1; step <= SPAN; step++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        at_macro[step] = present(&m);
    }
    destroy_model(&m);
}

/* ---- threads -------------------------------------------------------------------------------- */

static void an_iterated_run_is_bitwise_identical_for_any_number_of_threads(void)
{
    static model m;
    static tape expected, actual;
    for (int k = 0; k < KINDS; k++) {
        for (size_t threads = 1; threads <= SUBDOMAINS; threads++) {
            tape *t = threads == 1 ? &expected : &actual;
            make_kind(&m, k, threads);
            CHECK_INT(pma_coupler_threads(m.coupler), threads);
            make_tape(t, &m, 0, 0);
            run_taped(&m, t, STEPS);
            destroy_model(&m);
            if (threads > 1)
                check_tape(&actual, &expected);
        }
    }
}

/* ---- a function that fails ------------------------------------------------------------------ */

/* Evaluations of subdomain i in a run from the start on. */
static size_t count_evaluations(int k, size_t i)
{
    static model m;
    make_kind(&m, k, 1);
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, NULL), PMA_OK);
    const size_t count = m.subdomains[i].inner.evaluated;
    destroy_model(&m);
    return count;
}

/* Its fail_at-th evaluation fails. The present is that of a whole macro step, and the run goes on
 * to the end as if nothing had happened. */
static void check_failure(int k, size_t i, size_t fail_at, size_t threads, const snapshot *at_macro)
{
    static model m;
    make_kind(&m, k, threads);
    m.subdomains[i].inner.fail_at = fail_at;
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, NULL), PMA_INTERNAL_FAILED);
    CHECK_INT(pma_coupler_failed(m.coupler), i);
    CHECK_INT(pma_subdomain_code(m.subdomains[i].core), 7);
    const int64_t done = pma_coupler_step_count(m.coupler);
    check_same_present(&m, &at_macro[done]);
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN - done, NULL, NULL), PMA_OK);
    check_same_present(&m, &at_macro[SPAN]);
    destroy_model(&m);
}

static void a_function_that_fails_leaves_the_last_whole_macro_step(void)
{
    snapshot at_macro[SPAN + 1];
    for (int k = 0; k < KINDS; k++) {
        run_whole(k, at_macro);
        for (size_t i = 0; i < SUBDOMAINS; i++) {
            const size_t count = count_evaluations(k, i);
            CHECK(count > 0);
            for (size_t at = 3; at <= count; at += STRIDE + at / 3) /* 1 and 2: the start's */
                check_failure(k, i, at, 1 + at % SUBDOMAINS, at_macro);
        }
    }
}

/* ---- a value that is not finite -------------------------------------------------------------- */

/* From one evaluation on all forces of subdomain i are NaN; then they are not any more. */
static void check_spoilt(int k, size_t i, size_t from, const snapshot *at_macro)
{
    static model m;
    make_kind(&m, k, 1);
    m.subdomains[i].inner.spoil_from = from;
    const pma_status status = pma_coupler_advance(m.coupler, SPAN, NULL, NULL);
    CHECK(status == PMA_NOT_FINITE || status == PMA_NOT_CONVERGED);
    if (status == PMA_NOT_FINITE)
        CHECK_INT(pma_coupler_failed(m.coupler), i);
    const int64_t done = pma_coupler_step_count(m.coupler);
    check_same_present(&m, &at_macro[done]);
    m.subdomains[i].inner.spoil_from = 0;
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN - done, NULL, NULL), PMA_OK);
    check_same_present(&m, &at_macro[SPAN]);
    destroy_model(&m);
}

static void forces_that_are_no_longer_finite_leave_the_last_whole_macro_step(void)
{
    snapshot at_macro[SPAN + 1];
    for (int k = 0; k < KINDS; k++) {
        run_whole(k, at_macro);
        for (size_t i = 0; i < SUBDOMAINS; i++) {
            const size_t count = count_evaluations(k, i);
            for (size_t at = 3; at <= count; at += STRIDE + at / 4)
                check_spoilt(k, i, at, at_macro);
        }
    }
}

/* ---- too few iterations ---------------------------------------------------------------------- */

static void an_iteration_that_does_not_converge_names_the_subdomain(void)
{
    static model m;
    for (int k = 0; k < KINDS; k++) {
        chain c = kind(k);
        c.newton.iterations = 1;
        build_chain(&m, &c);
        const snapshot before = present(&m);
        CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, NULL), PMA_NOT_CONVERGED);
        CHECK(pma_coupler_failed(m.coupler) < SUBDOMAINS);
        CHECK_INT(pma_coupler_step_count(m.coupler), 0);
        check_same_present(&m, &before);
        destroy_model(&m);
    }
}

/* ---- stopped -------------------------------------------------------------------------------- */

static void check_stopped(int k, size_t stop_at, const snapshot *at_macro)
{
    static model m;
    make_kind(&m, k, 1);
    stopper a = {0, stop_at};
    const pma_poll poll = {poll_stopper, &a, 0};
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, &poll), PMA_STOPPED);
    CHECK_INT(a.polled, stop_at);
    const int64_t done = pma_coupler_step_count(m.coupler);
    check_same_present(&m, &at_macro[done]);
    CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN - done, NULL, &poll), PMA_OK);
    check_same_present(&m, &at_macro[SPAN]);
    destroy_model(&m);
}

/* The poll is called before every evaluation ("pm"), and before every substep of a run. */
static void an_iteration_can_be_stopped_anywhere_and_goes_on(void)
{
    static model m;
    snapshot at_macro[SPAN + 1];
    for (int k = 0; k < KINDS; k++) {
        stopper a = {0, 0};
        const pma_poll poll = {poll_stopper, &a, 0};
        run_whole(k, at_macro);
        make_kind(&m, k, 1);
        CHECK_STATUS(pma_coupler_advance(m.coupler, SPAN, NULL, &poll), PMA_OK);
        check_same_present(&m, &at_macro[SPAN]);
        destroy_model(&m);
        CHECK(a.polled > (m.macro ? 2 * SPAN : 2 * SPAN * FINE));
        for (size_t stop_at = 1; stop_at <= a.polled; stop_at += STRIDE + stop_at / 8)
            check_stopped(k, stop_at, at_macro);
    }
}

/* ---- saved and restored ---------------------------------------------------------------------- */

/* What is copied is all there is: another coupler goes on with it. */
static void a_run_goes_on_from_what_was_saved(void)
{
    static model m, n;
    snapshot at_macro[SPAN + 1];
    for (int k = 0; k < KINDS; k++) {
        run_whole(k, at_macro);
        for (int64_t step = 0; step <= SPAN; step++) {
            make_kind(&m, k, 1);
            make_kind(&n, k, 1);
            CHECK_STATUS(pma_coupler_advance(m.coupler, step, NULL, NULL), PMA_OK);
            CHECK_STATUS(pma_coupler_advance(n.coupler, 1, NULL, NULL),
                         PMA_OK); /* is overwritten */
            carry_over(&m, &n);
            CHECK_STATUS(pma_coupler_advance(n.coupler, SPAN - step, NULL, NULL), PMA_OK);
            check_same_present(&n, &at_macro[SPAN]);
            destroy_model(&m);
            destroy_model(&n);
        }
    }
}

/* Two masses on a stiff internal lever of 1 to 3, far from zero, go on with a small velocity: what
 * rounding of 1000 makes of 1e6 times differences is larger than any force, and no residual (N8),
 * so that a first correction, or none, is accepted. A third mass is tied to them. */
static void rounding_of_displacements_is_no_residual(void)
{
    static const double K = 1e6, FAR = 1000.0, SPEED = 1e-3;
    static model m;
    m = (model){.count = 2, .p = 1, .dt = 0.01, .rebased = true};
    m.newton = (pma_newton){.tolerance = 1e-8, .iterations = 5};
    m.subdomains[0] = (subdomain){.n = 2,
                                  .nb = 1,
                                  .p = 1,
                                  .substeps = 1,
                                  .implicit = true,
                                  .scheme = generalized_alpha(0.5),
                                  .M = {1.0, 0.0, 0.0, 2.0},
                                  .K = {9.0 * K, -3.0 * K, -3.0 * K, K},
                                  .L = {0.0, 1.0},
                                  .u0 = {FAR / 3.0, FAR},
                                  .v0 = {SPEED / 3.0, SPEED},
                                  .inner = {.used = true}};
    m.subdomains[1] = one_mass(1.0, 0.0, -1.0, generalized_alpha(0.5), true);
    m.subdomains[1].u0[0] = FAR;
    m.subdomains[1].v0[0] = SPEED;
    make_model(&m);
    for (int64_t k = 0; k < STEPS; k++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const pma_state *x = pma_subdomain_present(m.subdomains[0].core);
        CHECK(x->history[HISTORY] <= 1.0);
        for (size_t i = 0; i < 2; i++) /* rounding of 1e-7 in forces, in steps of 0.01 */
            CHECK_NEAR(x->v[i], SPEED / (i == 0 ? 3.0 : 1.0), 1e-7);
    }
    destroy_model(&m);
}

const test ITERATED_RUNS_TESTS[] = {
    TEST(an_iterated_run_is_bitwise_identical_for_any_number_of_threads),
    TEST(a_function_that_fails_leaves_the_last_whole_macro_step),
    TEST(forces_that_are_no_longer_finite_leave_the_last_whole_macro_step),
    TEST(an_iteration_that_does_not_converge_names_the_subdomain),
    TEST(an_iteration_can_be_stopped_anywhere_and_goes_on),
    TEST(a_run_goes_on_from_what_was_saved),
    TEST(rounding_of_displacements_is_no_residual),
    END_OF_TESTS,
};
