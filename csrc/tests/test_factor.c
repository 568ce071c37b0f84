/* test_factor.c - sweeps over dense, sparse and diagonal factors. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/factor.h"
#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

static pma_factor dense_factor(const triple *t, size_t nb)
{
    return (pma_factor){
        .form = PMA_DENSE, .n = t->n, .nb = nb, .inverse = t->inverse, .values = t->columns};
}

static pma_factor sparse_factor(const triple *t, size_t nb)
{
    const compressed *s = &t->sparse;
    return (pma_factor){.form = PMA_SPARSE,
                        .n = t->n,
                        .nb = nb,
                        .inverse = t->inverse,
                        .values = s->values,
                        .ptr = s->ptr,
                        .index = s->index};
}

static pma_factor diagonal_factor(const triple *t, size_t nb)
{
    return (pma_factor){.form = PMA_DIAGONAL, .n = t->n, .nb = nb, .inverse = t->inverse};
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

/* R cut off below `width`; in the columns of a band. */
static pma_factor band_factor(triple *t, size_t nb, size_t width, double *values)
{
    for (size_t j = 0; j < t->n; j++) {
        for (size_t i = j + width + 1; i < t->n; i++)
            t->R[i * t->n + j] = 0.0;
        for (size_t k = 0; k < width; k++)
            values[j * width + k] = j + 1 + k < t->n ? t->R[(j + 1 + k) * t->n + j] : 0.0;
    }
    return (pma_factor){.form = PMA_BAND,
                        .n = t->n,
                        .nb = nb,
                        .inverse = t->inverse,
                        .values = values,
                        .width = width};
}

static void factors_in_bands_solve_for_every_size_of_interface(void)
{
    uint64_t seed = 15;
    double values[SIZE * SIZE];
    for (size_t n = 2; n <= SIZE; n++) {
        for (size_t width = 1; width < n; width++) {
            triple t = make_triple(n, 0.9, &seed);
            for (size_t nb = 0; nb <= n; nb++) {
                const pma_factor band = band_factor(&t, nb, width, values);
                check_sweeps(&t, &band, &seed);
                CHECK_INT(pma_factor_entries(&band), n * (width + 1));
            }
        }
    }
    const pma_factor none = {.form = PMA_BAND, .n = 3, .width = 0},
                     too_wide = {.form = PMA_BAND, .n = 3, .width = 3};
    CHECK_STATUS(pma_factor_check(&none), PMA_BAD_SIZE);
    CHECK_STATUS(pma_factor_check(&too_wide), PMA_BAD_SIZE);
}

/* The interface first, then the rows above it, some at a time. */
static void a_diagonal_factor_closed_in_parts_is_closed_as_a_whole(void)
{
    uint64_t seed = 16;
    double whole[SIZE], parts[SIZE], f_b[SIZE];
    for (size_t nb = 0; nb <= SIZE; nb++) {
        const triple t = make_triple(SIZE, 0.5, &seed);
        const pma_factor f = diagonal_factor(&t, nb);
        draw_vector(SIZE, &seed, whole);
        draw_vector(nb, &seed, f_b);
        memcpy(parts, whole, sizeof whole);
        pma_factor_close(&f, f_b, whole, NULL);
        pma_factor_close_border(&f, f_b, parts, NULL);
        for (size_t i = 0; i < SIZE - nb; i += 4)
            pma_factor_divide(&f, i, i + 4 < SIZE - nb ? i + 4 : SIZE - nb, parts);
        CHECK_BITS(SIZE, parts, whole);
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

static void a_sweep_reads_the_reciprocals_and_what_is_below_the_diagonal(void)
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
    return pma_factor_check(&(pma_factor){.form = PMA_SPARSE,
                                          .n = 3,
                                          .nb = nb,
                                          .inverse = ones,
                                          .values = ones,
                                          .ptr = ptr,
                                          .index = index});
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

const test FACTOR_TESTS[] = {
    TEST(dense_and_sparse_factors_solve_for_every_size_of_interface),
    TEST(factors_in_bands_solve_for_every_size_of_interface),
    TEST(a_diagonal_factor_closed_in_parts_is_closed_as_a_whole),
    TEST(a_diagonal_factor_has_three_forms),
    TEST(a_sweep_reads_the_reciprocals_and_what_is_below_the_diagonal),
    TEST(a_factor_with_a_bad_index_is_refused),
    TEST(an_interface_larger_than_the_factor_is_refused),
    END_OF_TESTS,
};
