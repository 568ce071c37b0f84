#include "factor/blas.h"

#include "algebra/lanes.h"
#include "algebra/lists.h"

/* ---- products -------------------------------------------------------------------------------- */

/* C (m x n) := beta C + alpha A B', where entry (l, j) of B' is B[l * along_B + j * across_B] */
typedef struct {
    size_t m, n, k;
    double alpha, beta;
    const double *A, *B;
    double *C;
    size_t next_A, along_B, across_B, next_C;
} pma_product;

/* Of a tile: what of it is in registers at a time. */
enum { COLUMNS = 4, PIECES = 2 };

/* One row of it. */
PMA_INLINE void multiply_row(const pma_product *x, const double *A, const double *B, double *C,
                             const size_t columns)
{
    double sum[COLUMNS] = {0.0};
    for (size_t l = 0; l < x->k; l++) {
#pragma GCC unroll 4
        for (size_t j = 0; j < columns; j++)
            sum[j] += A[l * x->next_A] * B[l * x->along_B + j * x->across_B];
    }
    for (size_t j = 0; j < columns; j++) {
        double *c = C + j * x->next_C;
        *c = x->beta == 0.0 ? x->alpha * sum[j] : x->beta * *c + x->alpha * sum[j];
    }
}

#define TILE(name) name##_plain
#define TARGET
#define piece pma_two
#include "factor/tiles.h"
#undef TILE
#undef TARGET
#undef piece
#define TILE(name) name##_avx2
#define TARGET PMA_AVX2
#define piece pma_four
#include "factor/tiles.h"

static void multiply(const pma_product *x)
{
    if (pma_has_avx2())
        multiply_avx2(x);
    else
        multiply_plain(x);
}

/* ---- one or the other ------------------------------------------------------------------------ */

static bool is_small(const pma_blas *blas, size_t m, size_t n, size_t k)
{
    return !blas->dgemm || m * n * k < blas->from;
}

void pma_blas_multiply(const pma_blas *blas, size_t m, size_t n, size_t k, double alpha,
                       pma_block A, pma_block B, bool transposed, double beta, pma_block C)
{
    if (!is_small(blas, m, n, k)) {
        int rows = (int)m, columns = (int)n, terms = (int)k;
        int next_A = (int)A.next, next_B = (int)B.next, next_C = (int)C.next;
        blas->dgemm("N", transposed ? "T" : "N", &rows, &columns, &terms, &alpha, A.values, &next_A,
                    B.values, &next_B, &beta, C.values, &next_C);
        return;
    }
    const pma_product product = {.m = m,
                                 .n = n,
                                 .k = k,
                                 .alpha = alpha,
                                 .beta = beta,
                                 .A = A.values,
                                 .B = B.values,
                                 .C = C.values,
                                 .next_A = A.next,
                                 .along_B = transposed ? B.next : 1,
                                 .across_B = transposed ? 1 : B.next,
                                 .next_C = C.next};
    multiply(&product);
}

/* Some columns, from those before on: B_k = (B_k - sum over l < k of B_l L_kl) / L_kk */
static void divide_columns(size_t m, size_t columns, pma_block L, bool unit, pma_block B)
{
    for (size_t k = 0; k < columns; k++) {
        double *x = B.values + k * B.next;
        for (size_t l = 0; l < k; l++) {
            const double factor = L.values[l * L.next + k], *before = B.values + l * B.next;
#pragma omp simd
            for (size_t i = 0; i < m; i++)
                x[i] -= factor * before[i];
        }
        const double pivot = L.values[k * L.next + k];
#pragma omp simd
        for (size_t i = 0; i < (unit ? 0 : m); i++)
            x[i] /= pivot;
    }
}

void pma_blas_divide(const pma_blas *blas, size_t m, size_t n, pma_block L, bool unit, pma_block B)
{
    if (!is_small(blas, m, n, n)) {
        int rows = (int)m, columns = (int)n, next_L = (int)L.next, next_B = (int)B.next;
        double one = 1.0;
        blas->dtrsm("R", "L", "T", unit ? "U" : "N", &rows, &columns, &one, L.values, &next_L,
                    B.values, &next_B);
        return;
    }
    const pma_blas none = {.dgemm = NULL};
    for (size_t j = 0; j < n; j += COLUMNS) {
        const size_t columns = pma_least(n - j, COLUMNS);
        const pma_block X = pma_block_at(B, 0, j);
        pma_blas_multiply(&none, m, columns, j, -1.0, B, pma_block_at(L, j, 0), true, 1.0, X);
        divide_columns(m, columns, pma_block_at(L, j, j), unit, X);
    }
}
