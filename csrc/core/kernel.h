/* kernel.h - sweeps and products with dense columns, in vectors of four numbers.
 *
 * Where most of the time of a step goes. A panel holds a unit lower trapezoid by columns: R_ij
 * stands at panel[j * ld + i], and only what is below the diagonal is read. */
#ifndef PMA_KERNEL_H
#define PMA_KERNEL_H

#include <stddef.h>

typedef struct {
    /* x (height): for j = 0..width-1 in turn, x_i -= R_ij x_j for all i > j */
    void (*eliminate)(const double *panel, size_t ld, size_t height, size_t width, double *x);
    /* x (height): for j = width-1..0 in turn, x_j -= sum over i > j of R_ij x_i */
    void (*substitute)(const double *panel, size_t ld, size_t height, size_t width, double *x);
    /* y (rows) -= A x, A_ij at A[j * ld + i] */
    void (*subtract)(const double *A, size_t ld, size_t rows, size_t columns, const double *x,
                     double *y);
} pma_kernel;

/* The widest instructions of this processor. All kernels give the same bits: they differ in how
 * many registers four numbers take, not in the order of the sums. */
const pma_kernel *pma_kernel_best(void);

/* What every processor has. */
const pma_kernel *pma_kernel_plain(void);

#endif
