/* test_newton.c - Newton's method on scalar equations whose roots are known. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "check.h"
#include "naive.h"
#include "solve/newton.h"
#include "tests.h"

/* ---- a scalar equation f(x) = 0, and a diary of what was done ------------------------------- */

enum { MOST_CORRECTIONS = 64 };

typedef struct {
    double (*f)(double x);
    double (*slope)(double x);
    double x, first, K;              /* iterate; first guess; tangent that is factored */
    double motion, forces, rounding; /* |R| counts against the latter two */
    double leap;                     /* of all residuals */
    size_t fails_at;    /* evaluation that returns `status`, counted from 1; never for 0 */
    size_t singular_at; /* the same of corrections */
    pma_status status;

    double dx, R, K_new, s0, s1; /* slopes of the last correction at its beginning and its end */
    size_t evaluated, corrected, restarted, moved_back, remembered;
    bool fresh[MOST_CORRECTIONS];
    double e[MOST_CORRECTIONS];
} scalar;

static double part_of(const scalar *q)
{
    return fabs(q->R) <= q->rounding ? 0.0 : fabs(q->R) / q->forces;
}

static pma_status evaluate(void *ctx, bool tangent, pma_measure *measure)
{
    scalar *q = ctx;
    if (++q->evaluated == q->fails_at)
        return q->status;
    q->R = -q->f(q->x);
    if (tangent)
        q->K_new = q->slope(q->x);
    q->s1 = q->dx * q->R;
    *measure = (pma_measure){.slope = q->s1, .residual = part_of(q), .leap = q->leap};
    return isfinite(q->R) ? PMA_OK : PMA_NOT_FINITE;
}

/* No correction begins where the one before it went too far (N10), unless all that is left of f is
 * noise. */
static pma_status correct(void *ctx, bool fresh, pma_measure *measure)
{
    scalar *q = ctx;
    if (q->corrected + 1 == q->singular_at)
        return q->status;
    if (q->corrected >= 2 && q->restarted + q->moved_back == 0 && q->motion > 0.0)
        CHECK(!(q->s0 > 0.0 && q->s1 < -0.8 * q->s0));
    q->K = fresh ? q->K_new : q->K;
    q->dx = q->R / q->K;
    q->x += q->dx;
    q->s0 = q->dx * q->R;
    *measure = (pma_measure){.correction = fabs(q->s0), .motion = q->motion, .slope = q->s0};
    q->fresh[q->corrected] = fresh;
    q->e[q->corrected++] = sqrt(fabs(q->s0));
    return PMA_OK;
}

static void move(void *ctx, double by)
{
    scalar *q = ctx;
    q->x += by * q->dx;
    q->moved_back += by == -1.0;
}

static void restart(void *ctx)
{
    scalar *q = ctx;
    q->x = q->first;
    q->restarted++;
}

static void remember_rounding(void *ctx)
{
    scalar *q = ctx;
    q->remembered++;
}

static const pma_equations SCALAR = {evaluate, correct, move, restart, remember_rounding};
static const pma_newton FULL = {.tolerance = 1e-10, .iterations = 40};
static const pma_newton REUSE = {.tolerance = 1e-10, .iterations = 40, .reuse = true};

static scalar equation(double (*f)(double), double (*slope)(double), double first)
{
    return (scalar){
        .f = f, .slope = slope, .x = first, .first = first, .motion = 1.0, .forces = 1.0};
}

/* ---- f and its derivative ------------------------------------------------------------------- */

static double square(double x)
{
    return x * x - 2.0;
}

static double square_slope(double x)
{
    return 2.0 * x;
}

static double cubic(double x)
{
    return x * x * x + x - 10.0;
}

static double cubic_slope(double x)
{
    return 3.0 * x * x + 1.0;
}

static double growth(double x)
{
    return exp(x) - 5.0;
}

static double linear(double x)
{
    return 4.0 * x - 3.0;
}

static double linear_slope(double x)
{
    (void)x;
    return 4.0;
}

static double arc_slope(double x)
{
    return 1.0 / (1.0 + x * x);
}

static double short_arc(double x)
{
    return fabs(x) > 100.0 ? (double)NAN : atan(x);
}

static double reciprocal(double x)
{
    return 1.0 / x;
}

static double no_root(double x)
{
    return x * x + 1.0;
}

static double nowhere(double x)
{
    (void)x;
    return (double)NAN;
}

static double one(double x)
{
    (void)x;
    return 1.0;
}

/* It has no root, but changes its sign. */
static double leap(double x)
{
    return x + copysign(1.0, x);
}

/* ---- fresh tangents ------------------------------------------------------------------------- */

/* Corrections of a plain loop until the error is below the tolerance. */
static size_t plain_corrections(const scalar *q, double root)
{
    double x = q->first;
    size_t count = 0;
    for (; !(fabs(x - root) <= FULL.tolerance) && count < MOST_CORRECTIONS; count++)
        x -= q->f(x) / q->slope(x);
    return count;
}

static void newtons_method_converges_quadratically(void)
{
    const struct {
        scalar q;
        double root;
    } cases[5] = {{equation(square, square_slope, 1.0), sqrt(2.0)},
                  {equation(square, square_slope, -3.0), -sqrt(2.0)},
                  {equation(cubic, cubic_slope, 1.5), 2.0},
                  {equation(growth, exp, 1.0), log(5.0)},
                  {equation(linear, linear_slope, 7.0), 0.75}};
    for (size_t i = 0; i < 5; i++) {
        scalar q = cases[i].q;
        CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
        CHECK_NEAR(q.x, cases[i].root, 4.0 * EPS * fabs(cases[i].root));
        const size_t needed = plain_corrections(&q, cases[i].root);
        CHECK(q.corrected == needed || q.corrected == needed + 1); /* one may show the error */
        CHECK_INT(q.evaluated, q.corrected + 1);                   /* nothing is searched */
        for (size_t k = 0; k < q.corrected; k++)
            CHECK(q.fresh[k]);
    }
}

static void an_iterate_in_equilibrium_takes_one_correction(void)
{
    scalar q = equation(linear, linear_slope, 0.75);
    q.motion = 0.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_INT(q.corrected, 1);
    q = equation(linear, linear_slope, 0.75 + 1e-14); /* e = 2e-14, below 1e-3 tolerance s */
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_INT(q.corrected, 1);
    q = equation(linear, linear_slope, 0.75 + 1e-12); /* e = 2e-12, above it: R is zero */
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_INT(q.corrected, 1);
    CHECK_INT(q.evaluated, 2);
}

/* s is large, so that each correction is small: the residual decides, where the forces are small
 * too by one that is seen. */
static void a_residual_that_is_large_against_the_forces_is_not_accepted(void)
{
    scalar q = equation(square, square_slope, 1.5);
    q.motion = INFINITY;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_NEAR(q.x, sqrt(2.0), 1e-10);
    q = equation(square, square_slope, 1.5);
    q.motion = INFINITY;
    q.forces = 1e-5; /* times the tolerance: 1e-15 */
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_NEAR(q.x, sqrt(2.0), 4.0 * EPS);
}

/* A jump where the slope above it leads. */
static double jump(double x)
{
    return x > 0.0 ? x : x - 2.0;
}

static void behind_a_jump_no_iterate_is_accepted_before_it_one_in_balance(void)
{
    scalar q = equation(jump, one, 0.9e-10); /* below the tolerance, and 2 after one correction */
    q.motion = INFINITY;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK(q.x > 0.0 && q.x < 0.9e-10);
}

/* Newton's method alone diverges on atan from beyond 1.39, and leaps out of its domain. */
static void corrections_that_overshoot_are_shortened(void)
{
    scalar arc = equation(atan, arc_slope, 3.0);
    CHECK_INT(plain_corrections(&arc, 0.0), MOST_CORRECTIONS);
    for (double first = 3.0; first > 1.4; first -= 0.2) {
        scalar q = equation(atan, arc_slope, first);
        CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
        CHECK_NEAR(q.x, 0.0, 1e-10);
        CHECK(q.evaluated > q.corrected);
    }
    scalar q = equation(short_arc, arc_slope, 3.0);
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_NEAR(q.x, 0.0, 1e-10);
}

/* ---- tangents that are kept ----------------------------------------------------------------- */

/* A tangent is fresh where there is none, and where the corrections fell by less than 0.2. */
static void check_kept(scalar q, bool has_factor, double root, size_t expected)
{
    size_t tangents = 0;
    CHECK_STATUS(pma_newton_solve(&REUSE, &SCALAR, &q, has_factor), PMA_OK);
    CHECK_NEAR(q.x, root, 1e-9);
    CHECK_INT(q.restarted + q.moved_back, 0);
    for (size_t k = 0; k < q.corrected; k++) {
        const bool slow = k >= 2 && q.e[k - 1] > 0.2 * q.e[k - 2];
        CHECK_INT(q.fresh[k], slow || (k == 0 && !has_factor));
        tangents += q.fresh[k];
    }
    CHECK_INT(tangents, expected);
}

static void a_tangent_is_kept_until_corrections_fall_slowly(void)
{
    scalar known = equation(linear, linear_slope, 7.0);
    check_kept(known, false, 0.75, 1);
    known.K = 4.0;
    check_kept(known, true, 0.75, 0);
    known.K = 4.5; /* an error falls to 1/9 */
    check_kept(known, true, 0.75, 0);
    known.K = 6.0; /* to 1/3: the third correction is with the true tangent, which leaves nothing */
    check_kept(known, true, 0.75, 1);
    check_kept(equation(square, square_slope, 1.5), false, sqrt(2.0), 1);
}

/* With K = 0.3 k the error grows by 7/3, which the second correction shows. */
static void corrections_with_a_kept_tangent_that_grow_begin_again(void)
{
    scalar q = equation(linear, linear_slope, 7.0);
    q.K = 1.2;
    CHECK_STATUS(pma_newton_solve(&REUSE, &SCALAR, &q, true), PMA_OK);
    CHECK_NEAR(q.x, 0.75, 1e-15);
    CHECK_INT(q.restarted, 1);
    CHECK_INT(q.corrected, 3); /* two, and one from the first guess, which leaves nothing */
    CHECK(!q.fresh[0] && !q.fresh[1] && q.fresh[2]);
}

/* With K = 0.54 k the error changes its sign and falls to 0.85: above the limit of the slope. */
static void a_correction_with_a_kept_tangent_that_overshoots_is_taken_back(void)
{
    scalar q = equation(linear, linear_slope, 7.0);
    q.K = 0.54 * 4.0;
    CHECK_STATUS(pma_newton_solve(&REUSE, &SCALAR, &q, true), PMA_OK);
    CHECK_NEAR(q.x, 0.75, 1e-15);
    CHECK_INT(q.moved_back, 1);
    CHECK_INT(q.restarted, 0);
    CHECK_INT(q.corrected, 3);
    CHECK(!q.fresh[0] && !q.fresh[1] && q.fresh[2]);
}

/* ---- what does not go well ------------------------------------------------------------------ */

static void values_that_are_not_finite_are_reported(void)
{
    scalar q = equation(nowhere, linear_slope, 1.0);
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_FINITE);
    CHECK_INT(q.corrected, 0);
    q = equation(log, reciprocal, 3.0); /* the first correction leads to 3 - 3 log 3 < 0 */
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_CONVERGED);
    CHECK_INT(q.corrected, 1);
    q = equation(log, reciprocal, 3.0);
    q.K = 0.125; /* far too soft: out of the domain, and again with the true tangent */
    CHECK_STATUS(pma_newton_solve(&REUSE, &SCALAR, &q, true), PMA_NOT_CONVERGED);
    CHECK_INT(q.restarted, 1);
    CHECK_INT(q.corrected, 2);
    q = equation(log, reciprocal, 2.0); /* 2 - 2 log 2 > 0: the true tangent stays inside */
    q.K = 0.125;
    CHECK_STATUS(pma_newton_solve(&REUSE, &SCALAR, &q, true), PMA_OK);
    CHECK_NEAR(q.x, 1.0, 4.0 * EPS);
    CHECK_INT(q.restarted, 1);
}

static void an_equation_without_a_root_is_not_converged(void)
{
    for (size_t most = 0; most <= 40; most += 8) {
        const pma_newton newton = {.tolerance = 1e-10, .iterations = most};
        scalar q = equation(no_root, square_slope, 1.5);
        CHECK_STATUS(pma_newton_solve(&newton, &SCALAR, &q, false), PMA_NOT_CONVERGED);
        CHECK_INT(q.corrected, most);
    }
}

/* Wherever it happens, in a search too. */
static void what_an_operation_comes_back_with_is_returned(void)
{
    const pma_newton *const newtons[2] = {&FULL, &REUSE};
    for (size_t i = 0; i < 2; i++) {
        scalar whole = equation(atan, arc_slope, 3.0);
        CHECK_STATUS(pma_newton_solve(newtons[i], &SCALAR, &whole, false), PMA_OK);
        for (size_t k = 1; k <= whole.evaluated; k++) {
            scalar q = equation(atan, arc_slope, 3.0);
            q.fails_at = k;
            q.status = PMA_RESTORING_FAILED;
            CHECK_STATUS(pma_newton_solve(newtons[i], &SCALAR, &q, false), PMA_RESTORING_FAILED);
            CHECK_INT(q.evaluated, k);
        }
        for (size_t k = 1; k <= whole.corrected; k++) {
            scalar q = equation(atan, arc_slope, 3.0);
            q.singular_at = k;
            q.status = PMA_SINGULAR;
            CHECK_STATUS(pma_newton_solve(newtons[i], &SCALAR, &q, false), PMA_SINGULAR);
            CHECK_INT(q.corrected, k - 1);
        }
    }
}

/* ---- corrections that are rounding ---------------------------------------------------------- */

/* x - 1/3 up to multiples of 2^-26, which is never zero: corrections do not fall below 2^-27. */
static double noisy(double x)
{
    const volatile double shifted = x + 0x1p26;
    return (shifted - 0x1p26) - 1.0 / 3.0;
}

static double far_too_stiff(double x)
{
    (void)x;
    return 4000.0;
}

static void corrections_that_are_rounding_are_accepted_in_the_end(void)
{
    scalar q = equation(noisy, one, 1.0);
    q.motion = 0.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_NEAR(q.x, 1.0 / 3.0, 0x1p-26);
    CHECK_INT(q.corrected, FULL.iterations);
    CHECK_INT(q.remembered, 1); /* so that the next steps need one or two */
}

/* As where constraints hold what jumps: no residual is in proportion to the corrections. */
static void corrections_that_leave_a_much_larger_residual_than_before_are_not(void)
{
    scalar q = equation(noisy, one, 1.0);
    q.motion = 0.0;
    q.leap = 1001.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_CONVERGED);
    CHECK_INT(q.remembered, 0);
    q = equation(noisy, one, 1.0);
    q.motion = 0.0;
    q.leap = 999.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
}

static void they_are_accepted_at_once_where_the_residual_is_rounding_by_rows(void)
{
    scalar q = equation(noisy, one, 1.0);
    q.motion = 0.0;
    q.rounding = 0x1p-26;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_OK);
    CHECK_NEAR(q.x, 1.0 / 3.0, 0x1p-26);
    CHECK(q.corrected <= 2); /* to the noise */
    CHECK_INT(q.remembered, 0);
    /* not where the residual is more than rounding */
    q = equation(leap, one, -1.0);
    q.motion = 0.0;
    q.rounding = 0.999;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_CONVERGED);
}

/* A wrong tangent departs from the slope over large multiples of a correction too; one that goes to
 * and fro over a leap does not depart from it over a small part. */
static void other_corrections_that_do_not_fall_are_not(void)
{
    scalar q = equation(linear, far_too_stiff, 7.0);
    q.motion = 0.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_CONVERGED);
    q = equation(leap, one, -1.0);
    q.motion = 0.0;
    CHECK_STATUS(pma_newton_solve(&FULL, &SCALAR, &q, false), PMA_NOT_CONVERGED);
}

const test NEWTON_TESTS[] = {
    TEST(newtons_method_converges_quadratically),
    TEST(an_iterate_in_equilibrium_takes_one_correction),
    TEST(a_residual_that_is_large_against_the_forces_is_not_accepted),
    TEST(behind_a_jump_no_iterate_is_accepted_before_it_one_in_balance),
    TEST(corrections_that_overshoot_are_shortened),
    TEST(a_tangent_is_kept_until_corrections_fall_slowly),
    TEST(corrections_with_a_kept_tangent_that_grow_begin_again),
    TEST(a_correction_with_a_kept_tangent_that_overshoots_is_taken_back),
    TEST(values_that_are_not_finite_are_reported),
    TEST(an_equation_without_a_root_is_not_converged),
    TEST(what_an_operation_comes_back_with_is_returned),
    TEST(corrections_that_are_rounding_are_accepted_in_the_end),
    TEST(corrections_that_leave_a_much_larger_residual_than_before_are_not),
    TEST(they_are_accepted_at_once_where_the_residual_is_rounding_by_rows),
    TEST(other_corrections_that_do_not_fall_are_not),
    END_OF_TESTS,
};
