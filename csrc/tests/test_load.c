/* test_load.c - loads between, at and after their samples. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "forces/load.h"
#include "tests.h"

/* F(t) of a load of three dofs, found by adding it to something else. */
static void check_load(const pma_load *load, double t, int64_t step, const double *expected)
{
    double g[3] = {16.0, 32.0, 64.0}, total[3];
    for (size_t i = 0; i < 3; i++)
        total[i] = g[i] + expected[i];
    pma_load_add(load, t, step, g);
    CHECK_BITS(3, g, total);
}

static const double NOTHING[3] = {0.0, 0.0, 0.0};

static void no_load_adds_nothing_and_a_constant_load_itself(void)
{
    const double F[3] = {1.0, -2.0, 0.5};
    const pma_load none = {.kind = PMA_LOAD_NONE, .n = 3};
    const pma_load constant = {.kind = PMA_LOAD_CONSTANT, .n = 3, .values = F};
    check_load(&none, 1.0, 1, NOTHING);
    check_load(&constant, 0.0, 0, F);
    check_load(&constant, 1e9, 1000000, F);
}

static void a_table_gives_the_row_of_the_substep(void)
{
    const double rows[2][3] = {{1.0, 2.0, 3.0}, {-4.0, 5.0, 6.0}};
    const pma_load load = {
        .kind = PMA_LOAD_TABLE, .n = 3, .values = rows[0], .first = 1000, .rows = 2};
    check_load(&load, 0.0, 1000, rows[0]); /* whatever the time */
    check_load(&load, 0.0, 1001, rows[1]);
}

/* samples at 0, 1/4, 1/2; all numbers are sums of a few powers of two, so there is no rounding */
static void a_sampled_load_is_linear_between_samples_and_held_or_zero_after(void)
{
    const double samples[3][3] = {{0.0, 8.0, 1.0}, {4.0, 0.0, 1.0}, {2.0, 2.0, 1.0}};
    pma_load load = {
        .kind = PMA_LOAD_SAMPLED, .n = 3, .values = samples[0], .samples = 3, .k = 3, .dt = 0.25};
    for (int hold = 0; hold <= 1; hold++) {
        load.hold = hold;
        check_load(&load, 0.0, 0, samples[0]);
        check_load(&load, 0.0625, 0, (double[]){1.0, 6.0, 1.0}); /* a quarter of the way */
        check_load(&load, 0.25, 0, samples[1]);
        check_load(&load, 0.4375, 0, (double[]){2.5, 1.5, 1.0}); /* three quarters */
        check_load(&load, 0.5, 0, samples[2]); /* the end itself belongs to the load */
        check_load(&load, 0.5000001, 0, hold ? samples[2] : NOTHING);
        check_load(&load, 100.0, 0, hold ? samples[2] : NOTHING);
    }
    load.begin = 2.0;
    check_load(&load, 2.0625, 0, (double[]){1.0, 6.0, 1.0});
    load.begin = 0.0;
    load.samples = 1;
    check_load(&load, 0.0, 0, samples[0]);
    check_load(&load, 0.25, 0, samples[0]); /* held, from the last pass */
    load.hold = false;
    check_load(&load, 0.25, 0, NOTHING);
}

/* F = s_0 (1, 2, 0) + s_1 (0, 1, -1) with s = (2, 4) at t = 0 and (6, 0) at t = 1/2 */
static void a_shape_spreads_the_samples_over_the_dofs(void)
{
    const double samples[2][2] = {{2.0, 4.0}, {6.0, 0.0}};
    const double shape[2][3] = {{1.0, 2.0, 0.0}, {0.0, 1.0, -1.0}};
    const pma_load load = {.kind = PMA_LOAD_SAMPLED,
                           .n = 3,
                           .values = samples[0],
                           .shape = shape[0],
                           .samples = 2,
                           .k = 2,
                           .dt = 0.5};
    check_load(&load, 0.0, 0, (double[]){2.0, 8.0, -4.0});
    check_load(&load, 0.25, 0, (double[]){4.0, 10.0, -2.0}); /* s = (4, 2) */
    check_load(&load, 0.5, 0, (double[]){6.0, 12.0, 0.0});
    check_load(&load, 0.75, 0, NOTHING);
}

enum { SAMPLES = 200 };

/* F(t) of one dof whose samples 1, -1, 1, ... end with number `last` */
static double alternating_load(size_t last, double step, double t)
{
    double samples[SAMPLES], g = 0.0;
    for (size_t m = 0; m < SAMPLES; m++)
        samples[m] = m % 2 ? -1.0 : 1.0;
    const pma_load load = {.kind = PMA_LOAD_SAMPLED,
                           .n = 1,
                           .values = samples,
                           .samples = last + 1,
                           .k = 1,
                           .dt = step};
    pma_load_add(&load, t, 0, &g);
    return g;
}

/* Sampled at m * step and evaluated at (k/fine) * dt with dt = fine * step: equal as decimals, not
 * bitwise. Without care half of those that fall below would be interpolated, of those that fall
 * above the last one would be zero. */
static void a_sample_instant_typed_as_a_decimal_gives_the_sample_itself(void)
{
    const struct {
        double dt, fine, step;
    } typed[] = {{0.02, 20.0, 0.001}, {0.2, 20.0, 0.01},         {0.1, 5.0, 0.02},
                 {0.07, 7.0, 0.01},   {0.02 * 0.02, 20.0, 2e-5}, {0.3, 3.0, 0.1}};
    size_t below = 0, above = 0;
    for (size_t i = 0; i < sizeof typed / sizeof typed[0]; i++) {
        for (size_t k = 0; k < SAMPLES; k++) {
            const double t = (double)k / typed[i].fine * typed[i].dt;
            const double expected = k % 2 ? -1.0 : 1.0;
            CHECK_NEAR(alternating_load(k, typed[i].step, t), expected, 0.0);
            CHECK_NEAR(alternating_load(SAMPLES - 1, typed[i].step, t), expected, 0.0);
            below += t / typed[i].step < (double)k;
            above += t / typed[i].step > (double)k;
        }
    }
    CHECK(below > 0 && above > 0); /* else the inputs show nothing */
}

/* The care ends at rounding: 1e-12 of a sample step is a time of its own. */
static void a_time_just_beside_a_sample_is_not_the_sample(void)
{
    CHECK_NEAR(alternating_load(10, 0.01, 0.1 * (1.0 + 1e-12)), 0.0, 0.0); /* after the end */
    CHECK(alternating_load(10, 0.01, 0.1 * (1.0 - 1e-12)) < 1.0);
    CHECK(alternating_load(20, 0.01, 0.1 * (1.0 + 1e-12)) < 1.0);
}

/* f_k = (k + 1) t; the code in *user */
static int push(double t, intptr_t n, double *f, void *user)
{
    for (intptr_t k = 0; k < n; k++)
        f[k] += (double)(k + 1) * t;
    return *(int *)user;
}

static void a_called_load_is_evaluated_once_and_added_in_elimination_order(void)
{
    const int64_t order[3] = {2, 0, 1};
    double work[3] = {9.0, 9.0, 9.0}, g[3] = {1.0, 2.0, 3.0};
    int returned = 0, code = -1;
    const pma_load load = {.kind = PMA_LOAD_CALLED,
                           .n = 3,
                           .function = push,
                           .user = &returned,
                           .order = order,
                           .work = work};
    CHECK_STATUS(pma_load_evaluate(&load, 4.0, &code), PMA_OK);
    CHECK_INT(code, 0);
    pma_load_add(&load, 100.0, 0, g); /* the last evaluation counts */
    const double expected[3] = {13.0, 6.0, 11.0};
    CHECK_BITS(3, g, expected);
    returned = -5;
    CHECK_STATUS(pma_load_evaluate(&load, 4.0, &code), PMA_FORCE_FAILED);
    CHECK_INT(code, -5);
    const pma_load none = {.n = 3};
    CHECK_STATUS(pma_load_evaluate(&none, 4.0, &code), PMA_OK);
}

static void a_sum_has_the_kinds_the_rows_and_the_values_of_its_loads(void)
{
    const double F[3] = {1.0, -2.0, 0.5}, rows[2][3] = {{1.0, 2.0, 3.0}, {-4.0, 5.0, 6.0}};
    const int64_t order[3] = {2, 0, 1};
    double work[3] = {0.0, 0.0, 0.0}, g[3] = {0.0, 0.0, 0.0};
    int returned = 0, code = -1;
    const pma_load each[3] = {
        {.kind = PMA_LOAD_CONSTANT, .n = 3, .values = F},
        {.kind = PMA_LOAD_TABLE, .n = 3, .values = rows[0], .first = 10, .rows = 2},
        {.kind = PMA_LOAD_CALLED,
         .n = 3,
         .function = push,
         .user = &returned,
         .order = order,
         .work = work},
    };
    const pma_load sum = {.kind = PMA_LOAD_SUM, .n = 3, .each = each, .count = 3};
    CHECK(pma_load_has(&sum, PMA_LOAD_TABLE) && pma_load_has(&sum, PMA_LOAD_CALLED));
    CHECK(!pma_load_has(&sum, PMA_LOAD_SAMPLED));
    CHECK(pma_load_covers(&sum, 10, 12));
    CHECK(!pma_load_covers(&sum, 9, 10) && !pma_load_covers(&sum, 11, 13));
    CHECK_STATUS(pma_load_evaluate(&sum, 4.0, &code), PMA_OK);
    const double called[3] = {12.0, 4.0, 8.0}; /* k + 1 times t, of dofs 2, 0, 1 */
    pma_load_add_called(&sum, g);
    CHECK_BITS(3, g, called);
    const double expected[3] = {9.0, 7.0, 14.5}; /* F, row 1 and these */
    check_load(&sum, 0.0, 11, expected);
    returned = -5;
    CHECK_STATUS(pma_load_evaluate(&sum, 4.0, &code), PMA_FORCE_FAILED);
    CHECK_INT(code, -5);
}

const test LOAD_TESTS[] = {
    TEST(no_load_adds_nothing_and_a_constant_load_itself),
    TEST(a_table_gives_the_row_of_the_substep),
    TEST(a_sampled_load_is_linear_between_samples_and_held_or_zero_after),
    TEST(a_shape_spreads_the_samples_over_the_dofs),
    TEST(a_sample_instant_typed_as_a_decimal_gives_the_sample_itself),
    TEST(a_time_just_beside_a_sample_is_not_the_sample),
    TEST(a_called_load_is_evaluated_once_and_added_in_elimination_order),
    TEST(a_sum_has_the_kinds_the_rows_and_the_values_of_its_loads),
    END_OF_TESTS,
};
