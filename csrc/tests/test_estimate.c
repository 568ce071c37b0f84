/* test_estimate.c - local errors of recorded steps and their norms, against hand calculation. */
#include <math.h>

#include "check.h"
#include "member/estimate.h"
#include "tests.h"

enum { LEVELS = 5, COLUMNS = 3, STEPS = 2 };

/* u = c t^3 / 6, v = c t^2 / 2 and w = c t at t = 0..4, with another c in each column. */
static void fill(double *u, double *v, double *w)
{
    const double c[COLUMNS] = {6.0, -12.0, 18.0};
    for (size_t i = 0; i < LEVELS; i++) {
        const double t = (double)i;
        for (size_t k = 0; k < COLUMNS; k++) {
            u[i * COLUMNS + k] = c[k] * t * t * t / 6.0;
            v[i * COLUMNS + k] = c[k] * t * t / 2.0;
            w[i * COLUMNS + k] = c[k] * t;
        }
    }
}

static void a_cubic_motion_has_no_local_error_and_an_offset_is_one(void)
{
    double u[LEVELS * COLUMNS], v[LEVELS * COLUMNS], w[LEVELS * COLUMNS];
    const int64_t begin[STEPS] = {0, 2}, end[STEPS] = {1, 4}; /* a single and a double step */
    const pma_recorded_steps steps = {STEPS, begin, end, 1.0};
    const double expected[6] = {0.0, 0.5, 0.0, 0.0, 0.0, -2.0}; /* by columns */
    double e[6];
    fill(u, v, w);
    u[4 * COLUMNS + 0] += 0.5;
    u[4 * COLUMNS + 2] -= 2.0;
    const pma_motion_rows x = {COLUMNS, 1, u, v, w};
    pma_estimate_errors(&x, &steps, STEPS, e);
    CHECK_BITS(6, e, expected);
}

static void norms_are_weighted_by_masses_over_the_columns_that_are_read(void)
{
    double u[LEVELS * COLUMNS], v[LEVELS * COLUMNS], w[LEVELS * COLUMNS];
    const int64_t begin[STEPS] = {0, 2}, end[STEPS] = {1, 4}, levels[3] = {0, 1, 2};
    const pma_recorded_steps steps = {STEPS, begin, end, 1.0};
    const double mass[2] = {1.0, 4.0};
    double mean[2], distance[3];
    fill(u, v, w);
    u[1 * COLUMNS + 0] += 3.0; /* the first step is wrong by (3, 2), of size 5, in the time 1 */
    u[1 * COLUMNS + 2] += 2.0;
    u[1 * COLUMNS + 1] = u[2 * COLUMNS + 1] = NAN; /* not read */
    const pma_motion_rows x = {COLUMNS, 2, u, v, w};
    CHECK_INT(pma_motion_read(&x), 2);
    const pma_norms norms = pma_estimate_norms(&x, &steps, mass, mean);
    const double means[2] = {4.0, 12.0}; /* of (0, 8) and (0, 24) */
    CHECK_BITS(2, mean, means);
    CHECK(norms.rate == 2.5);
    CHECK(norms.motion == sqrt(4.0 * 4.0 + 4.0 * 12.0 * 12.0));
    CHECK(norms.speed == sqrt((12.0 * 12.0 + 4.0 * 36.0 * 36.0) / 2.0));
    CHECK(norms.acceleration == sqrt((12.0 * 12.0 + 4.0 * 36.0 * 36.0) / 2.0));
    pma_estimate_distance(&x, 3, levels, mass, mean, distance);
    CHECK(distance[0] == norms.motion && distance[2] == norms.motion);
    CHECK(distance[1] == sqrt(0.0 + 4.0 * 7.0 * 7.0)); /* from (4, 12) to (4, 5) */
}

const test ESTIMATE_TESTS[] = {
    TEST(a_cubic_motion_has_no_local_error_and_an_offset_is_one),
    TEST(norms_are_weighted_by_masses_over_the_columns_that_are_read),
    END_OF_TESTS,
};
