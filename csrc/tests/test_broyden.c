/* test_broyden.c - an inverse that learns: exact where it has learned everything. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "naive.h"
#include "solve/broyden.h"
#include "tests.h"

enum { FEW = 6, DENSE = PMA_BROYDEN_DENSE, MANY = PMA_BROYDEN_DENSE + 1, RANK = 4 };

/* ---- a diagonal matrix as the inverse that is known ------------------------------------------ */

typedef struct {
    size_t p;
    double inverse[MANY];
} diagonal;

static pma_interface known_inverse(const diagonal *d)
{
    const pma_factor D = {.form = PMA_DIAGONAL, .n = d->p, .nb = d->p, .inverse = d->inverse};
    return (pma_interface){.factor = D, .p = d->p, .entries = d->p};
}

/* A (p*p) = D + sum_k a_k b_k^T of rank RANK, D the diagonal */
typedef struct {
    diagonal D;
    double a[RANK][MANY], b[RANK][MANY];
} nearly_diagonal;

static void draw_matrix(nearly_diagonal *A, size_t p, uint64_t *seed)
{
    A->D.p = p;
    for (size_t i = 0; i < p; i++) {
        A->D.inverse[i] = 1.0 / (1.0 + draw(seed, 4));
        for (size_t k = 0; k < RANK; k++) {
            A->a[k][i] = draw_eighth(seed) / sqrt((double)p);
            A->b[k][i] = draw_eighth(seed) / sqrt((double)p);
        }
    }
}

static void multiply(const nearly_diagonal *A, const double *x, double *y)
{
    for (size_t i = 0; i < A->D.p; i++)
        y[i] = x[i] / A->D.inverse[i];
    for (size_t k = 0; k < RANK; k++) {
        double share = 0.0;
        for (size_t i = 0; i < A->D.p; i++)
            share += A->b[k][i] * x[i];
        for (size_t i = 0; i < A->D.p; i++)
            y[i] += A->a[k][i] * share;
    }
}

static double norm(size_t n, const double *x)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += x[i] * x[i];
    return sqrt(sum);
}

/* ---- what it has learned --------------------------------------------------------------------- */

/* With its state in memory of just the size that is required. */
static pma_broyden take(const pma_interface *start)
{
    const pma_broyden b = {.p = start->p,
                           .start = start,
                           .state = malloc(pma_broyden_size(start->p) * sizeof(double))};
    double scratch[MANY];
    pma_broyden_begin(&b, scratch);
    return b;
}

static void at_first_it_is_the_inverse_that_is_known(void)
{
    static diagonal d;
    const size_t sizes[4] = {1, FEW, DENSE, MANY};
    uint64_t seed = 51;
    for (size_t k = 0; k < 4; k++) {
        double r[MANY], x[MANY];
        d.p = sizes[k];
        draw_vector(d.p, &seed, d.inverse);
        draw_vector(d.p, &seed, r);
        const pma_interface start = known_inverse(&d);
        pma_broyden b = take(&start);
        pma_broyden_apply(&b, r, x);
        for (size_t i = 0; i < d.p; i++)
            CHECK(x[i] == r[i] * d.inverse[i]);
        free(b.state);
    }
}

/* Each change s = e_k has shown a column of A; changes that are orthogonal do not disturb what was
 * learned before. Then B = A^-1. Entries of order one, and a condition below 100. */
static void after_p_orthogonal_changes_it_is_the_inverse(void)
{
    static nearly_diagonal A;
    uint64_t seed = 52;
    for (size_t p = 1; p <= FEW; p++) {
        double s[FEW], y[FEW], x[FEW], scratch[3 * FEW];
        draw_matrix(&A, p, &seed);
        const pma_interface start = known_inverse(&A.D);
        pma_broyden b = take(&start);
        for (size_t k = 0; k < p; k++) {
            memset(s, 0, sizeof s);
            s[k] = 0.5;
            multiply(&A, s, y);
            pma_broyden_learn(&b, s, y, scratch);
        }
        draw_vector(p, &seed, s);
        multiply(&A, s, y);
        pma_broyden_apply(&b, y, x);
        for (size_t i = 0; i < p; i++)
            CHECK_NEAR(x[i], s[i], 1e3 * EPS);
        free(b.state);
    }
}

/* However many it has learned, and whatever of that was forgotten. */
static void it_explains_the_last_change(void)
{
    static nearly_diagonal A;
    const size_t sizes[3] = {FEW, DENSE, MANY};
    uint64_t seed = 53;
    for (size_t k = 0; k < 3; k++) {
        static double s[MANY], y[MANY], x[MANY], scratch[3 * MANY];
        const size_t p = sizes[k];
        draw_matrix(&A, p, &seed);
        const pma_interface start = known_inverse(&A.D);
        pma_broyden b = take(&start);
        for (size_t count = 0; count < PMA_BROYDEN_KEPT + 5; count++) {
            for (size_t i = 0; i < p; i++)
                s[i] = draw_eighth(&seed);
            multiply(&A, s, y);
            pma_broyden_learn(&b, s, y, scratch);
            pma_broyden_apply(&b, y, x);
            for (size_t i = 0; i < p; i++)
                CHECK_NEAR(x[i], s[i], 1e5 * EPS); /* of up to 35 corrections, 100 each */
        }
        free(b.state);
    }
}

/* A change of which B says nothing: it stays what it was. */
static void a_change_that_says_nothing_is_left_out(void)
{
    static nearly_diagonal A;
    const size_t sizes[2] = {FEW, MANY};
    uint64_t seed = 54;
    for (size_t k = 0; k < 2; k++) {
        static double s[MANY], y[MANY], before[MANY], after[MANY], r[MANY], scratch[3 * MANY];
        const size_t p = sizes[k];
        draw_matrix(&A, p, &seed);
        const pma_interface start = known_inverse(&A.D);
        pma_broyden b = take(&start);
        draw_vector(p, &seed, r);
        pma_broyden_apply(&b, r, before);
        memset(s, 0, sizeof s);
        memset(y, 0, sizeof y);
        pma_broyden_learn(&b, s, y, scratch); /* nothing has moved */
        s[0] = y[1] = 1.0;
        pma_broyden_learn(&b, s, y, scratch); /* s . B y = 0 */
        y[0] = INFINITY;
        pma_broyden_learn(&b, s, y, scratch);
        y[0] = NAN;
        pma_broyden_learn(&b, s, y, scratch);
        pma_broyden_apply(&b, r, after);
        CHECK_BITS(p, after, before);
        free(b.state);
    }
}

/* ---- it solves ------------------------------------------------------------------------------- */

/* Iterations of x += -B (A x - c) until |A x - c| is 1e-12 of |c|. */
static size_t iterate(const nearly_diagonal *A, const pma_broyden *b, const double *c, double *x)
{
    static double r[MANY], before[MANY], s[MANY], scratch[3 * MANY];
    const size_t p = A->D.p;
    memset(x, 0, p * sizeof(double));
    for (size_t count = 0; count < 100; count++) {
        multiply(A, x, r);
        for (size_t i = 0; i < p; i++)
            r[i] -= c[i];
        if (norm(p, r) <= 1e-12 * norm(p, c))
            return count;
        for (size_t i = 0; count > 0 && i < p; i++)
            before[i] = r[i] - before[i];
        if (count > 0)
            pma_broyden_learn(b, s, before, scratch);
        memcpy(before, r, p * sizeof(double));
        pma_broyden_apply(b, r, s);
        for (size_t i = 0; i < p; i++) {
            s[i] = -s[i];
            x[i] += s[i];
        }
    }
    return 100;
}

/* Broyden's method ends after 2 p steps, where the matrix departs from the known one by rank r
 * after 2 r (Gay, SIAM J. Numer. Anal. 16, 1979); one more for rounding. */
static void linear_equations_are_solved_in_twice_the_rank_steps(void)
{
    static nearly_diagonal A;
    static double c[MANY], x[MANY], again[MANY];
    const size_t sizes[3] = {3 * FEW, DENSE, MANY};
    uint64_t seed = 55;
    for (size_t k = 0; k < 3; k++) {
        draw_matrix(&A, sizes[k], &seed);
        draw_vector(sizes[k], &seed, c);
        const pma_interface start = known_inverse(&A.D);
        pma_broyden b = take(&start);
        const size_t count = iterate(&A, &b, c, x);
        CHECK(count > 2 && count <= 2 * RANK + 1);
        CHECK(iterate(&A, &b, c, again) < count); /* what was learned is kept */
        free(b.state);
    }
}

/* The same equations with one more that is solved already: from a matrix to limited memory. */
static void a_matrix_and_limited_memory_do_the_same(void)
{
    static nearly_diagonal A;
    static double c[MANY], x[MANY], y[MANY];
    uint64_t seed = 56;
    draw_matrix(&A, DENSE, &seed);
    draw_vector(DENSE, &seed, c);
    pma_interface start = known_inverse(&A.D);
    pma_broyden b = take(&start);
    const size_t count = iterate(&A, &b, c, x);
    free(b.state);
    A.D.p = MANY;
    A.D.inverse[DENSE] = 1.0;
    c[DENSE] = 0.0;
    for (size_t k = 0; k < RANK; k++)
        A.a[k][DENSE] = A.b[k][DENSE] = 0.0;
    start = known_inverse(&A.D);
    b = take(&start);
    CHECK_INT(iterate(&A, &b, c, y), count);
    for (size_t i = 0; i < DENSE; i++)
        CHECK_NEAR(y[i], x[i], 1e-11); /* both are 1e-12 from the solution, of order one */
    free(b.state);
}

const test BROYDEN_TESTS[] = {
    TEST(at_first_it_is_the_inverse_that_is_known),
    TEST(after_p_orthogonal_changes_it_is_the_inverse),
    TEST(it_explains_the_last_change),
    TEST(a_change_that_says_nothing_is_left_out),
    TEST(linear_equations_are_solved_in_twice_the_rank_steps),
    TEST(a_matrix_and_limited_memory_do_the_same),
    END_OF_TESTS,
};
