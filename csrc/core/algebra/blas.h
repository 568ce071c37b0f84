/* blas.h - the two routines of BLAS that factors are made with, as plain loops.
 *
 * For places that have no BLAS, and for digits that do not depend on one. Column by column, without
 * blocks: as fast as a library for small fronts, and half as fast for large ones. */
#ifndef PMA_BLAS_H
#define PMA_BLAS_H

/* As Fortran's DGEMM and DTRSM, in the cases that the core calls: of the latter alpha = 1 and left,
 * lower, untransposed, or right, lower, transposed. */
void pma_blas_gemm(char *of_a, char *of_b, int *m, int *n, int *k, double *alpha, double *a,
                   int *lda, double *b, int *ldb, double *beta, double *c, int *ldc);
void pma_blas_trsm(char *side, char *part, char *of_a, char *diagonal, int *m, int *n,
                   double *alpha, double *a, int *lda, double *b, int *ldb);

#endif
