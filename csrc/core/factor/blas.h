/* blas.h - products and triangular solutions of dense blocks, which factors are made with.
 *
 * Small ones are loops, bitwise the same on every processor and in every place; large ones are
 * routines of BLAS where there are any, whose digits depend on the library and on the processor. */
#ifndef PMA_BLAS_H
#define PMA_BLAS_H

#include <stdbool.h>
#include <stddef.h>

/* Multiplications from which on a product or solution is that of BLAS. Factors of dense matrices of
 * up to 200 rows, and of sparse ones with fronts of these sizes, are made by loops alone: in 0.8 to
 * 1.3 times of what they take with BLAS. */
enum { PMA_BLAS_FROM = 128 * 64 * 48 };

/* Two routines as Fortran has them, or NULL. Workers call them at the same time, so that each call
 * has to use one thread. */
typedef struct {
    void (*dgemm)(char *, char *, int *, int *, int *, double *, double *, int *, double *, int *,
                  double *, double *, int *);
    void (*dtrsm)(char *, char *, char *, char *, int *, int *, double *, double *, int *, double *,
                  int *);
    size_t from; /* multiplications of a call, at least */
} pma_blas;

/* A block by columns: `next` is the distance between two of them. */
typedef struct {
    double *values;
    size_t next;
} pma_block;

static inline pma_block pma_block_at(pma_block of, size_t row, size_t column)
{
    return (pma_block){of.values + column * of.next + row, of.next};
}

/* C (m x n) := beta C + alpha A B^T, or A B; C is not read where beta is zero. A is m x k. */
void pma_blas_multiply(const pma_blas *blas, size_t m, size_t n, size_t k, double alpha,
                       pma_block A, pma_block B, bool transposed, double beta, pma_block C);

/* B (m x n) := B L^-T, L lower triangular, of ones on its diagonal if it is `unit` */
void pma_blas_divide(const pma_blas *blas, size_t m, size_t n, pma_block L, bool unit, pma_block B);

#endif
