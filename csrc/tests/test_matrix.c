/* test_matrix.c - products with a matrix in each of its forms. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "algebra/matrix.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

static pma_matrix sparse_matrix(size_t n, const double *values, const int64_t *ptr,
                                const int32_t *index)
{
    return (pma_matrix){.form = PMA_SPARSE, .n = n, .values = values, .ptr = ptr, .index = index};
}

/* Small multiples of 1/8 everywhere: no rounding, so they have to be equal. */
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

    for (size_t i = 0; i < A->n; i++)
        y[i] = 100.0 - (double)i;
    for (size_t begin = 0; begin < A->n; begin += 4)
        pma_matrix_subtract_rows(A, begin, begin + 4 < A->n ? begin + 4 : A->n, x, y);
    CHECK_BITS(A->n, y, expected);

    uint64_t seed = A->n;
    check_lane_product(A, &seed);
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
        check_subtract(&(pma_matrix){.form = PMA_DENSE, .n = n, .values = rows}, rows);
        const pma_matrix by_rows = sparse_matrix(n, s.values, s.ptr, s.index);
        check_subtract(&by_rows, rows);

        for (size_t i = 0; i < n; i++)
            diagonal[i] = spread[i * n + i] = draw_eighth(&seed);
        check_subtract(&(pma_matrix){.form = PMA_DIAGONAL, .n = n, .values = diagonal}, spread);

        memset(spread, 0, sizeof spread);
        check_subtract(&(pma_matrix){.form = PMA_ZERO, .n = n}, spread);
    }
}

/* values (n*n): the diagonals of `rows` from the main one on, one after the other; what lies
 * outside of the matrix is NaN and must not be read. */
static pma_matrix take_band(size_t n, size_t width, const double *rows, double *values)
{
    for (size_t d = 0; d <= width; d++) {
        for (size_t i = 0; i < n; i++)
            values[d * n + i] = i + d < n ? rows[i * n + i + d] : (double)NAN;
    }
    return (pma_matrix){.form = PMA_BAND, .n = n, .values = values, .width = width};
}

static void bands_of_every_width_multiply_like_two_loops(void)
{
    uint64_t seed = 14;
    double rows[SIZE * SIZE], values[SIZE * SIZE];
    for (size_t n = 1; n <= SIZE; n++) {
        for (size_t width = 0; width < n; width++) {
            draw_symmetric(n, &seed, rows);
            for (size_t i = 0; i < n * n; i++) {
                const size_t row = i / n, column = i % n;
                if (row > column + width || column > row + width)
                    rows[i] = 0.0;
            }
            const pma_matrix A = take_band(n, width, rows, values);
            check_subtract(&A, rows);
            CHECK_INT(pma_matrix_entries(&A), n * (width + 1));
        }
    }
    const pma_matrix too_wide = {.form = PMA_BAND, .n = 3, .values = values, .width = 3};
    CHECK_STATUS(pma_matrix_check(&too_wide), PMA_BAD_SIZE);
}

static void a_product_reads_as_many_entries_as_are_stored(void)
{
    const double values[9] = {0.0};
    const int64_t ptr[4] = {0, 2, 2, 5};
    const int32_t index[5] = {0, 2, 0, 1, 2};
    CHECK_INT(pma_matrix_entries(&(pma_matrix){.form = PMA_ZERO, .n = 3}), 0);
    CHECK_INT(pma_matrix_entries(&(pma_matrix){.form = PMA_DIAGONAL, .n = 3, .values = values}), 3);
    CHECK_INT(pma_matrix_entries(&(pma_matrix){.form = PMA_DENSE, .n = 3, .values = values}), 9);
    const pma_matrix sparse = sparse_matrix(3, values, ptr, index);
    CHECK_INT(pma_matrix_entries(&sparse), 5);
}

static pma_status matrix_status(const int64_t *ptr, const int32_t *index)
{
    const double values[4] = {0.0};
    const pma_matrix A = sparse_matrix(3, values, ptr, index);
    return pma_matrix_check(&A);
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

/* order and its inverse, drawn by exchanges */
static void draw_order(size_t n, uint64_t *seed, int64_t *order, int32_t *position)
{
    for (size_t k = 0; k < n; k++) {
        const size_t other = draw(seed, (uint32_t)k + 1);
        order[k] = order[other];
        order[other] = (int64_t)k;
    }
    for (size_t k = 0; k < n; k++)
        position[order[k]] = (int32_t)k;
}

static void a_permuted_matrix_is_that_with_its_rows_and_columns_in_the_order(void)
{
    uint64_t seed = 5;
    for (size_t n = 0; n <= SIZE; n++) {
        double rows[SIZE * SIZE], expected[SIZE * SIZE], values[SIZE * SIZE];
        int64_t order[SIZE], ptr[SIZE + 1];
        int32_t position[SIZE], index[SIZE * SIZE];
        draw_order(n, &seed, order, position);
        for (size_t k = 0; k < n * n; k++)
            rows[k] = draw(&seed, 2) ? draw_eighth(&seed) : 0.0;
        for (size_t k = 0; k < n; k++) {
            for (size_t l = 0; l < n; l++)
                expected[k * n + l] = rows[(size_t)order[k] * n + (size_t)order[l]];
        }
        const compressed A = compress(n, rows), B = compress(n, expected);
        pma_matrix_permute(n, A.ptr, A.index, A.values, order, position, ptr, index, values);
        for (size_t k = 0; k <= n; k++)
            CHECK_INT(ptr[k], B.ptr[k]);
        for (int64_t e = 0; e < B.ptr[n]; e++)
            CHECK_INT(index[e], B.index[e]);
        CHECK_BITS((size_t)B.ptr[n], values, B.values);
    }
}

const test MATRIX_TESTS[] = {
    TEST(all_forms_of_a_matrix_multiply_like_two_loops),
    TEST(bands_of_every_width_multiply_like_two_loops),
    TEST(a_product_reads_as_many_entries_as_are_stored),
    TEST(a_matrix_with_a_bad_index_is_refused),
    TEST(a_permuted_matrix_is_that_with_its_rows_and_columns_in_the_order),
    END_OF_TESTS,
};
