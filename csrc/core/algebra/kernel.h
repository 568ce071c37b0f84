/* kernel.h - the loops of algebra where most of the time goes, for each kind of processor.
 *
 * A panel holds a unit lower trapezoid by columns: R_ij is panel[j * ld + i], and only what is
 * below the diagonal is read. */
#ifndef PMA_KERNEL_H
#define PMA_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"

typedef struct {
    /* x (height): for j = 0..width-1 in turn, x_i -= R_ij x_j for all i > j */
    void (*eliminate)(const double *panel, size_t ld, size_t height, size_t width, double *x);
    /* x (height): for j = width-1..0 in turn, x_j -= sum over i > j of R_ij x_i */
    void (*substitute)(const double *panel, size_t ld, size_t height, size_t width, double *x);
    /* y (rows) -= A x, A_ij at A[j * ld + i] */
    void (*subtract)(const double *A, size_t ld, size_t rows, size_t columns, const double *x,
                     double *y);
    /* y -= A x for the strips begin..end-1, where y[0] is the first row of strip `begin` */
    void (*subtract_strips)(const pma_strips *S, size_t begin, size_t end, const double *x,
                            double *y);
    /* y_i -= sum over j of A_ij x_j for i = begin..end-1, A_i,i+d at above[d * n + i] for
     * d = 0..width and A_i+d,i at below[d * n + i] for d = 1..width */
    void (*subtract_band)(const double *above, const double *below, size_t n, size_t width,
                          size_t begin, size_t end, const double *x, double *y);
    /* The first three on vectors in lanes: bitwise the same in each of them. */
    void (*eliminate_lanes)(const double *panel, size_t ld, size_t height, size_t width, double *x);
    void (*substitute_lanes)(const double *panel, size_t ld, size_t height, size_t width,
                             double *x);
    void (*subtract_lanes)(const double *A, size_t ld, size_t rows, size_t columns, const double *x,
                           double *y);
    /* product (rows) := A x of a strip of at most six rows with columns (a multiple of four) at
     * entries index of x, in lanes: bitwise what subtract_strips subtracts */
    void (*multiply_strip_lanes)(const double *values, size_t rows, size_t columns,
                                 const int32_t *index, const double *x, double *product);
} pma_kernel;

/* The widest instructions of this processor. All kernels are bitwise identical: they differ in
 * how many registers four numbers take, not in the order of the sums. */
const pma_kernel *pma_kernel_best(void);

/* What every processor has, and what one with AVX2 has. */
const pma_kernel *pma_kernel_plain(void);
const pma_kernel *pma_kernel_avx2(void);

#endif
