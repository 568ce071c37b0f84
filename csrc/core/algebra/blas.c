#include "algebra/blas.h"

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>

/* c (m) += x a */
static inline void add_scaled(size_t m, double x, const double *a, double *c)
{
    for (size_t i = 0; i < m; i++)
        c[i] += x * a[i];
}

static double scalar_product(size_t k, const double *a, const double *b, size_t stride)
{
    double sum = 0.0;
    for (size_t l = 0; l < k; l++)
        sum += a[l] * b[l * stride];
    return sum;
}

void pma_blas_gemm(char *of_a, char *of_b, int *m, int *n, int *k, double *alpha, double *a,
                   int *lda, double *b, int *ldb, double *beta, double *c, int *ldc)
{
    const size_t rows = (size_t)*m, terms = (size_t)*k, of_a_ld = (size_t)*lda;
    const size_t of_b_ld = (size_t)*ldb;
    const size_t along = *of_b == 'N' ? 1 : of_b_ld, across = *of_b == 'N' ? of_b_ld : 1;
    for (size_t j = 0; j < (size_t)*n; j++) {
        double *column = c + j * (size_t)*ldc;
        const double *of_column = b + j * across;
        for (size_t i = 0; i < rows; i++)
            column[i] = *beta == 0.0 ? 0.0 : *beta * column[i];
        for (size_t l = 0; l < terms && *of_a == 'N'; l++)
            add_scaled(rows, *alpha * of_column[l * along], a + l * of_a_ld, column);
        for (size_t i = 0; i < rows && *of_a != 'N'; i++)
            column[i] += *alpha * scalar_product(terms, a + i * of_a_ld, of_column, along);
    }
}

/* b (m, n) := L^-1 b */
static void solve_left(size_t m, size_t n, const double *L, size_t ld, double *b, size_t ldb,
                       bool unit)
{
    for (size_t j = 0; j < n; j++) {
        double *x = b + j * ldb;
        for (size_t k = 0; k < m; k++) {
            x[k] = unit ? x[k] : x[k] / L[k * ld + k];
            add_scaled(m - k - 1, -x[k], L + k * ld + k + 1, x + k + 1);
        }
    }
}

/* b (m, n) := b L^-T */
static void solve_right(size_t m, size_t n, const double *L, size_t ld, double *b, size_t ldb,
                        bool unit)
{
    for (size_t k = 0; k < n; k++) {
        double *x = b + k * ldb;
        for (size_t i = 0; i < m && !unit; i++)
            x[i] /= L[k * ld + k];
        for (size_t j = k + 1; j < n; j++)
            add_scaled(m, -L[k * ld + j], x, b + j * ldb);
    }
}

void pma_blas_trsm(char *side, char *part, char *of_a, char *diagonal, int *m, int *n,
                   double *alpha, double *a, int *lda, double *b, int *ldb)
{
    const bool unit = *diagonal == 'U';
    assert(*part == 'L' && *alpha == 1.0 && (*side == 'L' ? *of_a == 'N' : *of_a == 'T'));
    (void)part, (void)of_a, (void)alpha;
    (*side == 'L' ? solve_left : solve_right)((size_t)*m, (size_t)*n, a, (size_t)*lda, b,
                                              (size_t)*ldb, unit);
}
