/* test_matrix.c - products with a matrix in each of its forms. */
#include <stdint.h>
#include <string.h>

#include "check.h"
#include "matrices.h"
#include "matrix.h"
#include "naive.h"
#include "tests.h"

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

const test MATRIX_TESTS[] = {
    TEST(all_forms_of_a_matrix_multiply_like_two_loops),
    TEST(a_product_reads_as_many_entries_as_are_stored),
    TEST(a_matrix_with_a_bad_index_is_refused),
    END_OF_TESTS,
};
