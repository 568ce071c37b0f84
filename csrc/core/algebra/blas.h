/* blas.h - the two BLAS routines that factors are made with, as Fortran has them. */
#ifndef PMA_BLAS_H
#define PMA_BLAS_H

/* Workers call them at the same time, so that each call has to use one thread. */
typedef struct {
    void (*dgemm)(char *, char *, int *, int *, int *, double *, double *, int *, double *, int *,
                  double *, double *, int *);
    void (*dtrsm)(char *, char *, char *, char *, int *, int *, double *, double *, int *, double *,
                  int *);
} pma_blas;

#endif
