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
#include "panels.h"
#include "record.h"
#include "scheme.h"
#include "status.h"
#include "subdomain.h"
#include "symbolic.h"

static const double EPS = DBL_EPSILON;
static const double PI = 3.14159265358979323846;

/* ---- random numbers that are the same everywhere --------------------------------------------- */

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

/* ---- naive algebra --------------------------------------------------------------------------- */

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

/* ---- status ---------------------------------------------------------------------------------- */

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

/* ---- schemes --------------------------------------------------------------------------------- */

static const pma_scheme TRAPEZOIDAL = {.beta = 0.25, .gamma = 0.5};
static const pma_scheme CENTRAL_DIFFERENCE = {.beta = 0.0, .gamma = 0.5};

/* (P1): all four from one number */
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

/* ---- matrices -------------------------------------------------------------------------------- */

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

/* ---- factors --------------------------------------------------------------------------------- */

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
    return (pma_factor){.form = PMA_DENSE, .n = t->n, .nb = nb, .inverse = t->inverse,
                        .values = t->columns};
}

static pma_factor sparse_factor(const triple *t, size_t nb)
{
    const compressed *s = &t->sparse;
    return (pma_factor){.form = PMA_SPARSE, .n = t->n, .nb = nb, .inverse = t->inverse,
                        .values = s->values, .ptr = s->ptr, .index = s->index};
}

static pma_factor diagonal_factor(const triple *t, size_t nb)
{
    return (pma_factor){.form = PMA_DIAGONAL, .n = t->n, .nb = nb, .inverse = t->inverse};
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
    return pma_factor_check(&(pma_factor){.form = PMA_SPARSE, .n = 3, .nb = nb, .inverse = ones,
                                          .values = ones, .ptr = ptr, .index = index});
}

static void a_factor_with_a_bad_index_is_refused(void)
{
    const int64_t ptr[4] = {0, 2, 3, 3};
    CHECK_STATUS(factor_status(3, ptr, (int32_t[]){1, 2, 2}), PMA_OK);
    CHECK_STATUS(factor_status(0, ptr, (int32_t[]){2, 1, 2}), PMA_BAD_INDEX); /* not ascending */
    CHECK_STATUS(factor_status(0, ptr, (int32_t[]){2, 2, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(factor_status(1, ptr, (int32_t[]){0, 2, 2}), PMA_BAD_INDEX); /* on the diagonal */
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
    const pma_factor f = {.form = PMA_DIAGONAL, .n = 1, .nb = 2, .inverse = &one};
    CHECK_STATUS(pma_factor_check(&f), PMA_BAD_SIZE);
}

/* ---- the structure of a factor -------------------------------------------------------------- */

enum { GRID = 8, UNKNOWNS = GRID * GRID }; /* more than one block of a dense panel, which is 48 */

/* A matrix on its way to a factor in panels, in the core's words; n, nb and A are given. */
typedef struct {
    size_t n, nb;
    double A[UNKNOWNS * UNKNOWNS]; /* by rows */
    int64_t ptr[UNKNOWNS + 1];
    int32_t index[UNKNOWNS * UNKNOWNS];
    double entries[UNKNOWNS * UNKNOWNS];

    int64_t parent[UNKNOWNS], count[UNKNOWNS], order[UNKNOWNS], owner[UNKNOWNS];
    int64_t first[UNKNOWNS + 1], row_ptr[UNKNOWNS + 1], start[UNKNOWNS + 1];
    int32_t rows[UNKNOWNS * UNKNOWNS];
    double values[UNKNOWNS * UNKNOWNS], inverse[UNKNOWNS];
    int64_t integers[4 * UNKNOWNS];
    pma_panels panels;
} structure;

/* Every row backward: rows need not be in order. Without the upper half if `lower`. */
static void list_entries(structure *m, bool lower)
{
    int64_t k = 0;
    m->ptr[0] = 0;
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = lower ? i + 1 : m->n; j-- > 0;) {
            if (m->A[i * m->n + j] == 0.0)
                continue;
            m->index[k] = (int32_t)j;
            m->entries[k++] = m->A[i * m->n + j];
        }
        m->ptr[i + 1] = k;
    }
}

/* filled (n*n): eliminating unknown j ties all that are left and tied to it to one another. */
static void eliminate_by_brute_force(const structure *m, bool *filled)
{
    const size_t n = m->n;
    for (size_t i = 0; i < n * n; i++)
        filled[i] = m->A[i] != 0.0;
    for (size_t j = 0; j < n; j++) {
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = j + 1; filled[i * n + j] && k < n; k++)
                filled[i * n + k] = filled[i * n + k] || filled[k * n + j];
        }
    }
}

/* Entries below the diagonal of column j, and the first of them, -1 if there is none. */
static int64_t count_below(const structure *m, const bool *filled, size_t j, int64_t *first)
{
    int64_t count = 0;
    *first = -1;
    for (size_t i = m->n; i-- > j + 1;) {
        count += filled[i * m->n + j];
        *first = filled[i * m->n + j] ? (int64_t)i : *first;
    }
    return count;
}

static void check_count(const structure *m, const bool *filled)
{
    for (size_t j = 0; j < m->n; j++) {
        int64_t first = -1;
        CHECK_INT(m->count[j], count_below(m, filled, j, &first));
        CHECK_INT(m->parent[j], first);
    }
}

/* One in `one_in` pairs is tied; the diagonal dominates, so A is positive definite. */
static void draw_definite(structure *m, size_t n, size_t nb, uint32_t one_in, uint64_t *seed)
{
    m->n = n;
    m->nb = nb;
    memset(m->A, 0, sizeof m->A);
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (draw(seed, one_in) == 0)
                m->A[i * n + j] = m->A[j * n + i] = draw(seed, 2) ? 0.5 : -1.0;
        }
    }
    for (size_t i = 0; i < n; i++) {
        double sum = 0.125;
        for (size_t j = 0; j < n; j++)
            sum += fabs(m->A[i * n + j]);
        m->A[i * n + i] = sum;
    }
}

/* A square grid of springs, its last line the interface. */
static void draw_grid(structure *m)
{
    *m = (structure){.n = UNKNOWNS, .nb = GRID};
    for (size_t i = 0; i < UNKNOWNS; i++) {
        m->A[i * UNKNOWNS + i] = 4.125;
        if (i % GRID > 0)
            m->A[i * UNKNOWNS + i - 1] = m->A[(i - 1) * UNKNOWNS + i] = -1.0;
        if (i >= GRID)
            m->A[i * UNKNOWNS + i - GRID] = m->A[(i - GRID) * UNKNOWNS + i] = -1.0;
    }
}

static void count_entries(structure *m)
{
    pma_symbolic_count(m->n, m->ptr, m->index, m->parent, m->integers, m->count);
}

static void the_symbolic_count_agrees_with_brute_force(void)
{
    static structure m;
    static bool filled[UNKNOWNS * UNKNOWNS];
    uint64_t seed = 6;
    for (size_t n = 0; n <= 12; n++) {
        for (uint32_t one_in = 1; one_in <= 6; one_in++) {
            for (int i = 0; i < 10; i++) {
                draw_definite(&m, n, 0, one_in, &seed);
                eliminate_by_brute_force(&m, filled);
                list_entries(&m, i % 2);
                count_entries(&m);
                check_count(&m, filled);
            }
        }
    }
}

/* A := A in another order */
static void reorder(structure *m)
{
    static double A[UNKNOWNS * UNKNOWNS];
    memcpy(A, m->A, sizeof A);
    for (size_t i = 0; i < m->n; i++) {
        for (size_t j = 0; j < m->n; j++)
            m->A[i * m->n + j] = A[(size_t)m->order[i] * m->n + (size_t)m->order[j]];
    }
}

/* Each dof is there once, and the interface where it was. */
static void check_permutation(const structure *m)
{
    bool seen[UNKNOWNS] = {false};
    for (size_t k = 0; k < m->n; k++) {
        const bool inside = m->order[k] >= 0 && (size_t)m->order[k] < m->n;
        CHECK(inside && !seen[m->order[k]]);
        if (inside)
            seen[m->order[k]] = true;
        if (k >= m->n - m->nb)
            CHECK_INT(m->order[k], k);
    }
}

/* In the new order: every interior subtree is contiguous, its root last, and the child that stands
 * next to its parent has the longest column among the children. */
static void check_subtrees(const structure *m, const bool *filled)
{
    size_t size[UNKNOWNS] = {0}, lowest[UNKNOWNS];
    const size_t interior = m->n - m->nb;
    int64_t parent = -1, ignored;
    for (size_t k = 0; k < interior; k++)
        lowest[k] = k;
    for (size_t k = 0; k < interior; k++) {
        size[k]++;
        CHECK_INT(lowest[k], k + 1 - size[k]);
        const int64_t length = count_below(m, filled, k, &parent);
        if (parent < 0 || (size_t)parent >= interior)
            continue;
        const size_t p = (size_t)parent;
        size[p] += size[k];
        lowest[p] = lowest[k] < lowest[p] ? lowest[k] : lowest[p];
        CHECK(length <= count_below(m, filled, p - 1, &ignored));
        CHECK_INT(ignored, p); /* the column next to p is a child of p */
    }
}

static void check_postorder(structure *m)
{
    static bool filled[UNKNOWNS * UNKNOWNS];
    int64_t before[UNKNOWNS], ignored;
    list_entries(m, false);
    count_entries(m);
    memcpy(before, m->count, sizeof before);
    pma_symbolic_postorder(m->n, m->nb, m->parent, m->count, m->integers, m->order);
    check_permutation(m);
    reorder(m);
    eliminate_by_brute_force(m, filled);
    for (size_t k = 0; k < m->n; k++)
        CHECK_INT(count_below(m, filled, k, &ignored), before[m->order[k]]);
    check_subtrees(m, filled);
}

static void a_postorder_keeps_the_fill_and_gathers_every_subtree(void)
{
    static structure m;
    uint64_t seed = 8;
    draw_grid(&m);
    check_postorder(&m);
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_postorder(&m);
        }
    }
}

/* All that comes before the numbers; A is brought into postorder. */
static void analyse(structure *m)
{
    list_entries(m, false);
    count_entries(m);
    pma_symbolic_postorder(m->n, m->nb, m->parent, m->count, m->integers, m->order);
    reorder(m);
    list_entries(m, false);
    count_entries(m);
    const size_t s =
        pma_symbolic_supernodes(m->n, m->nb, m->parent, m->count, m->integers, m->first);
    m->row_ptr[0] = m->start[0] = 0;
    for (size_t i = 0; i < s; i++) {
        const int64_t width = m->first[i + 1] - m->first[i], below = m->count[m->first[i + 1] - 1];
        m->row_ptr[i + 1] = m->row_ptr[i] + below;
        m->start[i + 1] = m->start[i] + width * (width + below);
    }
    pma_symbolic_rows(m->n, m->ptr, m->index, s, m->first, m->row_ptr, m->owner, m->integers,
                      m->integers + m->n, m->integers + m->n + s, m->rows);
    m->panels = (pma_panels){s, m->first, m->row_ptr, m->rows, m->start, m->values};
}

/* The rows of a supernode are the pattern of its last column, by brute force, and the patterns of
 * its other columns are among them. */
static void check_supernode(const structure *m, const bool *filled, size_t s)
{
    const size_t n = m->n, last = (size_t)m->first[s + 1] - 1;
    int64_t k = m->row_ptr[s];
    CHECK(m->first[s + 1] - m->first[s] <= PMA_WIDEST);
    for (size_t i = last + 1; i < n; i++) {
        const bool listed = k < m->row_ptr[s + 1] && (size_t)m->rows[k] == i;
        CHECK_INT(listed, filled[i * n + last]);
        for (size_t j = (size_t)m->first[s]; j < last; j++)
            CHECK(listed || !filled[i * n + j]);
        k += listed;
    }
    CHECK_INT(k, m->row_ptr[s + 1]);
    for (int64_t j = m->first[s]; j < m->first[s + 1]; j++)
        CHECK_INT(m->owner[j], s);
}

static void check_supernodes(structure *m)
{
    static bool filled[UNKNOWNS * UNKNOWNS];
    analyse(m);
    eliminate_by_brute_force(m, filled);
    CHECK_STATUS(pma_panels_check(&m->panels, m->n, m->nb), PMA_OK);
    for (size_t s = 0; s < m->panels.count; s++)
        check_supernode(m, filled, s);
}

static void supernodes_hold_the_whole_fill_and_break_at_the_interface(void)
{
    static structure m;
    uint64_t seed = 9;
    draw_grid(&m);
    check_supernodes(&m);
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_supernodes(&m);
        }
    }
}

/* Columns of a dense matrix all belong together, those of a diagonal one never; no supernode is
 * wider than it may be, and the interface begins a new one. */
static void supernodes_of_dense_and_diagonal_matrices_are_as_few_and_as_many_as_can_be(void)
{
    enum { N = PMA_WIDEST + 44 };
    static int64_t parent[N], length[N], scratch[N], first[N + 1];
    for (size_t n = 1; n <= PMA_WIDEST; n += 85) {
        for (size_t j = 0; j < n; j++) {
            parent[j] = j + 1 < n ? (int64_t)j + 1 : -1;
            length[j] = (int64_t)(n - 1 - j);
        }
        CHECK_INT(pma_symbolic_supernodes(n, 0, parent, length, scratch, first), 1);
        CHECK_INT(pma_symbolic_supernodes(n, n, parent, length, scratch, first), 1);
        if (n > 1)
            CHECK_INT(pma_symbolic_supernodes(n, 1, parent, length, scratch, first), 2);
        CHECK_INT(first[0], 0);
    }
    for (size_t j = 0; j < N; j++) {
        parent[j] = j + 1 < N ? (int64_t)j + 1 : -1;
        length[j] = (int64_t)(N - 1 - j);
    }
    CHECK(pma_symbolic_supernodes(N, 0, parent, length, scratch, first) >= 2);
    CHECK(first[1] <= PMA_WIDEST);
    for (size_t j = 0; j < N; j++) {
        parent[j] = -1;
        length[j] = 0;
    }
    CHECK_INT(pma_symbolic_supernodes(N, 0, parent, length, scratch, first), N);
}

/* ---- panels --------------------------------------------------------------------------------- */

/* C := alpha A B^T + beta C, A (m*k), B (n*k); C is not read when beta is zero */
static void naive_dgemm(char *trans_a, char *trans_b, int *m, int *n, int *k, double *alpha,
                        double *A, int *lda, double *B, int *ldb, double *beta, double *C, int *ldc)
{
    CHECK(*trans_a == 'N' && *trans_b == 'T');
    CHECK(*lda >= *m && *ldb >= *n && *ldc >= *m);
    for (int j = 0; j < *n; j++) {
        for (int i = 0; i < *m; i++) {
            double sum = 0.0;
            for (int l = 0; l < *k; l++)
                sum += A[i + l * *lda] * B[j + l * *ldb];
            double *c = &C[i + j * *ldc];
            *c = *beta == 0.0 ? *alpha * sum : *alpha * sum + *beta * *c;
        }
    }
}

/* B (m*n) := alpha B T^-T, T lower triangular */
static void naive_dtrsm(char *side, char *half, char *trans, char *unit, int *m, int *n,
                        double *alpha, double *T, int *ldt, double *B, int *ldb)
{
    CHECK(*side == 'R' && *half == 'L' && *trans == 'T' && *unit == 'N');
    for (int j = 0; j < *n; j++) {
        for (int i = 0; i < *m; i++) {
            double sum = *alpha * B[i + j * *ldb];
            for (int l = 0; l < j; l++)
                sum -= B[i + l * *ldb] * T[j + l * *ldt];
            B[i + j * *ldb] = sum / T[j + j * *ldt];
        }
    }
}

static const pma_blas NAIVE_BLAS = {naive_dgemm, naive_dtrsm};

/* A callback that says stop when asked for the stop_at-th time; never for 0. */
typedef struct {
    size_t asked, stop_at;
} asker;

static bool ask(void *ctx)
{
    asker *a = ctx;
    a->asked++;
    return a->asked == a->stop_at;
}

/* With scratch of just the sizes asked for: one more would be seen by AddressSanitizer. */
static pma_status make_numbers(structure *m, double lost, asker *a, size_t *column)
{
    const pma_panels_input input = {m->n, m->ptr, m->index, m->entries, lost};
    double *update = malloc(pma_panels_update_size(&m->panels) * sizeof *update);
    int64_t *integers = malloc((3 * m->panels.count + m->n) * sizeof *integers);
    const pma_status status =
        pma_panels_factor(&m->panels, &input, m->owner, &NAIVE_BLAS, m->inverse, update, integers,
                          column, ask, a);
    free(update);
    free(integers);
    return status;
}

/* |b - A x| of a Cholesky solve is below (3 n + 1) eps |G| |G^T| |x|, entry by entry, and |G| |G^T|
 * below sqrt(a_ii a_jj) by Cauchy-Schwarz; the rest is for scaling to R D R^T and for this loop. */
static void check_definite_residual(const structure *m, const double *x, const double *b)
{
    const size_t n = m->n;
    for (size_t i = 0; i < n; i++) {
        double residual = b[i], scale = 0.0;
        for (size_t j = 0; j < n; j++) {
            residual -= m->A[i * n + j] * x[j];
            scale += sqrt(m->A[i * n + i] * m->A[j * n + j]) * fabs(x[j]);
        }
        CHECK_NEAR(residual, 0.0, 8.0 * (double)(n + 1) * EPS * scale);
    }
}

static void check_factored(structure *m, uint64_t *seed)
{
    double b[UNKNOWNS], x[UNKNOWNS], work[UNKNOWNS];
    asker a = {0, 0};
    size_t column = 0;
    analyse(m);
    CHECK_STATUS(make_numbers(m, 1e-12, &a, &column), PMA_OK);
    CHECK_INT(a.asked, m->panels.count);
    const pma_factor f = {.form = PMA_PANELS, .n = m->n, .nb = m->nb, .inverse = m->inverse,
                          .panels = m->panels, .work = work};
    CHECK_STATUS(pma_factor_check(&f), PMA_OK);
    draw_vector(m->n, seed, b);
    memcpy(x, b, m->n * sizeof(double));
    pma_factor_forward(&f, x);
    pma_factor_interface(&f, x + (m->n - m->nb));
    pma_factor_backward(&f, x);
    check_definite_residual(m, x, b);
}

static void a_factor_made_in_panels_solves(void)
{
    static structure m;
    uint64_t seed = 10;
    draw_grid(&m);
    check_factored(&m, &seed);
    for (uint32_t one_in = 1; one_in <= 64; one_in *= 2) {
        draw_definite(&m, UNKNOWNS, draw(&seed, 8), one_in, &seed);
        check_factored(&m, &seed);
    }
    for (size_t n = 0; n <= 24; n++) {
        for (uint32_t one_in = 1; one_in <= 9; one_in += 2) {
            draw_definite(&m, n, draw(&seed, (uint32_t)n + 1), one_in, &seed);
            check_factored(&m, &seed);
        }
    }
}

/* A pivot does not depend on what comes after it, so the spoilt one is the first to fail. */
static void check_spoilt(structure *m, size_t spoilt, double diagonal)
{
    asker a = {0, 0};
    size_t column = SIZE_MAX;
    const double kept = m->A[spoilt * (m->n + 1)];
    m->A[spoilt * (m->n + 1)] = diagonal;
    list_entries(m, false);
    CHECK_STATUS(make_numbers(m, 1e-12, &a, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, spoilt);
    m->A[spoilt * (m->n + 1)] = kept;
}

/* In many panels, and in one that is wider than a block. */
static void the_column_of_a_pivot_that_is_not_positive_is_named(void)
{
    static structure m;
    draw_grid(&m);
    analyse(&m);
    for (size_t i = 0; i < UNKNOWNS; i++) {
        check_spoilt(&m, i, -1.0);
        check_spoilt(&m, i, NAN);
    }
    m = (structure){.n = UNKNOWNS};
    for (size_t i = 0; i < UNKNOWNS * UNKNOWNS; i++)
        m.A[i] = i % (UNKNOWNS + 1) == 0 ? 4.0 : 1.0;
    analyse(&m);
    CHECK_INT(m.panels.count, 1);
    for (size_t i = 1; i < UNKNOWNS; i++) {
        check_spoilt(&m, i, -1.0);
        check_spoilt(&m, i, 0.1); /* elimination takes at least 1/4 away */
    }
}

/* [1 1; 1 1 + d] has the pivot d, which is lost when d is the rounding of the diagonal. */
static void a_pivot_that_is_only_rounding_counts_as_not_positive(void)
{
    static structure m;
    asker a = {0, 0};
    size_t column = SIZE_MAX;
    m = (structure){.n = 2, .A = {1.0, 1.0, 1.0, 1.0 + 1e-13}};
    analyse(&m);
    CHECK_STATUS(make_numbers(&m, 1e-12, &a, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, 1);
    CHECK_STATUS(make_numbers(&m, 1e-14, &a, &column), PMA_OK);
}

/* Panels of a chain, then an entry between its ends. */
static void an_entry_outside_the_pattern_is_refused(void)
{
    static structure m;
    asker a = {0, 0};
    size_t column;
    m = (structure){.n = SIZE};
    for (size_t i = 0; i < SIZE; i++) {
        m.A[i * SIZE + i] = 4.0;
        if (i > 0)
            m.A[i * SIZE + i - 1] = m.A[(i - 1) * SIZE + i] = 1.0;
    }
    analyse(&m);
    CHECK_STATUS(make_numbers(&m, 1e-12, &a, &column), PMA_OK);
    m.A[SIZE - 1] = m.A[(SIZE - 1) * SIZE] = 1.0;
    list_entries(&m, false);
    CHECK_STATUS(make_numbers(&m, 1e-12, &a, &column), PMA_BAD_INDEX);
}

static void a_factor_in_the_making_can_be_stopped(void)
{
    static structure m;
    size_t column;
    draw_grid(&m);
    analyse(&m);
    CHECK(m.panels.count >= 3);
    for (size_t stop_at = 1; stop_at <= 3; stop_at++) {
        asker a = {0, stop_at};
        CHECK_STATUS(make_numbers(&m, 1e-12, &a, &column), PMA_STOPPED);
        CHECK_INT(a.asked, stop_at);
    }
}

/* Supernodes {0, 1} with the rows 3, 4 below, {2} with 3, 4 and {3, 4}. */
static pma_panels three_panels(void)
{
    static const int64_t first[4] = {0, 2, 3, 5}, row_ptr[4] = {0, 2, 4, 4};
    static const int64_t start[4] = {0, 8, 11, 15};
    static const int32_t rows[4] = {3, 4, 3, 4};
    static double values[15];
    return (pma_panels){3, first, row_ptr, rows, start, values};
}

static void panels_say_how_much_scratch_they_need(void)
{
    const pma_panels p = three_panels();
    const pma_factor f = {.form = PMA_PANELS, .n = 5, .panels = p};
    CHECK_INT(pma_panels_most_rows(&p), 2);
    CHECK(pma_panels_update_size(&p) >= 2 * 2); /* two rows below times two columns */
    CHECK_INT(pma_factor_entries(&f), 15);
}

static pma_status panels_status(const int64_t *first, const int64_t *row_ptr, const int32_t *rows,
                                const int64_t *start)
{
    pma_panels p = three_panels();
    p.first = first ? first : p.first;
    p.row_ptr = row_ptr ? row_ptr : p.row_ptr;
    p.rows = rows ? rows : p.rows;
    p.start = start ? start : p.start;
    return pma_panels_check(&p, 5, 0);
}

static void panels_with_a_bad_index_are_refused(void)
{
    CHECK_STATUS(panels_status(NULL, NULL, NULL, NULL), PMA_OK);
    CHECK_STATUS(panels_status((int64_t[]){1, 2, 3, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 2, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 3, 2, 5}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 3, 4}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status((int64_t[]){0, 2, 3, 6}, NULL, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, (int64_t[]){1, 2, 4, 4}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, (int64_t[]){0, 2, 1, 4}, NULL, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){4, 3, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){3, 3, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){1, 4, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){3, 5, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, (int32_t[]){-1, 4, 3, 4}, NULL), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){1, 9, 12, 16}), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){0, 7, 11, 15}), PMA_BAD_INDEX);
    CHECK_STATUS(panels_status(NULL, NULL, NULL, (int64_t[]){0, 8, 11, 14}), PMA_BAD_INDEX);
    /* an empty supernode, with all else as it has to be */
    const int64_t first[4] = {0, 2, 2, 5}, row_ptr[4] = {0, 2, 2, 2}, start[4] = {0, 8, 8, 17};
    CHECK_STATUS(panels_status(first, row_ptr, NULL, start), PMA_BAD_INDEX);
}

static void panels_have_to_break_where_the_interface_begins(void)
{
    const pma_panels p = three_panels();
    const pma_status expected[6] = {PMA_OK,        PMA_BAD_INDEX, PMA_OK,
                                    PMA_OK,        PMA_BAD_INDEX, PMA_OK};
    for (size_t nb = 0; nb <= 5; nb++) {
        const pma_factor f = {.form = PMA_PANELS, .n = 5, .nb = nb, .panels = p};
        CHECK_STATUS(pma_panels_check(&p, 5, nb), expected[nb]);
        CHECK_STATUS(pma_factor_check(&f), expected[nb]);
    }
    const pma_factor too_many = {.form = PMA_PANELS, .n = 5, .nb = 6, .panels = p};
    CHECK_STATUS(pma_factor_check(&too_many), PMA_BAD_SIZE);
}

/* The factor of a triple cut into panels at random and at the interface. */
typedef struct {
    size_t count;
    int64_t first[SIZE + 1], row_ptr[SIZE + 1], start[SIZE + 1];
    int32_t rows[SIZE * SIZE];
    double values[SIZE * SIZE];
} panelled;

/* One more supernode, of the columns begin..end-1: its rows are all in which one of them has an
 * entry; NaN where nothing is read, on and above the diagonal. */
static void add_panel(panelled *q, const triple *t, size_t begin, size_t end)
{
    const size_t s = q->count++, n = t->n;
    int64_t rows = q->row_ptr[s];
    for (size_t i = end; i < n; i++) {
        bool filled = false;
        for (size_t j = begin; j < end; j++)
            filled = filled || t->R[i * n + j] != 0.0;
        if (filled)
            q->rows[rows++] = (int32_t)i;
    }
    double *value = q->values + q->start[s];
    for (size_t j = begin; j < end; j++) {
        for (size_t i = begin; i < end; i++)
            *value++ = i > j ? t->R[i * n + j] : (double)NAN;
        for (int64_t k = q->row_ptr[s]; k < rows; k++)
            *value++ = t->R[(size_t)q->rows[k] * n + j];
    }
    q->first[s + 1] = (int64_t)end;
    q->row_ptr[s + 1] = rows;
    q->start[s + 1] = value - q->values;
}

static panelled cut_into_panels(const triple *t, size_t nb, uint64_t *seed)
{
    panelled q = {.count = 0};
    size_t begin = 0;
    for (size_t end = 1; end <= t->n; end++) {
        if (end < t->n && end != t->n - nb && draw(seed, 3) > 0)
            continue;
        add_panel(&q, t, begin, end);
        begin = end;
    }
    return q;
}

static void factors_in_panels_solve_for_every_size_of_interface(void)
{
    uint64_t seed = 11;
    for (size_t n = 1; n <= SIZE; n++) {
        for (size_t nb = 0; nb <= n; nb++) {
            const triple t = make_triple(n, n % 2 ? 0.9 : 0.4, &seed);
            panelled q = cut_into_panels(&t, nb, &seed);
            const pma_panels panels = {q.count, q.first, q.row_ptr, q.rows, q.start, q.values};
            double work[SIZE + 1];
            work[pma_panels_most_rows(&panels)] = 7.0; /* not to be written */
            const pma_factor f = {.form = PMA_PANELS, .n = n, .nb = nb, .inverse = t.inverse,
                                  .panels = panels, .work = work};
            check_sweeps(&t, &f, &seed);
            CHECK_NEAR(work[pma_panels_most_rows(&panels)], 7.0, 0.0);
        }
    }
}

/* ---- links ----------------------------------------------------------------------------------- */

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

/* ---- loads ----------------------------------------------------------------------------------- */

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

enum { SAMPLES = 200 };

/* F(t) of one dof whose samples 1, -1, 1, ... end with number `last` */
static double alternating_load(size_t last, double step, double t)
{
    double samples[SAMPLES], g = 0.0;
    for (size_t m = 0; m < SAMPLES; m++)
        samples[m] = m % 2 ? -1.0 : 1.0;
    const pma_load load = {.kind = PMA_LOAD_SAMPLED, .n = 1, .values = samples,
                           .samples = last + 1, .k = 1, .dt = step};
    pma_load_add(&load, t, 0, &g);
    return g;
}

/* Sampled at m * step and asked for at (k/fine) * dt with dt = fine * step: equal as decimals, not
 * in bits. Without care half of those that fall below would be interpolated, of those that fall
 * above the last one would be zero. */
static void a_sample_instant_typed_as_a_decimal_gives_the_sample_itself(void)
{
    const struct {
        double dt, fine, step;
    } typed[] = {{0.02, 20.0, 0.001},      {0.2, 20.0, 0.01}, {0.1, 5.0, 0.02}, {0.07, 7.0, 0.01},
                 {0.02 * 0.02, 20.0, 2e-5}, {0.3, 3.0, 0.1}};
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

/* ---- parts: subdomains that know their equations --------------------------------------------- */

enum {
    MOST = 3,            /* dofs of a part */
    CONDITIONS = 2,
    PARTS = 3,
    FINE = 6,            /* fine steps in a macro step */
    STEPS = 8,           /* macro steps */
    NODES = STEPS * FINE + 1
};

/* One part of (1), filled in by a test, and what make_part makes of it. A part is not to be moved
 * afterwards: the core keeps pointers into it. */
typedef struct {
    size_t n, nb, p, substeps;
    bool implicit, doubled;
    pma_scheme scheme;
    double h;
    double M[MOST * MOST], C[MOST * MOST], K[MOST * MOST]; /* n*n by rows */
    double L[CONDITIONS * MOST]; /* p x n by rows, zero outside the last nb columns */
    double u0[MOST], v0[MOST];
    pma_load load;

    double Mbar[2][MOST * MOST], R[2][MOST * MOST], inverse[2][MOST]; /* of h and of 2 h */
    int64_t ptr[MOST + 1];
    int32_t condition[CONDITIONS * MOST];
    double sign[CONDITIONS * MOST];
    double loads[NODES * MOST], shape[MOST * MOST]; /* memory for the load */
    pma_subdomain *core;
} part;

/* al1 = h^2 beta (1-af)/(1-am)                                                            (P2) */
static double al1_of(const part *x, bool twice)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h;
    return h * h * s.beta * (1.0 - s.af) / (1.0 - s.am);
}

/* al2 = h gamma (1-af)/(1-am)                                                             (P2) */
static double al2_of(const part *x, bool twice)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h;
    return h * s.gamma * (1.0 - s.af) / (1.0 - s.am);
}

/* implicit M + al2 C + al1 K, explicit M + al2 C */
static pma_operator make_operator(part *x, bool twice)
{
    const double al1 = x->implicit ? al1_of(x, twice) : 0.0, al2 = al2_of(x, twice);
    for (size_t i = 0; i < x->n * x->n; i++)
        x->Mbar[twice][i] = x->M[i] + al2 * x->C[i] + al1 * x->K[i];
    naive_factor(x->n, x->Mbar[twice], x->R[twice], x->inverse[twice]);
    return (pma_operator){
        .step = pma_step_make(x->scheme, twice ? 2.0 * x->h : x->h),
        .factor = {.form = PMA_DENSE, .n = x->n, .nb = x->nb, .inverse = x->inverse[twice],
                   .values = x->R[twice]}};
}

static pma_link make_link(part *x)
{
    int64_t k = 0;
    for (size_t j = 0; j < x->nb; j++) {
        for (size_t row = 0; row < x->p; row++) {
            const double entry = x->L[row * x->n + (x->n - x->nb) + j];
            if (entry == 0.0)
                continue;
            x->condition[k] = (int32_t)row;
            x->sign[k++] = entry;
        }
        x->ptr[j + 1] = k;
    }
    return (pma_link){x->p, x->nb, x->ptr, x->condition, x->sign};
}

static pma_parts describe(part *x)
{
    return (pma_parts){.n = x->n,
                       .nb = x->nb,
                       .substeps = x->substeps,
                       .doubled = x->doubled,
                       .K = {PMA_DENSE, x->n, x->K, NULL, NULL},
                       .C = {PMA_DENSE, x->n, x->C, NULL, NULL},
                       .single = make_operator(x, false),
                       .twice = make_operator(x, true),
                       .link = make_link(x)};
}

static void make_part(part *x)
{
    const pma_parts parts = describe(x);
    CHECK_STATUS(pma_subdomain_create(&parts, &x->core), PMA_OK);
    x->load.n = x->n;
    pma_subdomain_set_load(x->core, x->load);
}

/* m w + k u = 0 with as many conditions as L has entries, one or none */
static part one_mass(double m, double k, double L, pma_scheme scheme, bool implicit)
{
    part x = {.n = 1, .nb = L != 0.0, .p = L != 0.0, .substeps = 1, .implicit = implicit,
              .scheme = scheme, .h = 0.1, .M = {m}, .K = {k}, .L = {L}};
    return x;
}

/* ---- the same step, naively: docs/method.md 3 and 4 as written ------------------------------- */

/* All there is at an own node. */
typedef struct {
    double u[MOST], v[MOST], w[MOST], a[MOST], vf[MOST];
} node;

static void naive_force(const part *x, double t, size_t step, double *F)
{
    const pma_load *load = &x->load;
    memset(F, 0, x->n * sizeof(double));
    const size_t before = load->kind == PMA_LOAD_SAMPLED ? (size_t)(t / load->dt + 1e-9) : 0;
    const double theta = load->kind == PMA_LOAD_SAMPLED ? t / load->dt - (double)before : 0.0;
    for (size_t i = 0; i < x->n; i++) {
        if (load->kind == PMA_LOAD_CONSTANT)
            F[i] = load->values[i];
        if (load->kind == PMA_LOAD_TABLE)
            F[i] = load->values[step * x->n + i];
        for (size_t c = 0; load->kind == PMA_LOAD_SAMPLED && c < load->k; c++) {
            const double *at = load->values + before * load->k + c;
            F[i] += load->shape[c * x->n + i] * ((1.0 - theta) * at[0] + theta * at[load->k]);
        }
    }
}

/* Free problem from one node to another: (5), (6), (7) or (10), (8) */
static void naive_free(const part *x, bool twice, const double *F, const node *from, node *to)
{
    const pma_scheme s = x->scheme;
    const double h = twice ? 2.0 * x->h : x->h, d = 1.0 - s.am;
    double ut[MOST], vt[MOST];
    for (size_t i = 0; i < x->n; i++) {
        ut[i] = from->u[i] + h * from->v[i] + h * h * (0.5 - s.beta / d) * from->a[i] +
                h * h * s.beta * s.af / d * from->w[i];
        vt[i] = from->v[i] + h * (1.0 - s.gamma / d) * from->a[i] +
                h * s.gamma * s.af / d * from->w[i];
    }
    for (size_t i = 0; i < x->n; i++) {
        to->w[i] = F[i];
        for (size_t j = 0; j < x->n; j++)
            to->w[i] -= x->C[i * x->n + j] * vt[j] + x->K[i * x->n + j] * ut[j];
    }
    naive_solve(x->n, x->Mbar[twice], to->w);
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] = ut[i] + al1_of(x, twice) * to->w[i];
        to->v[i] = to->vf[i] = vt[i] + al2_of(x, twice) * to->w[i];
    }
}

/* wl (n) := Mbar^-1 L^T lam */
static void naive_link(const part *x, bool twice, const double *lam, double *wl)
{
    memset(wl, 0, x->n * sizeof(double));
    for (size_t row = 0; row < x->p; row++) {
        for (size_t i = 0; i < x->n; i++)
            wl[i] += x->L[row * x->n + i] * lam[row];
    }
    naive_solve(x->n, x->Mbar[twice], wl);
}

/* Link problem added to the free one, and (9) with the total acceleration */
static void naive_close(const part *x, bool twice, const double *lam, const node *from, node *to)
{
    const pma_scheme s = x->scheme;
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++) {
        to->u[i] += al1_of(x, twice) * wl[i];
        to->v[i] += al2_of(x, twice) * wl[i];
        to->w[i] += wl[i];
        to->a[i] = ((1.0 - s.af) * to->w[i] + s.af * from->w[i] - s.am * from->a[i]) / (1.0 - s.am);
    }
}

/* vf := v - al2 Mbar^-1 L^T lam, (S2) and (S3) */
static void naive_store(const part *x, bool twice, const double *lam, node *at)
{
    double wl[MOST];
    naive_link(x, twice, lam, wl);
    for (size_t i = 0; i < x->n; i++)
        at->vf[i] = at->v[i] - al2_of(x, twice) * wl[i];
}

/* L x for one condition */
static double conditioned(const part *x, size_t row, const double *values)
{
    double sum = 0.0;
    for (size_t i = 0; i < x->n; i++)
        sum += x->L[row * x->n + i] * values[i];
    return sum;
}

/* Some 50 steps of some 50 roundings each, of numbers of order one; a division by h in (18) and
 * matrices of condition 10 make 1e2 of it at most. A term left out shows at 1e-3. */
static const double AGREE = 1e-11;

static void check_state(const part *x, const pma_state *actual, const node *expected)
{
    for (size_t i = 0; i < x->n; i++) {
        CHECK_NEAR(actual->u[i], expected->u[i], AGREE);
        CHECK_NEAR(actual->v[i], expected->v[i], AGREE);
        CHECK_NEAR(actual->w[i], expected->w[i], AGREE);
        CHECK_NEAR(actual->a[i], expected->a[i], AGREE);
    }
}

/* ---- one subdomain --------------------------------------------------------------------------- */

static void a_subdomain_with_sizes_that_do_not_agree_is_refused(void)
{
    part x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.n = 2, x.M[3] = 1.0;
    const pma_parts good = describe(&x);
    pma_parts bad[11];
    for (size_t i = 0; i < 11; i++)
        bad[i] = good;
    bad[0].n = 0;
    bad[1].nb = 3;
    bad[2].substeps = 0;
    bad[3].K.n = 3;
    bad[4].C.n = 1;
    bad[5].link.nb = 2;
    bad[6].single.factor.n = 3;
    bad[7].single.factor.nb = 2;
    bad[8].doubled = true, bad[8].twice.factor.n = 1;
    bad[9].doubled = true, bad[9].twice.factor.nb = 0;
    bad[10].nb = 0;
    for (size_t i = 0; i < 11; i++) {
        pma_subdomain *made = (pma_subdomain *)&x;
        CHECK_STATUS(pma_subdomain_create(&bad[i], &made), PMA_BAD_SIZE);
        CHECK(made == NULL);
    }
    pma_subdomain *made = NULL;
    bad[8].doubled = false; /* the second operator is read only if doubled */
    CHECK_STATUS(pma_subdomain_create(&bad[8], &made), PMA_OK);
    CHECK_INT(pma_subdomain_parts(made)->n, 2);
    CHECK_INT(pma_subdomain_load(made)->kind, PMA_LOAD_NONE);
    pma_subdomain_destroy(made);
    pma_subdomain_destroy(NULL);
}

static void a_subdomain_with_a_bad_index_is_refused(void)
{
    part x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.doubled = true;
    const pma_parts good = describe(&x);
    const int64_t ptr[2] = {0, 1};
    const int32_t one = 1;
    pma_parts bad[5] = {good, good, good, good, good};
    bad[0].K = (pma_matrix){PMA_SPARSE, 1, x.K, ptr, &one};
    bad[1].C = (pma_matrix){PMA_SPARSE, 1, x.K, ptr, &one};
    bad[2].link.index = &one;
    bad[3].single.factor = (pma_factor){.form = PMA_SPARSE, .n = 1, .nb = 1, .inverse = x.K,
                                        .values = x.K, .ptr = ptr, .index = &one};
    bad[4].twice.factor = bad[3].single.factor;
    for (size_t i = 0; i < 5; i++) {
        pma_subdomain *made = (pma_subdomain *)&x;
        CHECK_STATUS(pma_subdomain_create(&bad[i], &made), PMA_BAD_INDEX);
        CHECK(made == NULL);
    }
}

/* Without an interface and with diagonal forms no array is read before the memory is asked for. */
static void a_subdomain_beyond_all_memory_is_refused(void)
{
    const size_t n = SIZE_MAX / 100;
    const double one = 1.0;
    const int64_t ptr = 0;
    const pma_parts parts = {.n = n, .substeps = 1,
                             .K = {PMA_DIAGONAL, n, &one, NULL, NULL},
                             .C = {PMA_ZERO, n, NULL, NULL, NULL},
                             .single = {.factor = {.form = PMA_DIAGONAL, .n = n, .inverse = &one}},
                             .link = {0, 0, &ptr, NULL, NULL}};
    pma_subdomain *made = NULL;
    CHECK_STATUS(pma_subdomain_create(&parts, &made), PMA_NO_MEMORY);
    CHECK(made == NULL);
}

/* One own step reads the factor twice, K and C once, and the four vectors a few times. */
static void an_own_step_reads_at_least_what_its_sweeps_and_products_read(void)
{
    part x = one_mass(1.0, 1.0, 1.0, TRAPEZOIDAL, true);
    x.n = 3, x.M[4] = x.M[8] = 1.0, x.L[2] = 1.0, x.L[0] = 0.0;
    make_part(&x);
    const size_t least = 2 * 6 + 9 + 9 + 4 * 3;
    CHECK(pma_subdomain_entries(x.core) >= least);
    CHECK(pma_subdomain_entries(x.core) < 2 * least);
    pma_subdomain_destroy(x.core);
}

/* `steps` macro steps of one own step each, nothing tied; u and v at every node, 0 included */
static void swing(part *x, double u0, double v0, size_t steps, double *u, double *v)
{
    const double w0 = -x->K[0] / x->M[0] * u0, lam = 0.0;
    make_part(x);
    pma_subdomain_start(x->core, &u0, &v0, &w0, &lam);
    for (size_t n = 0; n <= steps; n++) {
        u[n] = pma_subdomain_at(x->core, 0)->u[0];
        v[n] = pma_subdomain_at(x->core, 0)->v[0];
        pma_subdomain_open(x->core, 0, false, 0.0, (int64_t)n);
        CHECK_STATUS(pma_subdomain_close(x->core, 1, false, &lam), PMA_OK);
        pma_subdomain_commit(x->core);
    }
    pma_subdomain_destroy(x->core);
}

enum { SWINGS = 400 };

/* Each step adds a few roundings of numbers of order one, and nothing amplifies them. */
static const double SWING_TOLERANCE = 10.0 * SWINGS * DBL_EPSILON;

/* The amplification of (u, v) is a rotation: u_n = u0 cos(n q) + v0/omega sin(n q) with
 * tan(q/2) = omega h/2. */
static void a_free_oscillator_under_the_trapezoidal_rule_turns_by_its_closed_form(void)
{
    part x = one_mass(2.0, 18.0, 0.0, TRAPEZOIDAL, true); /* omega = 3 */
    double u[SWINGS + 1], v[SWINGS + 1];
    swing(&x, 1.0, 1.5, SWINGS, u, v);
    const double q = 2.0 * atan(3.0 * x.h / 2.0);
    for (size_t n = 0; n <= SWINGS; n++) {
        const double c = cos((double)n * q), s = sin((double)n * q);
        CHECK_NEAR(u[n], c + 0.5 * s, SWING_TOLERANCE);
        CHECK_NEAR(v[n], 1.5 * c - 3.0 * s, 3.0 * SWING_TOLERANCE);
    }
}

/* u_{n+1} - 2 u_n + u_{n-1} = -(omega h)^2 u_n: u_n = cos(n q), cos q = 1 - (omega h)^2/2, and
 * v_n = (u_{n+1} - u_{n-1})/(2 h) = -sin(n q) sin(q)/h */
static void a_free_oscillator_under_the_central_difference_turns_by_its_closed_form(void)
{
    part x = one_mass(2.0, 18.0, 0.0, CENTRAL_DIFFERENCE, false);
    double u[SWINGS + 1], v[SWINGS + 1];
    swing(&x, 1.0, 0.0, SWINGS, u, v);
    const double q = acos(1.0 - 0.5 * 0.3 * 0.3);
    for (size_t n = 0; n <= SWINGS; n++) {
        CHECK_NEAR(u[n], cos((double)n * q), SWING_TOLERANCE);
        /* the rounding of q, divided by sin q = 0.3, is multiplied with n in the expectation */
        CHECK_NEAR(v[n], -sin((double)n * q) * sin(q) / x.h, 10.0 * SWING_TOLERANCE);
    }
}

/* At omega h = (1 + rho) sqrt(2 - rho) all three roots of the explicit scheme are -rho, so that
 * (E + rho)^3 v = 0 for the shift E, once the fourth root, 0, has had its step; and there
 * al1 omega^2 = 1, so that u1 = ut - al1 omega^2 ut = 0. */
static void the_explicit_scheme_has_three_equal_roots_at_its_bifurcation(void)
{
    for (double rho = 0.25; rho < 1.0; rho += 0.25) {
        const double omega_h = (1.0 + rho) * sqrt(2.0 - rho);
        part x = one_mass(1.0, omega_h * omega_h / 0.01, 0.0, generalized_alpha(rho), false);
        double u[11], v[11];
        swing(&x, 1.0, 10.0, 10, u, v);
        for (size_t n = 1; n + 3 <= 10; n++) {
            const double sum = v[n + 3] + 3.0 * rho * v[n + 2] + 3.0 * rho * rho * v[n + 1] +
                               rho * rho * rho * v[n];
            /* terms up to 10 in u and up to 300 in v, four to ten roundings of them */
            CHECK_NEAR(u[n], 0.0, 100.0 * EPS);
            CHECK_NEAR(sum, 0.0, 3000.0 * EPS);
        }
        CHECK(fabs(v[5]) > 0.1); /* not all is zero */
    }
}

/* Three dofs with a full mass matrix and damping, two of them on the interface with two conditions,
 * under a constant load. */
static part three_dofs(size_t substeps, bool doubled)
{
    part x = {.n = 3, .nb = 2, .p = 2, .substeps = substeps, .implicit = true, .doubled = doubled,
              .scheme = generalized_alpha(0.6), .h = 0.2,
              .M = {2.0, 0.25, 0.0, 0.25, 1.0, 0.25, 0.0, 0.25, 1.5},
              .C = {0.5, -0.125, 0.0, -0.125, 0.25, 0.0, 0.0, 0.0, 0.125},
              .K = {5.0, -2.0, 0.0, -2.0, 4.0, -2.0, 0.0, -2.0, 2.0},
              .L = {0.0, 1.0, 0.0, 0.0, -1.0, 1.0},
              .u0 = {1.0, 0.5, -0.5}, .v0 = {0.0, -1.0, 0.25}, .shape = {0.5, 0.0, -0.25}};
    return x;
}

static void start_three_dofs(part *x, node *naive)
{
    const double w0[3] = {0.5, -1.0, 2.0}, lam0[2] = {0.5, -0.25};
    x->load = (pma_load){.kind = PMA_LOAD_CONSTANT, .values = x->shape};
    make_part(x);
    pma_subdomain_start(x->core, x->u0, x->v0, w0, lam0);
    memcpy(naive->u, x->u0, sizeof naive->u);
    memcpy(naive->v, x->v0, sizeof naive->v);
    memcpy(naive->w, w0, sizeof naive->w);
    memcpy(naive->a, w0, sizeof naive->a);
    naive_store(x, false, lam0, naive);
}

/* One own step of both, towards own node k of the run; lam is anything but zero. */
static void step_both(part *x, size_t k, bool twice, node *naive)
{
    const size_t j = (k - 1) % x->substeps;
    const double lam[2] = {sin((double)k), cos(2.0 * (double)k)};
    const node *from = &naive[twice ? k - 2 : k - 1];
    double jump[2] = {1.0, 2.0}, theta = 0.25;
    pma_subdomain_open(x->core, j, twice, 0.0, (int64_t)k - 1);
    naive_free(x, twice, x->load.values, from, &naive[k]);
    pma_subdomain_free_velocity(x->core, j, theta, -2.0, jump);
    for (size_t row = 0; row < 2; row++) {
        const double vf = (1.0 - theta) * conditioned(x, row, naive[k - 1].vf) +
                          theta * conditioned(x, row, naive[k].vf);
        CHECK_NEAR(jump[row], 1.0 + (double)row - 2.0 * vf, AGREE);
    }
    CHECK_STATUS(pma_subdomain_close(x->core, j + 1, twice, lam), PMA_OK);
    naive_close(x, twice, lam, from, &naive[k]);
    check_state(x, pma_subdomain_at(x->core, j + 1), &naive[k]);
}

/* Naively all nodes are kept; the core has room for two or three, in turn. */
static void check_against_all_nodes(size_t substeps, bool doubled)
{
    part x = three_dofs(substeps, doubled);
    node naive[NODES];
    start_three_dofs(&x, &naive[0]);
    for (size_t macro = 0; macro < STEPS; macro++) {
        const size_t begin = macro * substeps, end = begin + substeps;
        check_state(&x, pma_subdomain_at(x.core, 0), &naive[begin]);
        for (size_t k = begin + 1; k <= end; k++)
            step_both(&x, k, doubled && macro > 0, naive);
        if (doubled && macro == 0) {
            const double lam[2] = {3.0, 4.0};
            pma_subdomain_rebase(x.core, substeps, lam);
            naive_store(&x, true, lam, &naive[end]);
        }
        pma_subdomain_commit(x.core);
    }
    pma_subdomain_destroy(x.core);
}

static void single_steps_are_those_of_a_program_that_keeps_all_nodes(void)
{
    for (size_t substeps = 1; substeps <= 5; substeps++)
        check_against_all_nodes(substeps, false);
}

static void double_steps_are_those_of_a_program_that_keeps_all_nodes(void)
{
    for (size_t substeps = 1; substeps <= 5; substeps++)
        check_against_all_nodes(substeps, true);
}

/* al2 L Mbar^-1 L^T lam, added to what is there, for h and for 2 h */
static void compliance_and_link_velocity_are_the_dense_product(void)
{
    part x = three_dofs(1, true);
    node naive;
    const double lam[2] = {1.5, -0.5};
    double wl[MOST];
    start_three_dofs(&x, &naive);
    for (int twice = 0; twice <= 1; twice++) {
        double out[2] = {1.0, 2.0}, jump[2] = {3.0, 4.0};
        pma_subdomain_compliance(x.core, twice, lam, out);
        pma_subdomain_link_velocity(x.core, twice, lam, jump);
        naive_link(&x, twice, lam, wl);
        for (size_t row = 0; row < 2; row++) {
            const double expected = al2_of(&x, twice) * conditioned(&x, row, wl);
            /* a 3 x 3 solve of condition below 10 */
            CHECK_NEAR(out[row], 1.0 + (double)row + expected, 100.0 * EPS);
            CHECK_NEAR(jump[row], 3.0 + (double)row + expected, 100.0 * EPS);
        }
    }
    pma_subdomain_destroy(x.core);
}

/* L = [0 1 0; 0 -1 1] and dyadic numbers: no rounding */
static void totals_on_the_interface_are_added_to_the_jump(void)
{
    part x = three_dofs(1, false);
    node naive;
    double jump[2] = {8.0, 16.0};
    start_three_dofs(&x, &naive);
    pma_subdomain_total_displacement(x.core, 0, jump);
    CHECK_BITS(2, jump, ((double[]){8.0 + 0.5, 16.0 - 0.5 - 0.5}));
    pma_subdomain_total_velocity(x.core, 0, jump);
    CHECK_BITS(2, jump, ((double[]){8.5 - 1.0, 15.0 + 1.0 + 0.25}));
    pma_subdomain_destroy(x.core);
}

/* The present of a subdomain, all four arrays. */
static size_t copy_present(const part *x, double *out)
{
    const pma_state *s = pma_subdomain_at(x->core, 0);
    const double *const arrays[4] = {s->u, s->v, s->w, s->a};
    for (size_t i = 0; i < 4; i++)
        memcpy(out + i * x->n, arrays[i], x->n * sizeof(double));
    return 4 * x->n;
}

/* own steps 1..count of a macro step, not committed */
static void walk(part *x, size_t count, bool twice)
{
    for (size_t j = 0; j < count; j++) {
        const double lam[2] = {1.0 + (double)j, -2.0};
        pma_subdomain_open(x->core, j, twice, 0.0, 0);
        CHECK_STATUS(pma_subdomain_close(x->core, j + 1, twice, lam), PMA_OK);
    }
}

/* Both walk two macro steps, one of them after `given_up` own steps that it never commits. */
static void check_given_up(size_t substeps, bool doubled, size_t given_up)
{
    part x = three_dofs(substeps, doubled), y = three_dofs(substeps, doubled);
    double before[4 * MOST], after[4 * MOST], jump_x[2] = {0.0}, jump_y[2] = {0.0};
    node naive;
    start_three_dofs(&x, &naive);
    start_three_dofs(&y, &naive);
    for (size_t macro = 0; macro < 3; macro++) {
        const size_t count = copy_present(&x, before);
        walk(&x, given_up, doubled && macro > 0);
        pma_subdomain_open(x.core, given_up, doubled && macro > 0, 0.0, 0);
        copy_present(&x, after);
        CHECK_BITS(count, after, before);
        walk(&x, substeps, doubled && macro > 0);
        walk(&y, substeps, doubled && macro > 0);
        pma_subdomain_free_velocity(x.core, 0, 0.5, 1.0, jump_x);
        pma_subdomain_free_velocity(y.core, 0, 0.5, 1.0, jump_y);
        pma_subdomain_commit(x.core);
        pma_subdomain_commit(y.core);
        copy_present(&x, after);
        copy_present(&y, before);
        CHECK_BITS(count, after, before);
    }
    CHECK_BITS(2, jump_x, jump_y);
    pma_subdomain_destroy(x.core);
    pma_subdomain_destroy(y.core);
}

static void an_unfinished_macro_step_leaves_the_present_untouched(void)
{
    for (size_t substeps = 1; substeps <= 4; substeps++) {
        for (size_t given_up = 0; given_up < substeps; given_up++) {
            check_given_up(substeps, false, given_up);
            check_given_up(substeps, true, given_up);
        }
    }
}

/* Nine free masses, a load at one of them: wherever it stands, a value that is not finite is seen;
 * on the interface, the last three, already before the step is closed. */
static void check_not_finite(size_t dof, double force, double velocity, bool fits)
{
    const double ones[SIZE] = {1, 1, 1, 1, 1, 1, 1, 1, 1}, zeros[SIZE] = {0.0};
    double F[SIZE] = {0.0}, v[SIZE] = {0.0};
    const pma_parts parts = {
        .n = SIZE, .nb = 3, .substeps = 1,
        .K = {PMA_DIAGONAL, SIZE, ones, NULL, NULL},
        .C = {PMA_ZERO, SIZE, NULL, NULL, NULL},
        .single = {pma_step_make(CENTRAL_DIFFERENCE, 0.5),
                   {.form = PMA_DIAGONAL, .n = SIZE, .nb = 3, .inverse = ones}},
        .link = {1, 3, (int64_t[]){0, 0, 0, 0}, NULL, NULL}};
    pma_subdomain *s = NULL;
    CHECK_STATUS(pma_subdomain_create(&parts, &s), PMA_OK);
    F[dof] = force;
    v[dof] = velocity;
    pma_subdomain_start(s, zeros, v, zeros, zeros);
    pma_subdomain_set_load(s, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = SIZE, .values = F});
    pma_subdomain_open(s, 0, false, 0.0, 0);
    CHECK_INT(pma_subdomain_free_is_finite(s, 1), fits || dof < SIZE - 3);
    CHECK_STATUS(pma_subdomain_close(s, 1, false, zeros), fits ? PMA_OK : PMA_NOT_FINITE);
    pma_subdomain_destroy(s);
}

static void a_value_that_is_not_finite_is_seen_at_every_dof(void)
{
    for (size_t dof = 0; dof < SIZE; dof++) {
        check_not_finite(dof, INFINITY, 0.0, false);
        check_not_finite(dof, -INFINITY, 0.0, false);
        check_not_finite(dof, NAN, 0.0, false);
        check_not_finite(dof, 1e300, 0.0, true);
        /* h = 1/2: u1 = h v and w1 = F - u1 fit, v1 = v + h/2 w1 is 9/8 of the largest number */
        check_not_finite(dof, DBL_MAX, DBL_MAX, false);
    }
}

/* ---- models: coupled parts, for the core and for the naive program --------------------------- */

typedef struct {
    part parts[PARTS];
    size_t count, p, fine;
    double dt;
    bool rebased;

    double H[2][CONDITIONS * CONDITIONS]; /* of the first macro step, of the later ones */
    double R[2][CONDITIONS * CONDITIONS], inverse[2][CONDITIONS];
    double lam0[CONDITIONS];
    pma_subdomain *subdomains[PARTS];
    int64_t moved_row;
    double moved[NODES]; /* prescribed velocity of that row, fine step by fine step */
    pma_motion motion;
    size_t motion_count; /* 0 or 1 */
    pma_coupler *coupler;

    node nodes[PARTS][NODES]; /* naive: every own node of every part, and Lam at every instant */
    double lam[NODES][CONDITIONS];
} model;

/* H = sum_i al2_i L_i Mbar_i^-1 L_i^T, the doubled ones with 2 h if `later`               (18) */
static pma_factor make_interface(model *m, bool later)
{
    double *H = m->H[later];
    memset(H, 0, sizeof m->H[later]);
    for (size_t i = 0; i < m->count; i++) {
        const part *x = &m->parts[i];
        const bool twice = later && x->doubled;
        for (size_t column = 0; column < m->p; column++) {
            double unit[CONDITIONS] = {0.0}, wl[MOST];
            unit[column] = 1.0;
            naive_link(x, twice, unit, wl);
            for (size_t row = 0; row < m->p; row++)
                H[row * m->p + column] += al2_of(x, twice) * conditioned(x, row, wl);
        }
    }
    naive_factor(m->p, H, m->R[later], m->inverse[later]);
    return (pma_factor){.form = PMA_DENSE, .n = m->p, .nb = m->p, .inverse = m->inverse[later],
                        .values = m->R[later]};
}

static pma_coupler_parts describe_coupler(model *m)
{
    return (pma_coupler_parts){.count = m->count, .subdomains = m->subdomains, .p = m->p,
                               .H_start = make_interface(m, false), .H = make_interface(m, true),
                               .dt = m->dt, .rebased = m->rebased,
                               .motion_count = m->motion_count, .motions = &m->motion};
}

/* g (p) at fine node k of the run; 0 at the start */
static void prescribe(const model *m, size_t k, double *g)
{
    memset(g, 0, m->p * sizeof(double));
    if (m->motion_count > 0 && k > 0)
        g[m->moved_row] = m->moved[k - 1];
}

/* M_i w_i - L_i^T Lam = F_i(0) - C_i v_i - K_i u_i and sum_i L_i w_i = 0                  (S1) */
static void solve_start(model *m)
{
    double A[LARGEST * LARGEST] = {0.0}, b[LARGEST] = {0.0}, F[MOST];
    size_t size = m->p, first = 0;
    for (size_t i = 0; i < m->count; i++)
        size += m->parts[i].n;
    for (size_t q = 0; q < m->count; first += m->parts[q++].n) {
        const part *x = &m->parts[q];
        naive_force(x, 0.0, 0, F);
        for (size_t i = 0; i < x->n; i++) {
            double *row = A + (first + i) * size;
            b[first + i] = x->load.kind == PMA_LOAD_TABLE ? 0.0 : F[i];
            for (size_t j = 0; j < x->n; j++) {
                row[first + j] = x->M[i * x->n + j];
                b[first + i] -= x->C[i * x->n + j] * x->v0[j] + x->K[i * x->n + j] * x->u0[j];
            }
            for (size_t c = 0; c < m->p; c++) {
                row[size - m->p + c] = -x->L[c * x->n + i];
                A[(size - m->p + c) * size + first + i] = x->L[c * x->n + i];
            }
        }
    }
    naive_solve(size, A, b);
    memcpy(m->lam0, b + size - m->p, m->p * sizeof(double));
    first = 0;
    for (size_t q = 0; q < m->count; first += m->parts[q++].n)
        memcpy(m->nodes[q][0].w, b + first, m->parts[q].n * sizeof(double));
}

/* Both programs stand at t = 0. */
static void start_model(model *m)
{
    solve_start(m);
    for (size_t i = 0; i < m->count; i++) {
        part *x = &m->parts[i];
        node *first = &m->nodes[i][0];
        memcpy(first->u, x->u0, sizeof first->u);
        memcpy(first->v, x->v0, sizeof first->v);
        memcpy(first->a, first->w, sizeof first->a);
        naive_store(x, false, m->lam0, first);
        pma_subdomain_start(x->core, x->u0, x->v0, first->w, m->lam0);
    }
    const double g0[CONDITIONS] = {0.0};
    pma_coupler_start(m->coupler, 0, m->lam0, g0);
}

/* The parts are filled in; made, coupled and started. */
static void make_model(model *m)
{
    m->fine = 1;
    for (size_t i = 0; i < m->count; i++)
        m->fine = m->parts[i].substeps > m->fine ? m->parts[i].substeps : m->fine;
    for (size_t i = 0; i < m->count; i++) {
        m->parts[i].h = m->dt / (double)m->parts[i].substeps;
        make_part(&m->parts[i]);
        m->subdomains[i] = m->parts[i].core;
    }
    const pma_coupler_parts parts = describe_coupler(m);
    CHECK_STATUS(pma_coupler_create(&parts, &m->coupler), PMA_OK);
    start_model(m);
}

static void destroy_model(model *m)
{
    pma_coupler_destroy(m->coupler);
    for (size_t i = 0; i < m->count; i++)
        pma_subdomain_destroy(m->parts[i].core);
}

/* What there is to see of the present, in a row; all of it must be alike for "bit for bit". */
typedef struct {
    size_t count;
    double values[PARTS * 4 * MOST + CONDITIONS];
} snapshot;

static snapshot present(const model *m)
{
    snapshot s = {.count = 0};
    for (size_t i = 0; i < m->count; i++)
        s.count += copy_present(&m->parts[i], s.values + s.count);
    memcpy(s.values + s.count, pma_coupler_multipliers(m->coupler), m->p * sizeof(double));
    s.count += m->p;
    return s;
}

static void check_same_present(const model *m, const snapshot *expected)
{
    const snapshot actual = present(m);
    CHECK_INT(actual.count, expected->count);
    CHECK_BITS(actual.count, actual.values, expected->values);
}

/* One oscillator cut in two: A implicit, double on request; B explicit or as A. Masses
 * and stiffnesses are shared unequally, so that the multiplier has work to do. */
typedef struct {
    double dt;
    size_t substeps; /* of B */
    bool doubled, same;
    pma_scheme A, B;
} split;

static const double M_A = 3.0, M_B = 1.0, K_A = 10.0, K_B = 30.0, OMEGA = 3.16227766016837933;

static void make_oscillator(model *m, split s)
{
    *m = (model){.count = 2, .p = 1, .dt = s.dt, .rebased = true};
    m->parts[0] = one_mass(M_A, K_A, 1.0, s.A, true);
    m->parts[1] = one_mass(M_B, K_B, -1.0, s.B, s.same);
    m->parts[0].doubled = s.doubled;
    m->parts[1].substeps = s.substeps;
    m->parts[0].u0[0] = m->parts[1].u0[0] = 1.0;
    make_model(m);
}

/* Three parts in a chain under loads of three kinds: A implicit, damped, sampled load with shape; B
 * explicit with both dofs on the interface, a table; C trapezoidal with a full mass matrix, a
 * constant load. The velocity is 1 everywhere, so the ties are satisfied. */
typedef struct {
    size_t substeps[PARTS];
    bool A_doubled, C_doubled, rebased, moved;
} plan;

static void fill_loads(model *m, double scale)
{
    part *A = &m->parts[0], *B = &m->parts[1], *C = &m->parts[2];
    const double shape[6] = {1.0, 0.0, 0.5, 0.0, -1.0, 0.0};
    memcpy(A->shape, shape, sizeof shape);
    uint64_t seed = 7;
    for (size_t i = 0; i < NODES * MOST; i++) {
        A->loads[i] = scale * draw_eighth(&seed);
        B->loads[i] = scale * draw_eighth(&seed);
    }
    C->loads[0] = scale * 0.5;
    C->loads[1] = -scale;
    A->load = (pma_load){.kind = PMA_LOAD_SAMPLED, .values = A->loads, .shape = A->shape,
                         .samples = NODES, .k = 2, .dt = 0.11};
    B->load = (pma_load){.kind = PMA_LOAD_TABLE, .values = B->loads, .rows = NODES};
    C->load = (pma_load){.kind = PMA_LOAD_CONSTANT, .values = C->loads};
    for (size_t k = 0; k < NODES; k++)
        m->moved[k] = scale * draw_eighth(&seed) / 8.0;
    m->moved_row = 1;
    m->motion = (pma_motion){&m->moved_row, {.kind = PMA_LOAD_TABLE, .n = 1, .values = m->moved,
                                             .rows = NODES}};
}

/* Initial values and loads times `scale`. */
static void make_chain(model *m, plan chosen, double scale)
{
    *m = (model){.count = 3, .p = 2, .dt = 0.3, .rebased = chosen.rebased,
                 .motion_count = chosen.moved};
    m->parts[0] = (part){.n = 3, .nb = 1, .implicit = true, .doubled = chosen.A_doubled,
                         .scheme = generalized_alpha(0.5), .M = {2, 0, 0, 0, 1.5, 0, 0, 0, 1},
                         .C = {0.5, -0.25, 0, -0.25, 0.5, -0.25, 0, -0.25, 0.25},
                         .K = {5, -2, 0, -2, 4, -2, 0, -2, 2}, .L = {0, 0, 1, 0, 0, 0}};
    m->parts[1] = (part){.n = 2, .nb = 2, .scheme = generalized_alpha(0.8), .M = {1, 0, 0, 1},
                         .C = {0.25, 0, 0, 0}, .K = {3, -2, -2, 3}, .L = {-1, 0, 0, 1}};
    m->parts[2] = (part){.n = 2, .nb = 1, .implicit = true, .doubled = chosen.C_doubled,
                         .scheme = TRAPEZOIDAL, .M = {1, 0.25, 0.25, 1},
                         .K = {4, -2, -2, 2}, .L = {0, 0, 0, -1}};
    const double u0[PARTS][MOST] = {{0.25, -0.5, 1.0}, {1.0, 0.5}, {0.75, 0.5}};
    for (size_t i = 0; i < PARTS; i++) {
        m->parts[i].p = 2;
        m->parts[i].substeps = chosen.substeps[i];
        for (size_t k = 0; k < m->parts[i].n; k++) {
            m->parts[i].u0[k] = scale * u0[i][k];
            m->parts[i].v0[k] = scale;
        }
    }
    fill_loads(m, scale);
    make_model(m);
}

/* everybody with another step, double steps, and a prescribed velocity between B and C */
static const plan MIXED = {{2, 6, 3}, true, true, true, true};

/* ---- the naive coupler: docs/method.md 5 and 6 as written ------------------------------------ */

/* L vf of part i at fine node k, in mid-step interpolated; opens the step that begins at k - 1. */
static void naive_free_velocity(model *m, size_t i, size_t k, double *jump)
{
    const part *x = &m->parts[i];
    const size_t ratio = m->fine / x->substeps, next = (k + ratio - 1) / ratio;
    node *to = &m->nodes[i][next], *last = to - 1;
    if ((k - 1) % ratio == 0) {
        const bool twice = x->doubled && k > m->fine;
        double F[MOST];
        naive_force(x, (double)(next * ratio) / (double)m->fine * m->dt, next - 1, F);
        naive_free(x, twice, F, twice ? to - 2 : last, to);
    }
    const double theta = (double)(k - (next - 1) * ratio) / (double)ratio;
    for (size_t row = 0; row < m->p; row++)
        jump[row] += (1.0 - theta) * conditioned(x, row, last->vf) +
                     theta * conditioned(x, row, to->vf);
}

/* Those with a node of their own at k take Lam. */
static void naive_arrive(model *m, size_t i, size_t k)
{
    const part *x = &m->parts[i];
    const size_t ratio = m->fine / x->substeps;
    const bool twice = x->doubled && k > m->fine;
    node *to = &m->nodes[i][k / ratio];
    if (k % ratio != 0)
        return;
    naive_close(x, twice, m->lam[k], twice ? to - 2 : to - 1, to);
    if (k == m->fine && x->doubled && m->rebased)
        naive_store(x, true, m->lam[k], to);
}

static void naive_run(model *m, size_t steps)
{
    memcpy(m->lam[0], m->lam0, sizeof m->lam0);
    for (size_t k = 1; k <= steps * m->fine; k++) {
        double jump[CONDITIONS] = {0.0};
        prescribe(m, k, m->lam[k]);
        for (size_t i = 0; i < m->count; i++)
            naive_free_velocity(m, i, k, jump);
        for (size_t row = 0; row < m->p; row++)
            m->lam[k][row] -= jump[row];
        naive_solve(m->p, m->H[k > m->fine], m->lam[k]);
        for (size_t i = 0; i < m->count; i++)
            naive_arrive(m, i, k);
    }
}

/* ---- records --------------------------------------------------------------------------------- */

/* Memory for a record of everything, NaN where nothing was written. */
typedef struct {
    pma_record record;
    pma_record_nodes nodes[PARTS];
    int64_t position[MOST];
    double u[PARTS][NODES * MOST], v[PARTS][NODES * MOST], w[PARTS][NODES * MOST];
    double lam[NODES * CONDITIONS], velocity[NODES * CONDITIONS], displacement[NODES * CONDITIONS];
} tape;

static void make_tape(tape *t, const model *m, int64_t begin, int64_t every)
{
    memset(t, 0xff, sizeof *t); /* all bits set: NaN */
    for (size_t i = 0; i < MOST; i++)
        t->position[i] = (int64_t)i;
    for (size_t i = 0; i < m->count; i++)
        t->nodes[i] =
            (pma_record_nodes){m->parts[i].n, t->position, t->u[i], t->v[i], t->w[i]};
    t->record = (pma_record){.begin = begin,
                             .every = every,
                             .nodes = t->nodes,
                             .multipliers = t->lam,
                             .velocity_jump = t->velocity,
                             .displacement_jump = t->displacement};
}

/* The present into row 0, then `steps` macro steps. */
static void run_taped(model *m, tape *t, int64_t steps)
{
    pma_coupler_record_present(m->coupler, &t->record);
    CHECK_STATUS(pma_coupler_advance(m->coupler, steps, &t->record, NULL), PMA_OK);
}

static void the_row_of_a_node_follows_from_its_number(void)
{
    const pma_record all = {.begin = 4, .every = 0}, third = {.begin = 4, .every = 3};
    CHECK_INT(pma_record_row(&all, 4, 1, 5), 1);
    CHECK_INT(pma_record_row(&all, 4, 5, 5), 5);
    CHECK_INT(pma_record_row(&all, 6, 2, 5), 12);
    CHECK_INT(pma_record_row(&third, 5, 5, 5), 1); /* macro node 6, row 0 is macro node 4 */
    CHECK_INT(pma_record_row(&third, 8, 5, 5), 2); /* macro node 9 */
    CHECK_INT(pma_record_row(&third, 5, 4, 5), PMA_NO_ROW);
    CHECK_INT(pma_record_row(&third, 4, 5, 5), PMA_NO_ROW);
    CHECK_INT(pma_record_row(&third, 6, 5, 5), PMA_NO_ROW);
    const pma_record begun_at_one = {.begin = 6, .every = 3};
    CHECK_INT(pma_record_row(&begun_at_one, 8, 1, 1), 1);
}

static void the_chosen_dofs_of_a_state_are_copied_in_the_order_asked_for(void)
{
    double u[3] = {1, 2, 3}, v[3] = {4, 5, 6}, w[3] = {7, 8, 9};
    double to_u[6] = {0}, to_v[6] = {0}, to_w[6] = {0};
    const pma_record_nodes nodes = {2, (int64_t[]){2, 0}, to_u, to_v, to_w};
    pma_record_state(&nodes, &(pma_state){u, v, w, NULL}, 1);
    CHECK_BITS(6, to_u, ((double[]){0, 0, 3, 1, 0, 0}));
    CHECK_BITS(6, to_v, ((double[]){0, 0, 6, 4, 0, 0}));
    CHECK_BITS(6, to_w, ((double[]){0, 0, 9, 7, 0, 0}));
}

/* Both programs, all nodes of all parts and all instants. */
static void check_against_naive_coupler(plan chosen)
{
    static model m;
    static tape t;
    make_chain(&m, chosen, 1.0);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    naive_run(&m, STEPS);
    for (size_t i = 0; i < m.count; i++) {
        const part *x = &m.parts[i];
        for (size_t row = 0; row <= STEPS * x->substeps; row++) {
            for (size_t k = 0; k < x->n; k++) {
                CHECK_NEAR(t.u[i][row * x->n + k], m.nodes[i][row].u[k], AGREE);
                CHECK_NEAR(t.v[i][row * x->n + k], m.nodes[i][row].v[k], AGREE);
                CHECK_NEAR(t.w[i][row * x->n + k], m.nodes[i][row].w[k], AGREE);
            }
        }
        check_state(x, pma_subdomain_at(x->core, 0), &m.nodes[i][STEPS * x->substeps]);
    }
    for (size_t k = 0; k <= STEPS * m.fine; k++) {
        for (size_t row = 0; row < m.p; row++)
            CHECK_NEAR(t.lam[k * m.p + row], m.lam[k][row], AGREE);
    }
    for (size_t k = 0; k <= STEPS; k++) {
        for (size_t row = 0; row < m.p; row++) {
            double jump = 0.0;
            for (size_t i = 0; i < m.count; i++)
                jump += conditioned(&m.parts[i], row, m.nodes[i][k * m.parts[i].substeps].u);
            CHECK_NEAR(t.displacement[k * m.p + row], jump, AGREE);
        }
    }
    destroy_model(&m);
}

static void gc_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, false, false, true, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, false});
    check_against_naive_coupler((plan){{6, 3, 1}, false, false, true, false});
    check_against_naive_coupler((plan){{1, 6, 2}, false, false, true, true});
}

static void pm_is_the_schedule_as_it_is_written(void)
{
    check_against_naive_coupler((plan){{1, 1, 1}, true, false, true, false});
    check_against_naive_coupler((plan){{1, 4, 2}, true, false, true, false});
    check_against_naive_coupler((plan){{3, 6, 1}, true, true, true, false});
    check_against_naive_coupler(MIXED);
    check_against_naive_coupler((plan){{2, 6, 3}, true, true, false, false});
}

static void check_rows_alike(const tape *few, const tape *all, const model *m, size_t row,
                             size_t macro)
{
    for (size_t i = 0; i < m->count; i++) {
        const size_t n = m->parts[i].n, from = macro * m->parts[i].substeps * n;
        CHECK_BITS(n, few->u[i] + row * n, all->u[i] + from);
        CHECK_BITS(n, few->v[i] + row * n, all->v[i] + from);
        CHECK_BITS(n, few->w[i] + row * n, all->w[i] + from);
    }
    const size_t p = m->p, from = macro * m->fine * p;
    CHECK_BITS(p, few->lam + row * p, all->lam + from);
    CHECK_BITS(p, few->velocity + row * p, all->velocity + from);
    CHECK_BITS(p, few->displacement + row * p, all->displacement + macro * p);
}

/* From macro step `begin` on: row 0 is `begin`, row i + 1 the i-th later multiple of three. */
static void check_every_third(int64_t begin, const tape *all, const double *untouched)
{
    static model m;
    static tape few;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, begin, NULL, NULL), PMA_OK);
    make_tape(&few, &m, begin, 3);
    run_taped(&m, &few, STEPS - begin);
    size_t row = 0;
    check_rows_alike(&few, all, &m, row++, (size_t)begin);
    for (size_t macro = (size_t)begin + 1; macro <= STEPS; macro++) {
        if (macro % 3 == 0)
            check_rows_alike(&few, all, &m, row++, macro);
    }
    for (size_t i = 0; i < m.count; i++)
        CHECK_BITS(m.parts[i].n, few.u[i] + row * m.parts[i].n, untouched);
    CHECK_BITS(m.p, few.lam + row * m.p, untouched);
    CHECK_BITS(m.p, few.velocity + row * m.p, untouched);
    CHECK_BITS(m.p, few.displacement + row * m.p, untouched);
    destroy_model(&m);
}

static void every_third_macro_node_is_recorded_wherever_the_stretch_begins(void)
{
    static model m;
    static tape all;
    double untouched[MOST];
    memset(untouched, 0xff, sizeof untouched);
    make_chain(&m, MIXED, 1.0);
    make_tape(&all, &m, 0, 0);
    run_taped(&m, &all, STEPS);
    for (int64_t begin = 0; begin <= 5; begin++)
        check_every_third(begin, &all, untouched);
    destroy_model(&m);
}

/* A stretch that begins later continues the rows of one that began at 0. */
static void a_record_of_all_nodes_may_begin_in_the_middle(void)
{
    static model m, n;
    static tape all, late;
    make_chain(&m, MIXED, 1.0);
    make_chain(&n, MIXED, 1.0);
    make_tape(&all, &m, 0, 0);
    make_tape(&late, &n, 3, 0);
    run_taped(&m, &all, STEPS);
    CHECK_STATUS(pma_coupler_advance(n.coupler, 3, NULL, NULL), PMA_OK);
    run_taped(&n, &late, STEPS - 3);
    for (size_t i = 0; i < m.count; i++) {
        const size_t own = m.parts[i].n, skipped = 3 * m.parts[i].substeps * own;
        CHECK_BITS((STEPS - 3) * m.parts[i].substeps * own + own, late.u[i], all.u[i] + skipped);
    }
    CHECK_BITS(((STEPS - 3) * FINE + 1) * m.p, late.lam, all.lam + 3 * FINE * m.p);
    CHECK_BITS((STEPS - 3 + 1) * m.p, late.displacement, all.displacement + 3 * m.p);
    destroy_model(&m);
    destroy_model(&n);
}

/* Without conditions, and of a part nobody asks about, no array is touched: NULL will do. */
static void a_run_without_conditions_leaves_the_interface_arrays_alone(void)
{
    static model m;
    double u[3] = {0}, v[3] = {0}, w[3] = {0};
    pma_record_nodes nodes[2] = {{1, (int64_t[]){0}, u, v, w}, {0, NULL, u, v, w}};
    const pma_record record = {.begin = 0, .every = 1, .nodes = nodes};
    m = (model){.count = 2, .dt = 0.5};
    m.parts[0] = one_mass(1.0, 4.0, 0.0, TRAPEZOIDAL, true); /* omega h = 1 */
    m.parts[1] = one_mass(1.0, 1.0, 0.0, CENTRAL_DIFFERENCE, false);
    m.parts[0].u0[0] = 1.0;
    make_model(&m);
    pma_coupler_record_present(m.coupler, &record);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, &record, NULL), PMA_OK);
    const double q = 2.0 * atan(0.5);
    for (size_t n = 0; n <= 2; n++)
        CHECK_NEAR(u[n], cos((double)n * q), 10.0 * EPS); /* two steps of a few roundings */
    destroy_model(&m);
}

/* ---- what the coupled method has to come out with -------------------------------------------- */

/* Both sides under one and the same rule have the same predictors, so the tie never has to correct
 * them: the cut oscillator is the whole one, of frequency tan(q/2) = omega h/2 and constant energy.
 * Rounding: as for the free oscillator, and a division by h = 0.1. */
static void two_trapezoidal_halves_under_gc_are_the_whole_oscillator(void)
{
    static model m;
    make_oscillator(&m, (split){.dt = 0.1, .substeps = 1, .same = true, .A = TRAPEZOIDAL,
                                .B = TRAPEZOIDAL});
    const double q = 2.0 * atan(OMEGA * 0.1 / 2.0), tolerance = 10.0 * SWING_TOLERANCE;
    for (size_t n = 0; n <= SWINGS; n++) {
        const pma_state *A = pma_subdomain_at(m.parts[0].core, 0);
        const pma_state *B = pma_subdomain_at(m.parts[1].core, 0);
        CHECK_NEAR(A->u[0], cos((double)n * q), tolerance);
        CHECK_NEAR(B->u[0], cos((double)n * q), tolerance);
        CHECK_NEAR(A->v[0], -OMEGA * sin((double)n * q), OMEGA * tolerance);
        CHECK_NEAR(A->v[0], B->v[0], 16.0 * EPS * OMEGA);
        const double energy = 0.5 * M_A * A->v[0] * A->v[0] + 0.5 * M_B * B->v[0] * B->v[0] +
                              0.5 * K_A * A->u[0] * A->u[0] + 0.5 * K_B * B->u[0] * B->u[0];
        CHECK_NEAR(energy, 20.0, 20.0 * tolerance);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    destroy_model(&m);
}

/* A trapezoidal, B by the central difference, h = dt: with equal v both have equal w, and the two
 * updates of u leave u_A = u_B + h^2/4 (w_n - w_0). In (1) that is a central difference alone,
 * with the mass m = m_A + m_B + k_A h^2/4 and the constant load k_A h^2/4 w_0:
 * u_B = c + (u_0 - c) cos(n q), cos q = 1 - h^2 k/(2 m), c = k_A h^2/4 w_0/k, u_0 = 1 */
static void trapezoidal_and_central_difference_under_gc_have_a_closed_form(void)
{
    static model m;
    const double h = 0.1, k = K_A + K_B, mass = M_A + M_B + K_A * h * h / 4.0;
    const double w0 = -OMEGA * OMEGA, c = K_A * h * h / 4.0 * w0 / k;
    const double q = acos(1.0 - h * h * k / (2.0 * mass)), tolerance = 10.0 * SWING_TOLERANCE;
    make_oscillator(&m, (split){.dt = h, .substeps = 1, .A = TRAPEZOIDAL,
                                .B = CENTRAL_DIFFERENCE});
    for (size_t n = 0; n <= SWINGS; n++) {
        const pma_state *A = pma_subdomain_at(m.parts[0].core, 0);
        const pma_state *B = pma_subdomain_at(m.parts[1].core, 0);
        const double cosine = (1.0 - c) * cos((double)n * q), w = -k / mass * cosine;
        CHECK_NEAR(B->u[0], c + cosine, tolerance);
        CHECK_NEAR(A->u[0] - B->u[0], h * h / 4.0 * (w - w0), tolerance);
        CHECK_NEAR(B->v[0], -(1.0 - c) * sin((double)n * q) * sin(q) / h, OMEGA * tolerance);
        CHECK_NEAR(A->v[0], B->v[0], 16.0 * EPS * OMEGA);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    destroy_model(&m);
}

/* The same pair under PM, A from n - 1 to n + 1. With v_n = V e^{iqn} the updates give
 *   w_A = i tan(q)/h V,  u_A = h cos(q)/(i sin q) V,  w_B = 2i tan(q/2)/h V,  u_B = h/(i sin q) V
 * and (1), summed over the parts, with c = cos q:
 *   (m_A + 2 m_B + h^2 k_A) c^2 - (2 m_B - h^2 k_B) c - m_A = 0
 * Both roots lie in [-1, 1], near 1 the oscillator, the other the two chains of A. The remaining
 * eigenvalues, 1 and -1, have no part in v. So (E^2 - 2 c_1 E + 1)(E^2 - 2 c_2 E + 1) v = 0. */
static void trapezoidal_and_central_difference_under_pm_have_a_closed_form(void)
{
    static model m;
    const double h = 0.1, lead = M_A + 2.0 * M_B + h * h * K_A;
    const double sum = (2.0 * M_B - h * h * K_B) / lead, product = -M_A / lead;
    double v[SWINGS + 1], most = 0.0;
    make_oscillator(&m, (split){.dt = h, .substeps = 1, .doubled = true, .A = TRAPEZOIDAL,
                                .B = CENTRAL_DIFFERENCE});
    for (size_t n = 0; n <= SWINGS; n++) {
        v[n] = pma_subdomain_at(m.parts[1].core, 0)->v[0];
        most = fmax(most, fabs(v[n]));
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    for (size_t n = 1; n + 4 <= SWINGS; n++) {
        /* five steps of some twenty roundings, of terms up to 4 omega */
        CHECK_NEAR(v[n] - 2.0 * sum * v[n + 1] + (2.0 + 4.0 * product) * v[n + 2] -
                       2.0 * sum * v[n + 3] + v[n + 4], 0.0, 400.0 * EPS * OMEGA);
    }
    CHECK_NEAR(most, OMEGA, 0.1 * OMEGA); /* it swings, and nothing grows */
    destroy_model(&m);
}

/* The largest error of the velocity of B at macro nodes over one period, over omega u0. */
static double velocity_error(split s, size_t steps)
{
    static model m;
    double worst = 0.0;
    s.dt = 2.0 * PI / OMEGA / (double)steps;
    make_oscillator(&m, s);
    for (size_t n = 1; n <= steps; n++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const double v = pma_subdomain_at(m.parts[1].core, 0)->v[0] / OMEGA;
        worst = fmax(worst, fabs(v + sin(2.0 * PI * (double)n / (double)steps)));
    }
    destroy_model(&m);
    return worst;
}

/* Halving dt divides the error by 2^order, up to a relative O(omega dt), here 0.016. */
static void check_order(size_t substeps, bool doubled, pma_scheme A, pma_scheme B, double order)
{
    const split s = {.substeps = substeps, .doubled = doubled, .A = A, .B = B};
    const double factor = velocity_error(s, 400) / velocity_error(s, 800);
    CHECK_NEAR(factor, exp2(order), 0.02 * exp2(order));
}

static void the_order_is_two_without_subcycling_and_one_with_it(void)
{
    const pma_scheme half = generalized_alpha(0.5);
    for (int pm = 0; pm <= 1; pm++) {
        check_order(1, pm, TRAPEZOIDAL, CENTRAL_DIFFERENCE, 2.0);
        check_order(1, pm, half, half, 2.0);
        check_order(4, pm, TRAPEZOIDAL, CENTRAL_DIFFERENCE, 1.0);
        check_order(4, pm, half, half, 1.0);
    }
}

/* The error of Lam(t) = (k_A - m_A omega^2) cos(omega t) after two macro steps, over its size. */
static double multiplier_error(double dt, bool rebased)
{
    static model m;
    make_oscillator(&m, (split){.dt = dt, .substeps = 4, .doubled = true,
                                .A = generalized_alpha(0.5), .B = generalized_alpha(0.5)});
    pma_coupler_parts parts = describe_coupler(&m);
    parts.rebased = rebased;
    pma_coupler_destroy(m.coupler);
    CHECK_STATUS(pma_coupler_create(&parts, &m.coupler), PMA_OK);
    start_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 2, NULL, NULL), PMA_OK);
    const double exact = (K_A - M_A * OMEGA * OMEGA) * cos(2.0 * OMEGA * dt);
    const double error = fabs(pma_coupler_multipliers(m.coupler)[0] / exact - 1.0);
    destroy_model(&m);
    return error;
}

/* (S3): without it the misfit of vf, O(h), is divided by h in (18) and never shrinks. */
static void a_rebased_start_converges_and_a_plain_one_does_not(void)
{
    const double dt = 1e-3, factor = 8.0;
    const double rebased = multiplier_error(factor * dt, true) / multiplier_error(dt, true);
    const double plain = multiplier_error(factor * dt, false) / multiplier_error(dt, false);
    CHECK(rebased > 0.9 * factor); /* O(dt) at least */
    CHECK_NEAR(plain, 1.0, 10.0 * factor * OMEGA * dt); /* O(1), up to O(omega dt) */
    CHECK(multiplier_error(dt, false) > 0.01);
}

/* Undamped oscillation is the worst case for rho = 0.5: nothing may grow, and since the step is
 * long for A (omega dt = 1), the dissipation of the scheme must show. */
static void pm_alpha_dissipates_in_the_long_run(void)
{
    static model m;
    double early = 0.0, late = 0.0;
    make_oscillator(&m, (split){.dt = 1.0 / OMEGA, .substeps = 5, .doubled = true,
                                .A = generalized_alpha(0.5), .B = generalized_alpha(0.5)});
    for (size_t n = 0; n < 2000; n++) {
        const double v = fabs(pma_subdomain_at(m.parts[1].core, 0)->v[0]);
        early = n < 20 ? fmax(early, v) : early;
        late = n >= 1980 ? fmax(late, v) : late;
        CHECK(v < 2.0 * OMEGA);
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
    }
    CHECK(late < 1e-3 * early);
    destroy_model(&m);
}

/* One mass whose velocity is prescribed, v = t: u = t^2/2 and Lam = m + k t^2/2, exact for the
 * trapezoidal rule, to which the acceleration is a constant. After t = 1 another motion, v = 1/2:
 * the rule takes v from 1 to 1/2 in one step h = 0.1 by w = -1 - 1/h = -11, after that w = +-11. */
static void a_prescribed_velocity_is_followed(void)
{
    static model m;
    const double ramp[2] = {0.0, 1.0}, half = 0.5, zero = 0.0, w0 = 1.0, lam0 = 2.0;
    m = (model){.count = 1, .p = 1, .dt = 0.1, .motion_count = 1};
    m.motion = (pma_motion){&m.moved_row, {.kind = PMA_LOAD_SAMPLED, .n = 1, .values = ramp,
                                           .samples = 2, .k = 1, .dt = 1.0}};
    m.parts[0] = one_mass(2.0, 3.0, 1.0, TRAPEZOIDAL, true);
    make_model(&m);
    pma_subdomain_start(m.parts[0].core, &zero, &zero, &w0, &lam0);
    pma_coupler_start(m.coupler, 0, &lam0, &zero);
    for (int n = 1; n <= 20; n++) {
        if (n == 11)
            pma_coupler_set_motion(
                m.coupler, 0, (pma_load){.kind = PMA_LOAD_CONSTANT, .n = 1, .values = &half});
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        const double t = 0.1 * n, u = n <= 10 ? t * t / 2.0 : t / 2.0 + 0.025;
        const double w = n <= 10 ? 1.0 : n % 2 ? -11.0 : 11.0;
        const pma_state *x = pma_subdomain_at(m.parts[0].core, 0);
        /* 20 steps of a few roundings each; in w and Lam times 2/h = 20 and all alternating */
        CHECK_NEAR(x->v[0], n <= 10 ? t : half, 16.0 * EPS);
        CHECK_NEAR(x->u[0], u, 100.0 * EPS);
        CHECK_NEAR(x->w[0], w, 5000.0 * EPS);
        CHECK_NEAR(pma_coupler_multipliers(m.coupler)[0], 2.0 * w + 3.0 * u, 10000.0 * EPS);
    }
    destroy_model(&m);
}

/* Also in mid-step of the others. A jump is a difference of velocities, each of a few roundings of
 * terms up to 4, and so is what Lam leaves of it. */
static void check_jump(plan chosen)
{
    static model m;
    static tape t;
    make_chain(&m, chosen, 1.0);
    make_tape(&t, &m, 0, 0);
    run_taped(&m, &t, STEPS);
    double most = 0.0, drift = 0.0;
    for (size_t i = 0; i < (STEPS * m.fine + 1) * m.p; i++) {
        CHECK_NEAR(t.velocity[i], 0.0, 64.0 * EPS);
        most = fmax(most, fabs(t.lam[i]));
    }
    for (size_t i = 0; i < (STEPS + 1) * m.p; i++)
        drift = fmax(drift, fabs(t.displacement[i]));
    CHECK(most > 1.0 && drift > 1e-6); /* there was something to hold together */
    destroy_model(&m);
}

static void velocities_of_both_sides_agree_at_every_fine_step(void)
{
    check_jump((plan){{1, 6, 2}, false, false, true, false});
    check_jump((plan){{6, 3, 1}, false, false, true, false});
    check_jump((plan){{1, 4, 2}, true, false, true, false});
    check_jump((plan){{2, 6, 3}, true, true, false, false});
    check_jump(MIXED);
}

/* ---- the coupler as an object ---------------------------------------------------------------- */

static pma_status status_of(const pma_coupler_parts *parts)
{
    pma_coupler *made = (pma_coupler *)&made;
    const pma_status status = pma_coupler_create(parts, &made);
    CHECK_INT(made != NULL, status == PMA_OK);
    pma_coupler_destroy(made);
    return status;
}

static void a_coupler_with_sizes_that_do_not_agree_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts good = describe_coupler(&m);
    pma_coupler_parts bad[6] = {good, good, good, good, good, good};
    const int64_t ptr[3] = {0, 1, 1};
    const int32_t index = 2;
    CHECK_STATUS(status_of(&good), PMA_OK);
    bad[0].p = 1;
    bad[1].H_start.n = 1;
    bad[2].H_start.nb = 1;
    bad[3].H.n = bad[3].H.nb = 3;
    bad[4].H.nb = 0;
    for (size_t i = 0; i < 5; i++)
        CHECK_STATUS(status_of(&bad[i]), PMA_BAD_SIZE);
    for (int later = 0; later <= 1; later++) {
        bad[5] = good;
        *(later ? &bad[5].H : &bad[5].H_start) =
            (pma_factor){.form = PMA_SPARSE, .n = 2, .nb = 2, .inverse = m.inverse[0],
                         .values = m.R[0], .ptr = ptr, .index = &index};
        CHECK_STATUS(status_of(&bad[5]), PMA_BAD_INDEX);
    }
    destroy_model(&m);
    pma_coupler_destroy(NULL);
}

static void a_motion_of_rows_that_do_not_exist_is_refused(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    const pma_coupler_parts parts = describe_coupler(&m);
    const int64_t many[3] = {0, 1, 0};
    CHECK_STATUS(status_of(&parts), PMA_OK);
    m.moved_row = 2;
    CHECK_STATUS(status_of(&parts), PMA_BAD_INDEX);
    m.moved_row = -1;
    CHECK_STATUS(status_of(&parts), PMA_BAD_INDEX);
    m.motion = (pma_motion){many, {.kind = PMA_LOAD_NONE, .n = 2}};
    CHECK_STATUS(status_of(&parts), PMA_OK);
    m.motion.load.n = 3;
    CHECK_STATUS(status_of(&parts), PMA_BAD_SIZE);
    destroy_model(&m);
}

static void a_coupler_of_a_subdomain_with_other_conditions_is_refused(void)
{
    static model m, n;
    make_chain(&m, MIXED, 1.0);
    make_oscillator(&n, (split){0.1, 1, false, false, TRAPEZOIDAL, CENTRAL_DIFFERENCE});
    pma_coupler_parts parts = describe_coupler(&m);
    m.subdomains[2] = n.parts[0].core;
    CHECK_STATUS(status_of(&parts), PMA_BAD_SIZE);
    m.subdomains[2] = m.parts[2].core;
    CHECK_STATUS(status_of(&parts), PMA_OK);
    destroy_model(&m);
    destroy_model(&n);
}

/* Two single masses without an interface, with these substeps. */
static pma_status status_of_substeps(size_t first, size_t second)
{
    const double H = 1.0;
    part x = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true), y = x;
    x.substeps = first;
    y.substeps = second;
    make_part(&x);
    make_part(&y);
    pma_subdomain *both[2] = {x.core, y.core};
    const pma_factor none = {.form = PMA_DIAGONAL, .inverse = &H};
    const pma_coupler_parts parts = {.count = 2, .subdomains = both, .H_start = none, .H = none,
                                     .dt = 0.1};
    const pma_status status = status_of(&parts);
    pma_subdomain_destroy(x.core);
    pma_subdomain_destroy(y.core);
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

/* ---- bit for bit ----------------------------------------------------------------------------- */

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
    const snapshot expected = present(&m);
    check_same_present(&n, &expected);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

/* Every step is linear in state and load, and a power of two passes every rounding. */
static void scaling_by_a_power_of_two_scales_every_bit(void)
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

static void a_second_start_forgets_the_first_run(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    start_model(&m);
    CHECK_INT(pma_coupler_step_count(m.coupler), 0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, NULL), PMA_OK);
    check_same_present(&m, &expected);
    destroy_model(&m);
}

static void copy_state(size_t n, const pma_state *from, const pma_state *to)
{
    memcpy(to->u, from->u, n * sizeof(double));
    memcpy(to->v, from->v, n * sizeof(double));
    memcpy(to->w, from->w, n * sizeof(double));
    memcpy(to->a, from->a, n * sizeof(double));
}

/* All nodes of one model into another, which goes on as if it had been there all the time. */
static void check_taken_over(plan chosen, int64_t after)
{
    static model m, n;
    make_chain(&m, chosen, 1.0);
    make_chain(&n, chosen, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
    for (size_t i = 0; i < m.count; i++) {
        const part *x = &m.parts[i];
        const pma_nodes from = pma_subdomain_nodes(x->core);
        const pma_nodes to = pma_subdomain_nodes(n.parts[i].core);
        copy_state(x->n, &from.present, &to.present);
        memcpy(to.vf, from.vf, x->nb * sizeof(double));
        CHECK_INT(from.previous.u != NULL, x->doubled);
        if (x->doubled)
            copy_state(x->n, &from.previous, &to.previous);
    }
    double g[CONDITIONS];
    prescribe(&m, (size_t)after * m.fine, g);
    pma_coupler_start(n.coupler, after, pma_coupler_multipliers(m.coupler), g);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS - after, NULL, NULL), PMA_OK);
    const snapshot expected = present(&m);
    check_same_present(&n, &expected);
    CHECK_INT(pma_coupler_step_count(n.coupler), STEPS);
    destroy_model(&m);
    destroy_model(&n);
}

static void a_run_goes_on_from_nodes_that_were_written(void)
{
    for (int64_t after = 0; after <= 3; after++) {
        check_taken_over(MIXED, after);
        check_taken_over((plan){{1, 4, 2}, true, false, true, false}, after);
    }
}

/* Against the naive program: the present, the own node before, and both free velocities. */
static void check_nodes(size_t substeps)
{
    static model m;
    make_chain(&m, (plan){{substeps, 6, 3}, true, true, true, true}, 1.0);
    naive_run(&m, 4);
    for (size_t macro = 1; macro <= 4; macro++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_OK);
        for (size_t i = 0; i < m.count; i++) {
            const part *x = &m.parts[i];
            const pma_nodes nodes = pma_subdomain_nodes(x->core);
            const node *now = &m.nodes[i][macro * x->substeps];
            check_state(x, &nodes.present, now);
            for (size_t b = 0; b < x->nb; b++)
                CHECK_NEAR(nodes.vf[b], now->vf[x->n - x->nb + b], AGREE);
            if (!x->doubled)
                continue;
            check_state(x, &nodes.previous, now - 1);
            for (size_t b = 0; b < x->nb; b++)
                CHECK_NEAR(nodes.vf_previous[b], (now - 1)->vf[x->n - x->nb + b], AGREE);
        }
    }
    destroy_model(&m);
}

static void the_nodes_of_a_subdomain_are_its_present_and_the_own_node_before(void)
{
    check_nodes(1);
    check_nodes(2);
    check_nodes(3);
    check_nodes(6);
}

/* ---- stopped --------------------------------------------------------------------------------- */

/* Stopped before fine step `stop_at` of the run, then to the end. */
static void check_stopped(size_t stop_at, const snapshot *at_macro, const tape *expected)
{
    static model m;
    static tape t;
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    asker a = {0, stop_at};
    const pma_poll poll = {ask, &a, 0};
    pma_coupler_record_present(m.coupler, &t.record);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, &t.record, &poll), PMA_STOPPED);
    const size_t whole = (stop_at - 1) / FINE;
    CHECK_INT(pma_coupler_step_count(m.coupler), whole);
    check_same_present(&m, &at_macro[whole]);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - (int64_t)whole, &t.record, &poll), PMA_OK);
    check_same_present(&m, &at_macro[STEPS]);
    for (size_t i = 0; i < m.count; i++)
        CHECK_BITS(NODES * MOST, t.w[i], expected->w[i]);
    CHECK_BITS(NODES * CONDITIONS, t.lam, expected->lam);
    CHECK_BITS(NODES * CONDITIONS, t.velocity, expected->velocity);
    destroy_model(&m);
}

static void a_stopped_run_stands_at_a_macro_step_and_goes_on_as_if_never_stopped(void)
{
    static model m;
    static tape t;
    snapshot at_macro[STEPS + 1];
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    pma_coupler_record_present(m.coupler, &t.record);
    at_macro[0] = present(&m);
    for (size_t i = 1; i <= STEPS; i++) {
        CHECK_STATUS(pma_coupler_advance(m.coupler, 1, &t.record, NULL), PMA_OK);
        at_macro[i] = present(&m);
    }
    for (size_t stop_at = 1; stop_at <= 4 * FINE; stop_at++)
        check_stopped(stop_at, at_macro, &t);
    destroy_model(&m);
}

/* How often a whole run asks, when it asks about every `entries` entries. */
static size_t count_questions(size_t entries)
{
    static model m;
    asker a = {0, 0};
    const pma_poll poll = {ask, &a, entries};
    make_chain(&m, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS, NULL, &poll), PMA_OK);
    destroy_model(&m);
    return a.asked;
}

static void a_run_asks_as_often_as_it_was_told_to(void)
{
    static model m;
    size_t entries = 0; /* of a macro step */
    make_chain(&m, MIXED, 1.0);
    for (size_t i = 0; i < m.count; i++)
        entries += m.parts[i].substeps * pma_subdomain_entries(m.parts[i].core);
    CHECK_INT(count_questions(0), STEPS * FINE);
    CHECK_INT(count_questions(SIZE_MAX), 0);
    /* at the first fine step after every macro step; the last one is not followed by any */
    CHECK_INT(count_questions(entries), STEPS - 1);
    CHECK_INT(count_questions(2 * entries), (STEPS - 1) / 2);
    destroy_model(&m);
}

/* ---- not finite ------------------------------------------------------------------------------ */

/* A heavy mass, implicit, and B, explicit, with a small one on a stiff spring inside: omega h = 3
 * when the interface is held, beyond the limit 2. It overflows a thousand times before A. */
static void make_unstable(model *m, bool doubled, size_t substeps)
{
    *m = (model){.count = 2, .p = 1, .dt = 0.1 * (double)substeps, .rebased = true};
    m->parts[0] = one_mass(1000.0, 1.0, 1.0, TRAPEZOIDAL, true);
    m->parts[0].doubled = doubled;
    m->parts[1] = (part){.n = 2, .nb = 1, .p = 1, .substeps = substeps,
                         .scheme = CENTRAL_DIFFERENCE, .M = {1.0, 0.0, 0.0, 1.0},
                         .K = {900.0, -900.0, -900.0, 900.0}, .L = {0.0, -1.0}, .u0 = {1.0}};
    make_model(m);
}

/* The coupler stops in the macro step in which B overflows, and stays before it. */
static void check_unstable(bool doubled, size_t substeps)
{
    static model m;
    const int64_t forever = 100000;
    make_unstable(&m, doubled, substeps);
    CHECK_STATUS(pma_coupler_advance(m.coupler, forever, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_unstable(m.coupler), 1);
    const snapshot kept = present(&m);
    for (size_t i = 0; i < kept.count; i++)
        CHECK(isfinite(kept.values[i]));
    const int64_t done = pma_coupler_step_count(m.coupler);
    CHECK(done > 0 && done < forever);

    /* again, and the same */
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_unstable(m.coupler), 1);
    CHECK_INT(pma_coupler_step_count(m.coupler), done);
    check_same_present(&m, &kept);

    /* as far as that the run is a run like any other */
    start_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, done, NULL, NULL), PMA_OK);
    check_same_present(&m, &kept);
    destroy_model(&m);
}

static void an_explicit_part_above_its_limit_is_named_and_the_state_kept(void)
{
    check_unstable(false, 1);
    check_unstable(true, 1);
    check_unstable(false, 2);
    check_unstable(true, 2);
}

/* One load that is not finite, at dof `dof` of part i: who is named, and what is left behind? */
static void check_infinite_load(size_t i, size_t dof, int64_t after)
{
    static model m, n;
    double F[MOST] = {0.0};
    F[dof] = INFINITY;
    make_chain(&m, MIXED, 1.0);
    make_chain(&n, MIXED, 1.0);
    CHECK_STATUS(pma_coupler_advance(m.coupler, after, NULL, NULL), PMA_OK);
    const snapshot before = present(&m);
    const pma_load good = *pma_subdomain_load(m.parts[i].core);
    const pma_load bad = {.kind = PMA_LOAD_CONSTANT, .n = m.parts[i].n, .values = F};
    pma_subdomain_set_load(m.parts[i].core, bad);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 1, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_unstable(m.coupler), i);
    check_same_present(&m, &before);
    pma_subdomain_set_load(m.parts[i].core, good);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - after, NULL, NULL), PMA_OK);
    CHECK_STATUS(pma_coupler_advance(n.coupler, STEPS, NULL, NULL), PMA_OK);
    const snapshot expected = present(&n);
    check_same_present(&m, &expected);
    destroy_model(&m);
    destroy_model(&n);
}

static void after_a_load_that_is_not_finite_the_run_can_go_on_as_if_it_had_not_been(void)
{
    for (int64_t after = 0; after <= 3; after++) {
        check_infinite_load(0, 2, after);
        check_infinite_load(0, 0, after);
        check_infinite_load(1, 0, after);
        check_infinite_load(2, 0, after);
        check_infinite_load(2, 1, after);
    }
}

/* Two masses that nothing ties: the second has no interface on which it could be seen early. */
static void an_unstable_part_without_an_interface_is_named_too(void)
{
    static model m;
    m = (model){.count = 2, .dt = 1.0};
    m.parts[0] = one_mass(1.0, 1.0, 0.0, TRAPEZOIDAL, true);
    m.parts[1] = one_mass(1.0, 9.0, 0.0, CENTRAL_DIFFERENCE, false); /* omega h = 3 */
    m.parts[1].u0[0] = 1.0;
    make_model(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 10000, NULL, NULL), PMA_NOT_FINITE);
    CHECK_INT(pma_coupler_unstable(m.coupler), 1);
    CHECK(isfinite(pma_subdomain_at(m.parts[1].core, 0)->u[0]));
    destroy_model(&m);
}

/* All free velocities are finite, the multipliers are not. */
static void an_interface_matrix_that_is_not_finite_is_named_as_the_interface(void)
{
    static model m;
    make_chain(&m, MIXED, 1.0);
    m.inverse[1][0] = INFINITY; /* of H, from the second macro step on */
    const snapshot before = present(&m);
    CHECK_STATUS(pma_coupler_advance(m.coupler, 5, NULL, NULL), PMA_NOT_FINITE);
    CHECK(pma_coupler_unstable(m.coupler) == PMA_INTERFACE);
    CHECK_INT(pma_coupler_step_count(m.coupler), 1);
    start_model(&m);
    check_same_present(&m, &before);
    destroy_model(&m);
}

/* ---- no allocation in a step ----------------------------------------------------------------- */

/* Without AddressSanitizer nobody counts, and the test says nothing. */
static size_t allocations;

#if defined(__SANITIZE_ADDRESS__)
#define COUNTS_ALLOCATIONS 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define COUNTS_ALLOCATIONS 1
#endif
#endif

#ifdef COUNTS_ALLOCATIONS
/* as <sanitizer/allocator_interface.h> has it, which not every compiler brings along */
int __sanitizer_install_malloc_and_free_hooks(void (*malloced)(const volatile void *, size_t),
                                              void (*freed)(const volatile void *));

static void count_allocation(const volatile void *memory, size_t size)
{
    (void)memory;
    (void)size;
    allocations++;
}

static void ignore_free(const volatile void *memory)
{
    (void)memory;
}

static bool count_allocations(void)
{
    return __sanitizer_install_malloc_and_free_hooks(count_allocation, ignore_free) > 0;
}
#else
static bool count_allocations(void)
{
    return false;
}
#endif

static void a_step_does_not_allocate(void)
{
    static model m;
    static tape t;
    asker a = {0, 0};
    const pma_poll poll = {ask, &a, 0};
    if (!count_allocations()) {
        printf("allocations are counted under AddressSanitizer only\n");
        return;
    }
    make_chain(&m, MIXED, 1.0);
    make_tape(&t, &m, 0, 0);
    CHECK(allocations >= 2 * PARTS + 2); /* the counter counts: a struct and a block for each */
    const size_t before = allocations;
    run_taped(&m, &t, 3);
    CHECK_STATUS(pma_coupler_advance(m.coupler, STEPS - 3, NULL, &poll), PMA_OK);
    start_model(&m);
    CHECK_INT(allocations, before);
    destroy_model(&m);
}

/* ---- all of them ----------------------------------------------------------------------------- */

#define TEST(name) {#name, name}

static const struct {
    const char *name;
    void (*run)(void);
} TESTS[] = {
    TEST(every_status_has_a_text_of_its_own),
    TEST(an_unknown_status_has_a_text_too),
    TEST(the_trapezoidal_rule_has_the_constants_of_the_textbook),
    TEST(the_central_difference_has_the_constants_of_the_textbook),
    TEST(generalized_alpha_has_the_constants_found_by_hand),
    TEST(every_scheme_is_exact_for_a_constant_acceleration),
    TEST(all_forms_of_a_matrix_multiply_like_two_loops),
    TEST(a_product_reads_as_many_entries_as_are_stored),
    TEST(a_matrix_with_a_bad_index_is_refused),
    TEST(dense_and_sparse_factors_solve_for_every_size_of_interface),
    TEST(a_diagonal_factor_has_three_forms),
    TEST(a_sweep_reads_the_reciprocals_and_what_lies_below_the_diagonal),
    TEST(a_factor_with_a_bad_index_is_refused),
    TEST(an_interface_larger_than_the_factor_is_refused),
    TEST(the_symbolic_count_agrees_with_brute_force),
    TEST(a_postorder_keeps_the_fill_and_gathers_every_subtree),
    TEST(supernodes_hold_the_whole_fill_and_break_at_the_interface),
    TEST(supernodes_of_dense_and_diagonal_matrices_are_as_few_and_as_many_as_can_be),
    TEST(a_factor_made_in_panels_solves),
    TEST(the_column_of_a_pivot_that_is_not_positive_is_named),
    TEST(a_pivot_that_is_only_rounding_counts_as_not_positive),
    TEST(an_entry_outside_the_pattern_is_refused),
    TEST(a_factor_in_the_making_can_be_stopped),
    TEST(panels_say_how_much_scratch_they_need),
    TEST(panels_with_a_bad_index_are_refused),
    TEST(panels_have_to_break_where_the_interface_begins),
    TEST(factors_in_panels_solve_for_every_size_of_interface),
    TEST(a_link_with_a_bad_index_is_refused),
    TEST(a_link_loads_and_gathers_with_one_and_the_same_matrix),
    TEST(no_load_adds_nothing_and_a_constant_load_itself),
    TEST(a_table_gives_the_row_of_the_own_step),
    TEST(a_sampled_load_is_linear_between_samples_and_held_or_zero_after),
    TEST(a_shape_spreads_the_samples_over_the_dofs),
    TEST(a_sample_instant_typed_as_a_decimal_gives_the_sample_itself),
    TEST(a_time_just_beside_a_sample_is_not_the_sample),
    TEST(a_subdomain_with_sizes_that_do_not_agree_is_refused),
    TEST(a_subdomain_with_a_bad_index_is_refused),
    TEST(a_subdomain_beyond_all_memory_is_refused),
    TEST(an_own_step_reads_at_least_what_its_sweeps_and_products_read),
    TEST(a_free_oscillator_under_the_trapezoidal_rule_turns_by_its_closed_form),
    TEST(a_free_oscillator_under_the_central_difference_turns_by_its_closed_form),
    TEST(the_explicit_scheme_has_three_equal_roots_at_its_bifurcation),
    TEST(single_steps_are_those_of_a_program_that_keeps_all_nodes),
    TEST(double_steps_are_those_of_a_program_that_keeps_all_nodes),
    TEST(compliance_and_link_velocity_are_the_dense_product),
    TEST(totals_on_the_interface_are_added_to_the_jump),
    TEST(an_unfinished_macro_step_leaves_the_present_untouched),
    TEST(a_value_that_is_not_finite_is_seen_at_every_dof),
    TEST(the_row_of_a_node_follows_from_its_number),
    TEST(the_chosen_dofs_of_a_state_are_copied_in_the_order_asked_for),
    TEST(gc_is_the_schedule_as_it_is_written),
    TEST(pm_is_the_schedule_as_it_is_written),
    TEST(every_third_macro_node_is_recorded_wherever_the_stretch_begins),
    TEST(a_record_of_all_nodes_may_begin_in_the_middle),
    TEST(a_run_without_conditions_leaves_the_interface_arrays_alone),
    TEST(two_trapezoidal_halves_under_gc_are_the_whole_oscillator),
    TEST(trapezoidal_and_central_difference_under_gc_have_a_closed_form),
    TEST(trapezoidal_and_central_difference_under_pm_have_a_closed_form),
    TEST(the_order_is_two_without_subcycling_and_one_with_it),
    TEST(a_rebased_start_converges_and_a_plain_one_does_not),
    TEST(pm_alpha_dissipates_in_the_long_run),
    TEST(a_prescribed_velocity_is_followed),
    TEST(velocities_of_both_sides_agree_at_every_fine_step),
    TEST(a_coupler_with_sizes_that_do_not_agree_is_refused),
    TEST(a_motion_of_rows_that_do_not_exist_is_refused),
    TEST(a_coupler_of_a_subdomain_with_other_conditions_is_refused),
    TEST(substeps_that_do_not_divide_the_largest_are_refused),
    TEST(a_coupler_without_an_initial_state_does_not_run),
    TEST(a_started_coupler_shows_its_parts_and_its_multipliers),
    TEST(a_run_of_many_steps_equals_many_runs_of_one),
    TEST(scaling_by_a_power_of_two_scales_every_bit),
    TEST(a_second_start_forgets_the_first_run),
    TEST(a_run_goes_on_from_nodes_that_were_written),
    TEST(the_nodes_of_a_subdomain_are_its_present_and_the_own_node_before),
    TEST(a_stopped_run_stands_at_a_macro_step_and_goes_on_as_if_never_stopped),
    TEST(a_run_asks_as_often_as_it_was_told_to),
    TEST(an_explicit_part_above_its_limit_is_named_and_the_state_kept),
    TEST(after_a_load_that_is_not_finite_the_run_can_go_on_as_if_it_had_not_been),
    TEST(an_unstable_part_without_an_interface_is_named_too),
    TEST(an_interface_matrix_that_is_not_finite_is_named_as_the_interface),
    TEST(a_step_does_not_allocate),
};

#undef TEST

int main(void)
{
    const size_t count = sizeof TESTS / sizeof TESTS[0];
    size_t failed = 0;
    for (size_t i = 0; i < count; i++) {
        checks_failed = 0;
        TESTS[i].run();
        if (checks_failed == 0)
            continue;
        printf("FAILED %s: %zu checks\n", TESTS[i].name, checks_failed);
        failed++;
    }
    printf("%zu passed, %zu failed\n", count - failed, failed);
    return failed > 0;
}
