/* test_core.c - the core alone, against hand calculation, closed forms and a naive second program.
 *
 * Every test is a function whose name is the sentence it checks. Nothing here calls the core to
 * find out what to expect of it: matrices are multiplied and solved by the loops of this file. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "coupler.h"
#include "factor.h"
#include "link.h"
#include "load.h"
#include "matrix.h"
#include "record.h"
#include "scheme.h"
#include "status.h"
#include "subdomain.h"
#include "symbolic.h"

static const double EPS = DBL_EPSILON;
static const double PI = 3.14159265358979323846;

/* ---- random numbers that are the same everywhere ------------------------------------------- */

/* Knuth's 64-bit linear congruence; the high bits are the good ones. */
static uint32_t draw(uint64_t *seed, uint32_t below)
{
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*seed >> 33) % below;
}

/* A multiple of 1/8 in [-1, 1]: sums of a few products of these are exact. */
static double draw_eighth(uint64_t *seed)
{
    return ((double)draw(seed, 17) - 8.0) / 8.0;
}

/* ---- naive algebra -------------------------------------------------------------------------- */

enum { LARGEST = 16 }; /* unknowns of naive_solve */

/* b (n) := A^-1 b by Gaussian elimination with row exchanges, A (n*n) by rows */
static void naive_solve(size_t n, const double *A, double *b)
{
    double T[LARGEST][LARGEST + 1];
    for (size_t i = 0; i < n; i++) {
        memcpy(T[i], A + i * n, n * sizeof(double));
        T[i][n] = b[i];
    }
    for (size_t j = 0; j < n; j++) {
        size_t best = j;
        for (size_t i = j + 1; i < n; i++)
            best = fabs(T[i][j]) > fabs(T[best][j]) ? i : best;
        for (size_t k = 0; k <= n; k++) {
            const double kept = T[j][k];
            T[j][k] = T[best][k];
            T[best][k] = kept;
        }
        for (size_t i = j + 1; i < n; i++) {
            const double factor = T[i][j] / T[j][j];
            for (size_t k = j; k <= n; k++)
                T[i][k] -= factor * T[j][k];
        }
    }
    for (size_t j = n; j-- > 0;) {
        b[j] = T[j][n];
        for (size_t k = j + 1; k < n; k++)
            b[j] -= T[j][k] * b[k];
        b[j] /= T[j][j];
    }
}

/* A (n*n) = R D R^T; R by columns, the reciprocals of D */
static void naive_factor(size_t n, const double *A, double *R, double *inverse)
{
    double T[LARGEST * LARGEST];
    memcpy(T, A, n * n * sizeof(double));
    for (size_t j = 0; j < n; j++) {
        inverse[j] = 1.0 / T[j * n + j];
        for (size_t i = 0; i < n; i++)
            R[j * n + i] = i < j ? 0.0 : T[i * n + j] * inverse[j];
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = j + 1; k < n; k++)
                T[i * n + k] -= R[j * n + i] * T[j * n + k];
        }
    }
}

/* ---- status --------------------------------------------------------------------------------- */

static void every_status_has_a_text_of_its_own(void)
{
    for (int i = PMA_OK; i <= PMA_STOPPED; i++) {
        CHECK(strlen(pma_status_text((pma_status)i)) > 0);
        for (int j = PMA_OK; j < i; j++)
            CHECK(strcmp(pma_status_text((pma_status)i), pma_status_text((pma_status)j)) != 0);
    }
    CHECK_INT(PMA_OK, 0);
    CHECK(strcmp(pma_status_text(PMA_OK), "no error") == 0);
    CHECK(strcmp(pma_status_text(PMA_STOPPED), "stopped by the caller") == 0);
}

static void an_unknown_status_has_a_text_too(void)
{
    CHECK(pma_status_text((pma_status)(PMA_STOPPED + 1)) != NULL);
    CHECK(pma_status_text((pma_status)1000) != NULL);
}

/* ---- schemes -------------------------------------------------------------------------------- */

static const pma_scheme TRAPEZOIDAL = {.beta = 0.25, .gamma = 0.5};
static const pma_scheme CENTRAL_DIFFERENCE = {.beta = 0.0, .gamma = 0.5};

/* am = (2 rho - 1)/(rho + 1), af = rho/(rho + 1), gamma = 1/2 - am + af, beta = (1/2 + gamma)^2/4 */
static pma_scheme generalized_alpha(double rho)
{
    pma_scheme s = {.am = (2.0 * rho - 1.0) / (rho + 1.0), .af = rho / (rho + 1.0)};
    s.gamma = 0.5 - s.am + s.af;
    s.beta = (0.5 + s.gamma) * (0.5 + s.gamma) / 4.0;
    return s;
}

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

/* ---- matrices ------------------------------------------------------------------------------- */

enum { SIZE = 9 }; /* two full lanes of four and one more, where a loop is vectorised */

/* The rows of a dense matrix without its zeros. */
typedef struct {
    int64_t ptr[SIZE + 1];
    int32_t index[SIZE * SIZE];
    double values[SIZE * SIZE];
} compressed;

static compressed compress(size_t n, const double *rows)
{
    compressed s = {.ptr = {0}};
    int64_t k = 0;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            if (rows[i * n + j] == 0.0)
                continue;
            s.index[k] = (int32_t)j;
            s.values[k++] = rows[i * n + j];
        }
        s.ptr[i + 1] = k;
    }
    return s;
}

/* Small multiples of 1/8 everywhere: no rounding, so equality is asked for. */
static void check_subtract(const pma_matrix *A, const double *rows)
{
    double x[SIZE], y[SIZE], expected[SIZE];
    for (size_t i = 0; i < A->n; i++) {
        x[i] = 1.0 + (double)i;
        y[i] = expected[i] = 100.0 - (double)i;
    }
    for (size_t i = 0; i < A->n; i++) {
        for (size_t j = 0; j < A->n; j++)
            expected[i] -= rows[i * A->n + j] * x[j];
    }
    CHECK_STATUS(pma_matrix_check(A), PMA_OK);
    pma_matrix_subtract(A, x, y);
    CHECK_BITS(A->n, y, expected);
}

static void draw_symmetric(size_t n, uint64_t *seed, double *rows)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++)
            rows[i * n + j] = rows[j * n + i] = draw(seed, 2) ? draw_eighth(seed) : 0.0;
    }
}

static void all_forms_of_a_matrix_multiply_like_two_loops(void)
{
    uint64_t seed = 2;
    for (size_t n = 1; n <= SIZE; n++) {
        double rows[SIZE * SIZE], diagonal[SIZE], spread[SIZE * SIZE] = {0.0};
        draw_symmetric(n, &seed, rows);
        const compressed s = compress(n, rows);
        check_subtract(&(pma_matrix){PMA_DENSE, n, rows, NULL, NULL}, rows);
        check_subtract(&(pma_matrix){PMA_SPARSE, n, s.values, s.ptr, s.index}, rows);

        for (size_t i = 0; i < n; i++)
            diagonal[i] = spread[i * n + i] = draw_eighth(&seed);
        check_subtract(&(pma_matrix){PMA_DIAGONAL, n, diagonal, NULL, NULL}, spread);

        memset(spread, 0, sizeof spread);
        check_subtract(&(pma_matrix){PMA_ZERO, n, NULL, NULL, NULL}, spread);
    }
}

static void a_product_reads_as_many_entries_as_are_stored(void)
{
    const double values[9] = {0.0};
    const int64_t ptr[4] = {0, 2, 2, 5};
    const int32_t index[5] = {0, 2, 0, 1, 2};
    CHECK_INT(pma_matrix_entries(&(pma_matrix){PMA_ZERO, 3, NULL, NULL, NULL}), 0);
    CHECK_INT(pma_matrix_entries(&(pma_matrix){PMA_DIAGONAL, 3, values, NULL, NULL}), 3);
    CHECK_INT(pma_matrix_entries(&(pma_matrix){PMA_DENSE, 3, values, NULL, NULL}), 9);
    CHECK_INT(pma_matrix_entries(&(pma_matrix){PMA_SPARSE, 3, values, ptr, index}), 5);
}

static pma_status matrix_status(const int64_t *ptr, const int32_t *index)
{
    const double values[4] = {0.0};
    return pma_matrix_check(&(pma_matrix){PMA_SPARSE, 3, values, ptr, index});
}

static void a_matrix_with_a_bad_index_is_refused(void)
{
    const int64_t ptr[4] = {0, 1, 1, 4};
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){2, 0, 1, 2}), PMA_OK);
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){2, 2, 1, 0}), PMA_OK); /* in any order */
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){3, 0, 1, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){2, 0, 1, 3}), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){-1, 0, 1, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status(ptr, (int32_t[]){2, 0, 1, INT32_MIN}), PMA_BAD_INDEX);
    const int32_t index[4] = {0, 1, 2, 0};
    CHECK_STATUS(matrix_status((int64_t[]){0, 0, 0, 0}, index), PMA_OK);
    CHECK_STATUS(matrix_status((int64_t[]){1, 1, 1, 4}, index), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status((int64_t[]){-1, 1, 1, 4}, index), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status((int64_t[]){0, 2, 1, 4}, index), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status((int64_t[]){0, 1, 2, 1}, index), PMA_BAD_INDEX);
    CHECK_STATUS(matrix_status((int64_t[]){0, -1, 2, 3}, index), PMA_BAD_INDEX);
}

/* ---- factors -------------------------------------------------------------------------------- */

/* A = R D R^T, made from R and D, so that nothing is ever factored. */
typedef struct {
    size_t n;
    double R[SIZE * SIZE], D[SIZE]; /* R by rows */
    double inverse[SIZE];           /* as the core wants it */
    double columns[SIZE * SIZE];    /* R; NaN on and above the diagonal, where nothing is read */
    compressed sparse;
} triple;

/* R in eighths and D powers of two: products of them are exact */
static triple make_triple(size_t n, double density, uint64_t *seed)
{
    triple t = {.n = n};
    double below[SIZE * SIZE] = {0.0}; /* column j of R below the diagonal, as a row */
    for (size_t j = 0; j < n; j++) {
        t.D[j] = ldexp(1.0, (int)draw(seed, 5) - 2);
        t.inverse[j] = 1.0 / t.D[j];
        for (size_t i = 0; i < n; i++) {
            if (i > j && draw(seed, 1000) < 1000.0 * density)
                below[j * n + i] = draw_eighth(seed);
            t.R[i * n + j] = i == j ? 1.0 : below[j * n + i];
            t.columns[j * n + i] = i > j ? below[j * n + i] : (double)NAN;
        }
    }
    t.sparse = compress(n, below);
    return t;
}

static pma_factor dense_factor(const triple *t, size_t nb)
{
    return (pma_factor){PMA_DENSE, t->n, nb, t->inverse, t->columns, NULL, NULL};
}

static pma_factor sparse_factor(const triple *t, size_t nb)
{
    const compressed *s = &t->sparse;
    return (pma_factor){PMA_SPARSE, t->n, nb, t->inverse, s->values, s->ptr, s->index};
}

static pma_factor diagonal_factor(const triple *t, size_t nb)
{
    return (pma_factor){PMA_DIAGONAL, t->n, nb, t->inverse, NULL, NULL, NULL};
}

/* A (n*n) := R D R^T and size := |R| |D| |R^T| for the unknowns from `first` on: from 0 on it is
 * the matrix itself, from n - nb on the Schur complement S (F3) */
static void multiply_out(const triple *t, size_t first, double *A, double *size)
{
    const size_t n = t->n;
    for (size_t i = first; i < n; i++) {
        for (size_t j = first; j < n; j++) {
            double sum = 0.0, sum_of_sizes = 0.0;
            for (size_t k = first; k < n; k++) {
                const double term = t->R[i * n + k] * t->D[k] * t->R[j * n + k];
                sum += term;
                sum_of_sizes += fabs(term);
            }
            *A++ = sum;
            *size++ = sum_of_sizes;
        }
    }
}

/* Two triangular solves leave |b - A x| <= 2 n eps |R| |D| |R^T| |x|, entry by entry; as much again
 * for the rounding of this loop. */
static void check_residual(const triple *t, size_t first, const double *x, const double *b)
{
    double A[SIZE * SIZE], size[SIZE * SIZE];
    const size_t n = t->n - first;
    multiply_out(t, first, A, size);
    for (size_t i = 0; i < n; i++) {
        double residual = b[i], scale = 0.0;
        for (size_t j = 0; j < n; j++) {
            residual -= A[i * n + j] * x[j];
            scale += size[i * n + j] * fabs(x[j]);
        }
        CHECK_NEAR(residual, 0.0, 4.0 * (double)n * EPS * scale);
    }
}

static void draw_vector(size_t n, uint64_t *seed, double *x)
{
    for (size_t i = 0; i < n; i++)
        x[i] = 1.0 / (1.0 + draw(seed, 1000));
}

/* All three sweeps solve with A and leave the interface alone at the end; the interface sweep on
 * its own solves with S. */
static void check_sweeps(const triple *t, const pma_factor *f, uint64_t *seed)
{
    const size_t interior = f->n - f->nb;
    double b[SIZE] = {0.0}, x[SIZE], x_b[SIZE];
    CHECK_STATUS(pma_factor_check(f), PMA_OK);

    draw_vector(f->n, seed, b);
    memcpy(x, b, sizeof x);
    pma_factor_forward(f, x);
    pma_factor_interface(f, x + interior);
    memcpy(x_b, x + interior, f->nb * sizeof(double));
    pma_factor_backward(f, x);
    CHECK_BITS(f->nb, x + interior, x_b);
    check_residual(t, 0, x, b);

    draw_vector(f->nb, seed, b);
    memcpy(x_b, b, sizeof x_b);
    pma_factor_interface(f, x_b);
    check_residual(t, interior, x_b, b);
}

static void dense_and_sparse_factors_solve_for_every_size_of_interface(void)
{
    uint64_t seed = 3;
    for (size_t n = 1; n <= SIZE; n++) {
        const triple t = make_triple(n, n % 2 ? 0.9 : 0.4, &seed);
        for (size_t nb = 0; nb <= n; nb++) {
            const pma_factor dense = dense_factor(&t, nb), sparse = sparse_factor(&t, nb);
            check_sweeps(&t, &dense, &seed);
            check_sweeps(&t, &sparse, &seed);
        }
    }
}

static void a_diagonal_factor_has_three_forms(void)
{
    uint64_t seed = 4;
    const triple t = make_triple(SIZE, 0.0, &seed);
    for (size_t nb = 0; nb <= SIZE; nb++) {
        const pma_factor diagonal = diagonal_factor(&t, nb), dense = dense_factor(&t, nb),
                         sparse = sparse_factor(&t, nb);
        check_sweeps(&t, &diagonal, &seed);
        check_sweeps(&t, &dense, &seed);
        check_sweeps(&t, &sparse, &seed);
    }
}

static void a_sweep_reads_the_reciprocals_and_what_lies_below_the_diagonal(void)
{
    uint64_t seed = 5;
    const triple t = make_triple(SIZE, 0.5, &seed);
    const pma_factor diagonal = diagonal_factor(&t, 2), dense = dense_factor(&t, 2),
                     sparse = sparse_factor(&t, 2);
    CHECK_INT(pma_factor_entries(&diagonal), SIZE);
    CHECK_INT(pma_factor_entries(&dense), SIZE + SIZE * (SIZE - 1) / 2);
    CHECK_INT(pma_factor_entries(&sparse), SIZE + t.sparse.ptr[SIZE]);
}

static pma_status factor_status(size_t nb, const int64_t *ptr, const int32_t *index)
{
    const double ones[3] = {1.0, 1.0, 1.0};
    return pma_factor_check(&(pma_factor){PMA_SPARSE, 3, nb, ones, ones, ptr, index});
}

static void a_factor_with_a_bad_index_is_refused(void)
{
    const int64_t ptr[4] = {0, 2, 3, 3};
    CHECK_STATUS(factor_status(3, ptr, (int32_t[]){1, 2, 2}), PMA_OK);
    CHECK_STATUS(factor_status(0, ptr, (int32_t[]){2, 1, 2}), PMA_OK); /* in any order */
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){0, 2, 2}), PMA_BAD_INDEX); /* on it */
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){1, 2, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){1, 2, 0}), PMA_BAD_INDEX); /* above it */
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){1, 3, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){-1, 2, 2}), PMA_BAD_INDEX);
    const int32_t index[3] = {1, 2, 2};
    CHECK_STATUS(factor_status(1, (int64_t[]){0, 0, 0, 0}, index), PMA_OK);
    CHECK_STATUS(factor_status(1, (int64_t[]){1, 2, 3, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, (int64_t[]){-1, 2, 3, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, (int64_t[]){0, 2, 1, 1}, index), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, (int64_t[]){0, 2, 3, 2}, index), PMA_BAD_INDEX);
}

static void an_interface_larger_than_the_factor_is_refused(void)
{
    const int64_t ptr[4] = {0, 0, 0, 0};
    CHECK_STATUS(factor_status(3, ptr, NULL), PMA_OK);
    CHECK_STATUS(factor_status(4, ptr, NULL), PMA_BAD_SIZE);
    CHECK_STATUS(factor_status(SIZE_MAX, ptr, NULL), PMA_BAD_SIZE);
    const double one = 1.0;
    const pma_factor f = {PMA_DIAGONAL, 1, 2, &one, NULL, NULL, NULL};
    CHECK_STATUS(pma_factor_check(&f), PMA_BAD_SIZE);
}

/* ---- symbolic count ------------------------------------------------------------------------- */

/* The pattern by rows; with its upper half only if `both`. */
static void list_pattern(size_t n, bool filled[SIZE][SIZE], bool both, int64_t *ptr, int32_t *index)
{
    ptr[0] = 0;
    for (size_t i = 0; i < n; i++) {
        ptr[i + 1] = ptr[i];
        for (size_t j = n; j-- > 0;) { /* backward: rows need not be in order */
            if (filled[i][j] && (both || j <= i))
                index[ptr[i + 1]++] = (int32_t)j;
        }
    }
}

/* Eliminating unknown j joins all that are left and tied to it. */
static void eliminate_by_brute_force(size_t n, bool filled[SIZE][SIZE])
{
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = j + 1; k < n; k++)
                filled[i][k] = filled[i][k] || (filled[i][j] && filled[k][j]);
        }
    }
}

static void check_count(size_t n, uint32_t one_in, bool both, uint64_t *seed)
{
    bool filled[SIZE][SIZE] = {{false}};
    int64_t ptr[SIZE + 1], parent[SIZE], mark[SIZE], count[SIZE];
    int32_t index[SIZE * SIZE];
    for (size_t i = 0; i < n; i++) {
        filled[i][i] = draw(seed, 2);
        for (size_t j = 0; j < i; j++)
            filled[i][j] = filled[j][i] = draw(seed, one_in) == 0;
    }
    list_pattern(n, filled, both, ptr, index);
    pma_symbolic_count(n, ptr, index, parent, mark, count);
    eliminate_by_brute_force(n, filled);
    for (size_t j = 0; j < n; j++) {
        int64_t expected = 0;
        for (size_t i = j + 1; i < n; i++)
            expected += filled[i][j];
        CHECK_INT(count[j], expected);
    }
}

static void the_symbolic_count_agrees_with_brute_force(void)
{
    uint64_t seed = 6;
    for (size_t n = 0; n <= SIZE; n++) {
        for (uint32_t one_in = 1; one_in <= 6; one_in++) {
            for (size_t i = 0; i < 20; i++)
                check_count(n, one_in, i % 2, &seed);
        }
    }
}

/* ---- links ---------------------------------------------------------------------------------- */

static pma_status link_status(const int64_t *ptr, const int32_t *index)
{
    const double ones[3] = {1.0, 1.0, 1.0};
    return pma_link_check(&(pma_link){2, 3, ptr, index, ones});
}

static void a_link_with_a_bad_index_is_refused(void)
{
    const int64_t ptr[4] = {0, 1, 1, 3};
    CHECK_STATUS(link_status(ptr, (int32_t[]){1, 0, 1}), PMA_OK);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, 1, 0}), PMA_OK);
    CHECK_STATUS(link_status(ptr, (int32_t[]){2, 0, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, 1, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, -1, 1}), PMA_BAD_INDEX);
    const int32_t index[3] = {0, 1, 0};
    CHECK_STATUS(link_status((int64_t[]){0, 0, 0, 0}, index), PMA_OK);
    CHECK_STATUS(link_status((int64_t[]){1, 1, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){-1, 1, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){0, 2, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){0, 1, 3, 2}, index), PMA_BAD_INDEX);
    const pma_link none = {0, 0, (int64_t[]){0}, NULL, NULL};
    CHECK_STATUS(pma_link_check(&none), PMA_OK);
}

/* L_b = [2 0 0; -1 0 1], by hand and without rounding */
static void a_link_loads_and_gathers_with_one_and_the_same_matrix(void)
{
    const pma_link L = {2, 3, (int64_t[]){0, 2, 2, 3}, (int32_t[]){0, 1, 1},
                        (double[]){2.0, -1.0, 1.0}};
    double x_b[3] = {10.0, 20.0, 30.0}, jump[2] = {100.0, 200.0};
    pma_link_load(&L, (double[]){3.0, 5.0}, x_b); /* += (2*3 - 5, 0, 5) */
    CHECK_BITS(3, x_b, ((double[]){11.0, 20.0, 35.0}));
    pma_link_gather(&L, 0.5, x_b, jump); /* += 0.5 (2*11, -11 + 35) */
    CHECK_BITS(2, jump, ((double[]){111.0, 212.0}));
}

/* ---- loads ---------------------------------------------------------------------------------- */

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

static void a_table_gives_the_row_of_the_own_step(void)
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
    pma_load load = {.kind = PMA_LOAD_SAMPLED, .n = 3, .values = samples[0], .samples = 3, .k = 3,
                     .dt = 0.25};
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
    const pma_load load = {.kind = PMA_LOAD_SAMPLED, .n = 3, .values = samples[0],
                           .shape = shape[0], .samples = 2, .k = 2, .dt = 0.5};
    check_load(&load, 0.0, 0, (double[]){2.0, 8.0, -4.0});
    check_load(&load, 0.25, 0, (double[]){4.0, 10.0, -2.0}); /* s = (4, 2) */
    check_load(&load, 0.5, 0, (double[]){6.0, 12.0, 0.0});
    check_load(&load, 0.75, 0, NOTHING);
}

/* Sampled at m * step, asked at (k/fine) * dt: equal on paper, not in bits. Returns how often t/step
 * fell below the sample it is. */
static size_t check_instants(double dt, size_t fine, double step)
{
    enum { SAMPLES = 200 };
    double samples[SAMPLES], g;
    size_t below = 0;
    for (size_t m = 0; m < SAMPLES; m++)
        samples[m] = m % 2 ? 1.0 : -1.0;
    for (size_t k = 0; k < SAMPLES; k++) {
        /* a record that ends here, and one that goes on */
        for (size_t end = k + 1; end <= SAMPLES; end += SAMPLES - k - (k + 1 < SAMPLES)) {
            const pma_load load = {.kind = PMA_LOAD_SAMPLED, .n = 1, .values = samples,
                                   .samples = end, .k = 1, .dt = step};
            const double t = (double)k / (double)fine * dt;
            g = 0.0;
            pma_load_add(&load, t, 0, &g);
            CHECK_NEAR(g, samples[k], 0.0);
            below += t / step < (double)k;
        }
    }
    return below;
}
