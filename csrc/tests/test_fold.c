/* test_fold.c - chains folded in the middle: products, sweeps and factors. */
#include "algebra/fold.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/factor.h"
#include "algebra/matrix.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

static bool are_neighbours(size_t n, size_t i, size_t j)
{
    return (i + 1 < n && j == pma_fold_next(n, i)) || (j + 1 < n && i == pma_fold_next(n, j));
}

/* ---- the order ------------------------------------------------------------------------------ */

static void a_tridiagonal_matrix_has_its_entries_where_rows_couple(void)
{
    for (size_t n = 2; n <= SIZE; n++) {
        size_t order[SIZE]; /* 0, n-1, 1, n-2, ... */
        for (size_t k = 0; k < n; k++)
            order[k] = k % 2 ? n - 1 - k / 2 : k / 2;
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < n; j++) {
                const size_t a = order[i], b = order[j];
                CHECK(are_neighbours(n, i, j) == (a + 1 == b || b + 1 == a));
            }
        }
    }
}

/* ---- products ------------------------------------------------------------------------------- */

/* A by rows, the folded chain and the band of width 2 with the same entries; NaN where nothing is
 * read. */
typedef struct {
    double rows[SIZE * SIZE], chain[3 * SIZE], band[5 * SIZE];
} product;

static product draw_product(size_t n, bool symmetric, uint64_t *seed)
{
    product p = {.rows = {0.0}};
    for (size_t i = 0; i < n; i++) {
        const size_t j = i + 1 < n ? pma_fold_next(n, i) : i;
        const double right = draw_eighth(seed), left = symmetric ? right : draw_eighth(seed);
        p.rows[i * n + i] = p.chain[i] = p.band[i] = draw_eighth(seed);
        p.rows[i * n + j] = j > i ? right : p.rows[i * n + i];
        p.rows[j * n + i] = j > i ? left : p.rows[i * n + i];
        p.chain[n + i] = j > i ? right : (double)NAN;
        p.chain[2 * n + i] = j > i ? left : (double)NAN;
        for (size_t d = 1; d <= 2; d++) {
            p.band[d * n + i] = i + d < n ? p.rows[i * n + i + d] : (double)NAN;
            p.band[(d + 2) * n + i] = i + d < n ? p.rows[(i + d) * n + i] : (double)NAN;
        }
    }
    return p;
}

static pma_matrix folded_matrix(const product *p, size_t n, bool symmetric)
{
    return (pma_matrix){.form = PMA_BAND,
                        .n = n,
                        .values = p->chain,
                        .width = 1,
                        .below = symmetric ? 0 : n,
                        .folded = true};
}

/* Of vectors of eighths no sum is rounded; of others the rounding is that of the band. */
static void check_product(size_t n, bool symmetric, uint64_t *seed)
{
    const product p = draw_product(n, symmetric, seed);
    const pma_matrix A = folded_matrix(&p, n, symmetric);
    const pma_matrix band = {
        .form = PMA_BAND, .n = n, .values = p.band, .width = 2, .below = symmetric ? 0 : 2 * n};
    double x[SIZE], y[SIZE], parts[SIZE], expected[SIZE];
    CHECK_STATUS(pma_matrix_check(&A), PMA_OK);
    CHECK_INT(pma_matrix_reach(&A), 2);
    CHECK_INT(pma_matrix_entries(&A), symmetric ? 2 * n : 3 * n);
    for (size_t i = 0; i < n; i++) {
        x[i] = draw_eighth(seed);
        y[i] = expected[i] = draw_eighth(seed);
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            expected[i] -= p.rows[i * n + j] * x[j];
    }
    pma_matrix_subtract(&A, x, y);
    CHECK_BITS(n, y, expected);
    check_lane_product(&A, seed);
    for (size_t piece = 1; piece <= n; piece++) {
        draw_vector(n, seed, x);
        draw_vector(n, seed, expected);
        memcpy(parts, expected, sizeof parts);
        for (size_t i = 0; i < n; i += piece)
            pma_matrix_subtract_rows(&A, i, i + piece < n ? i + piece : n, x, parts);
        if (n > 2)
            pma_matrix_subtract(&band, x, expected);
        else
            pma_matrix_subtract(&A, x, expected);
        CHECK_BITS(n, parts, expected);
    }
}

static void a_folded_matrix_multiplies_like_two_loops_and_bitwise_like_its_band(void)
{
    uint64_t seed = 71;
    for (size_t n = 2; n <= SIZE; n++) {
        check_product(n, true, &seed);
        check_product(n, false, &seed);
    }
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* R and Q cut off but for the entries of a folded chain; the last of values, NaN, is not read. */
static pma_factor folded_factor(triple *t, size_t nb, double *values)
{
    const size_t n = t->n;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < i; j++) {
            if (!are_neighbours(n, i, j))
                t->R[i * n + j] = t->Q[i * n + j] = 0.0;
        }
    }
    for (size_t j = 0; j < n; j++) {
        const size_t entry = j + 1 < n ? pma_fold_next(n, j) * n + j : SIZE_MAX;
        values[j] = entry < SIZE_MAX ? t->R[entry] : (double)NAN;
        values[n + j] = entry < SIZE_MAX ? t->Q[entry] : (double)NAN;
    }
    return (pma_factor){.form = PMA_BAND,
                        .n = n,
                        .nb = nb,
                        .inverse = t->inverse,
                        .values = values,
                        .width = 1,
                        .folded = true,
                        .Q = t->unsymmetric ? n : 0};
}

/* A step in parts of any number of rows is bitwise the whole step. */
static void check_parts(const pma_factor *f, uint64_t *seed)
{
    const size_t n = f->n;
    double whole[SIZE], parts[SIZE], f_b[SIZE], whole_b[SIZE], parts_b[SIZE];
    double *work = take_scratch(f);
    for (size_t piece = 1; piece <= n; piece++) {
        draw_vector(n, seed, whole);
        draw_vector(f->nb, seed, f_b);
        memcpy(parts, whole, sizeof whole);
        pma_factor_open(f, whole, whole_b, work);
        for (size_t j = 0; j < n; j += piece)
            pma_factor_open_part(f, j, j + piece < n ? j + piece : n, parts, parts_b, work);
        CHECK_BITS(n, parts, whole);
        CHECK_BITS(f->nb, parts_b, whole_b);
        pma_factor_close(f, f_b, whole, work);
        for (size_t end = n, begin; end > 0; end = begin) {
            begin = end > piece ? end - piece : 0;
            pma_factor_close_part(f, begin, end, f_b, parts, work);
        }
        CHECK_BITS(n, parts, whole);
    }
    return_scratch(f, work);
}

static void folded_factors_solve_for_every_size_of_interface_and_in_parts(void)
{
    uint64_t seed = 73;
    double values[2 * SIZE];
    for (size_t n = 2; n <= SIZE; n++) {
        for (size_t nb = 0; nb <= n; nb++) {
            for (int unsymmetric = 0; unsymmetric < 2; unsymmetric++) {
                triple t = make_triple(n, 0.9, &seed);
                if (unsymmetric)
                    make_unsymmetric(&t, &seed);
                const pma_factor f = folded_factor(&t, nb, values);
                check_sweeps(&t, &f, &seed);
                check_parts(&f, &seed);
                CHECK_INT(pma_factor_reach(&f), 2);
                CHECK_INT(pma_factor_entries(&f), 2 * n);
            }
        }
    }
}

static void only_bands_of_width_one_are_folded(void)
{
    const double values[9] = {0.0};
    pma_factor f = {.form = PMA_BAND, .n = 3, .values = values, .width = 1, .folded = true};
    pma_matrix A = {.form = PMA_BAND, .n = 3, .values = values, .width = 1, .folded = true};
    CHECK_STATUS(pma_factor_check(&f), PMA_OK);
    CHECK_STATUS(pma_matrix_check(&A), PMA_OK);
    f.width = A.width = 2;
    CHECK_STATUS(pma_factor_check(&f), PMA_BAD_SIZE);
    CHECK_STATUS(pma_matrix_check(&A), PMA_BAD_SIZE);
    f.width = A.width = 0;
    CHECK_STATUS(pma_factor_check(&f), PMA_BAD_SIZE);
    CHECK_STATUS(pma_matrix_check(&A), PMA_BAD_SIZE);
    f.width = f.n = 1;
    CHECK_STATUS(pma_factor_check(&f), PMA_BAD_SIZE);
}

/* ---- factors -------------------------------------------------------------------------------- */

/* A = R D Q^T: its diagonal, and the entries below and above it. */
typedef struct {
    double diagonal[SIZE], beside[2 * SIZE], inverse[SIZE];
} numbers;

static numbers multiply(const triple *t)
{
    const size_t n = t->n;
    numbers A = {.diagonal = {0.0}};
    const double *Q = t->unsymmetric ? t->Q : t->R;
    for (size_t j = 0; j < n; j++) {
        A.diagonal[j] += t->D[j];
        if (j + 1 == n)
            break;
        const size_t i = pma_fold_next(n, j);
        const double r = t->R[i * n + j], q = Q[i * n + j];
        A.diagonal[i] += r * t->D[j] * q;
        A.beside[j] = r * t->D[j];
        A.beside[n + j] = q * t->D[j];
    }
    return A;
}

static pma_status factor(const triple *t, numbers *A, size_t *column)
{
    double *Q = t->unsymmetric ? A->beside + t->n : NULL;
    return pma_fold_factor(t->n, A->diagonal, 64.0 * DBL_EPSILON, 1e8, A->beside, Q, A->inverse,
                           column);
}

/* R in eighths and D powers of two: nothing is rounded, and what is known is found again. */
static void a_folded_chain_is_factored_without_rounding_where_there_is_none(void)
{
    uint64_t seed = 79;
    double values[2 * SIZE];
    size_t column;
    for (size_t n = 1; n <= SIZE; n++) {
        for (int unsymmetric = 0; unsymmetric < 2; unsymmetric++) {
            triple t = make_triple(n, 0.9, &seed);
            if (unsymmetric)
                make_unsymmetric(&t, &seed);
            folded_factor(&t, 0, values);
            numbers A = multiply(&t);
            CHECK_STATUS(factor(&t, &A, &column), PMA_OK);
            CHECK_BITS(n, A.inverse, t.inverse);
            CHECK_BITS(n - 1, A.beside, values);
            if (unsymmetric)
                CHECK_BITS(n - 1, A.beside + n, values + n);
        }
    }
}

static void the_column_of_a_refused_pivot_is_named(void)
{
    uint64_t seed = 83;
    double values[2 * SIZE];
    size_t column;
    for (size_t bad = 0; bad < SIZE; bad++) {
        for (int unsymmetric = 0; unsymmetric < 2; unsymmetric++) {
            triple t = make_triple(SIZE, 0.9, &seed);
            if (unsymmetric)
                make_unsymmetric(&t, &seed);
            folded_factor(&t, 0, values);
            t.D[bad] = unsymmetric ? 0.0 : -t.D[bad];
            numbers A = multiply(&t);
            CHECK_STATUS(factor(&t, &A, &column), PMA_NOT_DEFINITE);
            CHECK_INT(column, bad);
        }
    }
}

static void pivots_without_a_reciprocal_and_growth_are_refused(void)
{
    size_t column;
    double inverse[3], R[3] = {0.0}, Q[3] = {0.0};
    const double tiny[3] = {1.0, 1e-309, 1.0}, ones[3] = {1e-9, 1.0, 1.0};
    CHECK_STATUS(pma_fold_factor(3, tiny, 1e-14, 1e8, R, NULL, inverse, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, 1);

    /* 1 - 1e-9^-1 in row 2, which row 0 couples with */
    R[0] = Q[0] = 1.0;
    CHECK_STATUS(pma_fold_factor(3, ones, 1e-14, 1e8, R, Q, inverse, &column), PMA_NOT_DEFINITE);
    CHECK_INT(column, 2);
    R[0] = Q[0] = 1.0;
    CHECK_STATUS(pma_fold_factor(3, ones, 1e-14, 1e10, R, Q, inverse, &column), PMA_OK);
}

const test FOLD_TESTS[] = {
    TEST(a_tridiagonal_matrix_has_its_entries_where_rows_couple),
    TEST(a_folded_matrix_multiplies_like_two_loops_and_bitwise_like_its_band),
    TEST(folded_factors_solve_for_every_size_of_interface_and_in_parts),
    TEST(only_bands_of_width_one_are_folded),
    TEST(a_folded_chain_is_factored_without_rounding_where_there_is_none),
    TEST(the_column_of_a_refused_pivot_is_named),
    TEST(pivots_without_a_reciprocal_and_growth_are_refused),
    END_OF_TESTS,
};
