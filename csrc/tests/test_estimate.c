/* test_estimate.c - local errors of recorded steps, against hand calculation. */
#include "check.h"
#include "subdomain/scheme.h"
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
    const pma_motion_rows x = {COLUMNS, u, v, w};
    pma_estimate_errors(&x, &steps, e);
    CHECK_BITS(6, e, expected);
}

const test ESTIMATE_TESTS[] = {
    TEST(a_cubic_motion_has_no_local_error_and_an_offset_is_one),
    END_OF_TESTS,
};
