/* test_scheme.c - the constants of a step, against the textbook and hand calculation. */
#include <stddef.h>
#include <stdint.h>

#include "check.h"
#include "models.h"
#include "naive.h"
#include "subdomain/scheme.h"
#include "tests.h"

/* Coefficients are sums of a few products of numbers of order one. */
static void check_step(const pma_step *actual, const pma_step *expected)
{
    const double tolerance = 8.0 * EPS;
    CHECK_NEAR(actual->h, expected->h, 0.0);
    CHECK_NEAR(actual->al1, expected->al1, tolerance);
    CHECK_NEAR(actual->al2, expected->al2, tolerance);
    CHECK_NEAR(actual->u_a, expected->u_a, tolerance);
    CHECK_NEAR(actual->u_w, expected->u_w, tolerance);
    CHECK_NEAR(actual->v_a, expected->v_a, tolerance);
    CHECK_NEAR(actual->v_w, expected->v_w, tolerance);
    CHECK_NEAR(actual->a_a, expected->a_a, tolerance);
    CHECK_NEAR(actual->a_w, expected->a_w, tolerance);
    CHECK_NEAR(actual->a_w1, expected->a_w1, tolerance);
}

/* u1 = u + h v + h^2/4 (a + a1), v1 = v + h/2 (a + a1), a1 = w1 */
static void the_trapezoidal_rule_has_the_constants_of_the_textbook(void)
{
    const double h = 0.3;
    const pma_step expected = {.h = h,
                               .al1 = h * h / 4.0,
                               .al2 = h / 2.0,
                               .u_a = h * h / 4.0,
                               .v_a = h / 2.0,
                               .a_w1 = 1.0};
    const pma_step actual = pma_step_make(TRAPEZOIDAL, h);
    check_step(&actual, &expected);
}

/* u1 = u + h v + h^2/2 a, v1 = v + h/2 (a + a1), a1 = w1 */
static void the_central_difference_has_the_constants_of_the_textbook(void)
{
    const double h = 0.3;
    const pma_step expected = {
        .h = h, .al2 = h / 2.0, .u_a = h * h / 2.0, .v_a = h / 2.0, .a_w1 = 1.0};
    const pma_step actual = pma_step_make(CENTRAL_DIFFERENCE, h);
    check_step(&actual, &expected);
}

/* By hand, h = 1.  rho = 1/2: am = 0, af = 1/3, gamma = 5/6, beta = 4/9.  rho = 0: am = -1, af = 0,
 * gamma = 3/2, beta = 1.  rho = 1: am = af = gamma = 1/2, beta = 1/4. */
static void generalized_alpha_has_the_constants_found_by_hand(void)
{
    const double rho[3] = {0.5, 0.0, 1.0};
    const pma_step by_hand[3] = {{1.0, 8.0 / 27.0, 5.0 / 9.0, 1.0 / 18.0, 4.0 / 27.0, 1.0 / 6.0,
                                  5.0 / 18.0, 0.0, 1.0 / 3.0, 2.0 / 3.0},
                                 {1.0, 0.5, 0.75, 0.0, 0.0, 0.25, 0.0, 0.5, 0.0, 0.5},
                                 {1.0, 0.25, 0.5, 0.0, 0.25, 0.0, 0.5, -1.0, 1.0, 1.0}};
    for (size_t i = 0; i < 3; i++) {
        const pma_step actual = pma_step_make(generalized_alpha(rho[i]), 1.0);
        check_step(&actual, &by_hand[i]);
    }
}

/* a = w = w1 = c: u1 = u + h v + h^2 c/2, v1 = v + h c, a1 = c, whatever the four parameters */
static void every_scheme_is_exact_for_a_constant_acceleration(void)
{
    uint64_t seed = 1;
    for (size_t i = 0; i < 50; i++) {
        const pma_scheme s = {draw_eighth(&seed) / 2.0, draw_eighth(&seed) / 2.0,
                              draw_eighth(&seed), draw_eighth(&seed)};
        const double h = 0.1 + 0.01 * (double)i;
        const pma_step c = pma_step_make(s, h);
        /* sums of three terms, each below 4 h^2, 4 h and 4 */
        CHECK_NEAR(c.al1 + c.u_a + c.u_w, h * h / 2.0, 32.0 * EPS * h * h);
        CHECK_NEAR(c.al2 + c.v_a + c.v_w, h, 32.0 * EPS * h);
        CHECK_NEAR(c.a_a + c.a_w + c.a_w1, 1.0, 32.0 * EPS);
    }
}

const test SCHEME_TESTS[] = {
    TEST(the_trapezoidal_rule_has_the_constants_of_the_textbook),
    TEST(the_central_difference_has_the_constants_of_the_textbook),
    TEST(generalized_alpha_has_the_constants_found_by_hand),
    TEST(every_scheme_is_exact_for_a_constant_acceleration),
    END_OF_TESTS,
};
