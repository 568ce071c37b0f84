/* test_restoring.c - restoring forces: when they are evaluated, what becomes of one that fails. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "couple/coupler.h"
#include "forces/restoring.h"
#include "models.h"
#include "naive.h"
#include "subdomain/subdomain.h"
#include "tests.h"

static const plan RESTORED = {{2, 6, 3}, true, true, true, true, true};

static void a_force_is_evaluated_in_the_users_order_and_a_code_leaves_the_sum_as_it_was(void)
{
    const int64_t order[3] = {2, 0, 1};
    const double u[3] = {1.0, 2.0, 3.0}, v[3] = {4.0, 8.0, 16.0};
    double y[3] = {10.0, 20.0, 30.0}, work[9];
    int code = -1;
    diary d = {.fail_at = 2};
    const pma_restoring restoring = {
        .function = pull, .user = &d, .n = 3, .order = order, .work = work};
    /* user's u (2, 3, 1), v (8, 16, 4): r = (8 + 16 + 2, 27 + 6 + 4, 1 + 4 + 1) + 1/2 */
    CHECK_STATUS(pma_restoring_subtract(&restoring, 4.0, u, v, NULL, NULL, y, &code), PMA_OK);
    const double expected[3] = {10.0 - 6.5, 20.0 - 26.5, 30.0 - 37.5};
    CHECK_BITS(3, y, expected);
    CHECK_INT(code, 0);
    CHECK_STATUS(pma_restoring_subtract(&restoring, 5.0, u, v, NULL, NULL, y, &code),
                 PMA_RESTORING_FAILED);
    CHECK_BITS(3, y, expected);
    CHECK_INT(code, 7);
    CHECK(d.times[0] == 4.0 && d.times[1] == 5.0);
}

static void a_force_that_does_not_fit_the_subdomain_is_refused(void)
{
    subdomain x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.restored = true;
    x.D_r[0] = 1.0;
    const pma_parts good = describe(&x);
    pma_parts bad[4] = {good, good, good, good};
    const int64_t one = 1, negative = -1;
    bad[0].restoring.n = 2;
    bad[1].D_r.n = 2;
    bad[2].restoring.order = &one;
    bad[3].restoring.order = &negative;
    for (size_t i = 0; i < 4; i++) {
        pma_subdomain *made = (pma_subdomain *)&x;
        CHECK_STATUS(pma_subdomain_create(&bad[i], &made), i < 2 ? PMA_BAD_SIZE : PMA_BAD_INDEX);
        CHECK(made == NULL);
    }
}

static void a_force_is_evaluated_once_for_each_substep_at_its_end(void)
{
    static model m;
    make_chain(&m, RESTORED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < m.count; i++) {
        const subdomain *x = &m.subdomains[i];
        CHECK_INT(x->pulled.evaluated, STEPS * x->substeps);
        for (size_t k = 0; k < x->pulled.evaluated; k++)
            CHECK(x->pulled.times[k] == (double)(k + 1) / (double)x->substeps * m.dt);
    }
    destroy_model(&m);
}

/* The force of subdomain i fails at its fail_at-th evaluation; then the run goes on. */
static void check_continued(size_t i, size_t fail_at, size_t threads, const snapshot *at_macro)
{
    static model m;
    make_threaded_chain(&m, RESTORED, threads);
    diary *d = &m.subdomains[i].pulled;
    d->fail_at = fail_at;
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_RESTORING_FAILED);
    CHECK_INT(pma_coupler_failed(m.coupler), i);
    CHECK_INT(pma_subdomain_code(m.subdomains[i].core), 7);
    const size_t whole = (fail_at - 1) / m.subdomains[i].substeps;
    CHECK_INT(pma_coupler_step_count(m.coupler), whole);
    check_same_present(&m, &at_macro[whole]);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - (int64_t)whole, NULL, NULL), PMA_OK);
    check_same_present(&m, &at_macro[STEPS]);
    destroy_model(&m);
}

static void a_run_whose_force_failed_is_at_a_macro_step_and_goes_on_as_if_it_had_not(void)
{
    static model m;
    snapshot at_macro[STEPS + 1];
    make_chain(&m, RESTORED, 1.0);
    at_macro[0] = present(&m);
    for (size_t i = 1; i <= STEPS; i++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        at_macro[i] = present(&m);
    }
    for (size_t i = 0; i < m.count; i++) {
        for (size_t fail_at = 1; fail_at <= 3 * m.subdomains[i].substeps; fail_at++)
            check_continued(i, fail_at, 1 + fail_at % 3, at_macro);
    }
    destroy_model(&m);
}

static void the_force_alone_is_what_a_step_would_evaluate(void)
{
    subdomain x = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true);
    double r = -1.0;
    const double u = 2.0, v = 3.0, zero = 0.0;
    make_subdomain(&x);
    CHECK_STATUS(pma_subdomain_evaluate_restoring(x.core, 8.0, &u, &v, &r), PMA_OK);
    CHECK_BITS(1, &r, &zero);
    pma_subdomain_destroy(x.core);
    x.restored = true;
    make_subdomain(&x);
    CHECK_STATUS(pma_subdomain_evaluate_restoring(x.core, 8.0, &u, &v, &r), PMA_OK);
    CHECK(r == 8.0 + 3.0 + 0.75 + 1.0);
    pma_subdomain_destroy(x.core);
}

/* A function may last: after every fine step in which one was called the poll is called. */
static void a_run_with_forces_polls_after_every_call(void)
{
    static model m;
    stopper a = {0, 0};
    const pma_poll poll = {poll_stopper, &a, 20000};
    make_chain(&m, RESTORED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_OK);
    CHECK_INT(a.polled, STEPS * FINE - 1); /* before the first step nothing was called */
    destroy_model(&m);
}

const test RESTORING_TESTS[] = {
    TEST(a_force_is_evaluated_in_the_users_order_and_a_code_leaves_the_sum_as_it_was),
    TEST(a_force_that_does_not_fit_the_subdomain_is_refused),
    TEST(a_force_is_evaluated_once_for_each_substep_at_its_end),
    TEST(a_run_whose_force_failed_is_at_a_macro_step_and_goes_on_as_if_it_had_not),
    TEST(the_force_alone_is_what_a_step_would_evaluate),
    TEST(a_run_with_forces_polls_after_every_call),
    END_OF_TESTS,
};
