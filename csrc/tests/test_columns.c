/* test_columns.c - the factor that is taken from the triangles of another program. */
#include "algebra/lu.h"

#include <stdint.h>

#include "check.h"
#include "matrices.h"
#include "naive.h"
#include "tests.h"

/* The rows of each list the other way round. */
static void reverse(size_t n, compressed *A)
{
    for (size_t j = 0; j < n; j++) {
        for (int64_t a = A->ptr[j], b = A->ptr[j + 1] - 1; a < b; a++, b--) {
            const int32_t index = A->index[a];
            const double value = A->values[a];
            A->index[a] = A->index[b];
            A->values[a] = A->values[b];
            A->index[b] = index;
            A->values[b] = value;
        }
    }
}

static pma_matrix by_columns(size_t n, const compressed *A)
{
    return (pma_matrix){
        .form = PMA_SPARSE, .n = n, .ptr = A->ptr, .index = A->index, .values = A->values};
}

/* Column j of R below its diagonal, D, L = R and U = D R^T, whose columns are rows here. */
static void draw_triangles(size_t n, uint64_t *seed, double *below, double *D, double *L, double *U)
{
    for (size_t j = 0; j < n; j++) {
        D[j] = 1.0 + draw(seed, 4);
        for (size_t i = 0; i < n; i++) {
            const double r = i > j && draw(seed, 2) ? draw_eighth(seed) : 0.0;
            below[j * n + i] = r;
            L[j * n + i] = i == j ? 1.0 : r;
            U[i * n + j] = i == j ? D[j] : D[j] * r;
        }
    }
}

static void triangles_of_a_symmetric_matrix_are_its_factor(void)
{
    uint64_t seed = 11;
    for (size_t n = 1; n <= SIZE; n++) {
        double below[SIZE * SIZE], D[SIZE], L[SIZE * SIZE], U[SIZE * SIZE];
        double values[SIZE * SIZE], found[SIZE], scratch[2 * SIZE];
        int64_t ptr[SIZE + 1];
        int32_t index[SIZE * SIZE];
        draw_triangles(n, &seed, below, D, L, U);
        const compressed R = compress(n, below);
        compressed lower = compress(n, L), upper = compress(n, U);
        reverse(n, &lower);
        reverse(n, &upper);
        const pma_matrix of_L = by_columns(n, &lower), of_U = by_columns(n, &upper);
        pma_lu_count(&of_L, ptr);
        CHECK(pma_lu_take(&of_L, &of_U, ptr, index, values, found, scratch));
        for (size_t j = 0; j <= n; j++)
            CHECK_INT(ptr[j], R.ptr[j]);
        for (int64_t e = 0; e < R.ptr[n]; e++)
            CHECK_INT(index[e], R.index[e]);
        CHECK_BITS((size_t)R.ptr[n], values, R.values);
        CHECK_BITS(n, found, D);
    }
}

/* R = (1, 1; r, 1), D = (2, 3), and U with this entry in place of 2 r */
static bool are_symmetric(double r, double entry)
{
    const compressed lower = {.ptr = {0, 2, 3}, .index = {0, 1, 1}, .values = {1.0, r, 1.0}};
    const compressed upper = {.ptr = {0, 1, 3}, .index = {0, 0, 1}, .values = {2.0, entry, 3.0}};
    const pma_matrix L = by_columns(2, &lower), U = by_columns(2, &upper);
    int64_t ptr[3];
    int32_t index[1];
    double values[1], D[2], scratch[4];
    pma_lu_count(&L, ptr);
    return pma_lu_take(&L, &U, ptr, index, values, D, scratch);
}

static void triangles_of_an_unsymmetric_matrix_are_noticed(void)
{
    CHECK(are_symmetric(0.5, 1.0));
    CHECK(are_symmetric(0.5, 1.0 + 1e-12)); /* rounding: the tolerance is 1e-9 */
    CHECK(!are_symmetric(0.5, 1.0 + 1e-6));
    CHECK(!are_symmetric(0.5, 0.0));
}

const test COLUMNS_TESTS[] = {
    TEST(triangles_of_a_symmetric_matrix_are_its_factor),
    TEST(triangles_of_an_unsymmetric_matrix_are_noticed),
    END_OF_TESTS,
};
