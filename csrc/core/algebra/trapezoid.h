/* trapezoid.h - the factor of one panel, a dense trapezoid by columns, with BLAS.
 *
 * The first `width` of `height` rows are the diagonal block. */
#ifndef PMA_TRAPEZOID_H
#define PMA_TRAPEZOID_H

#include <stddef.h>

#include "algebra/blas.h"

/* Its Cholesky factor G in place, in blocks; its width, or the first column whose pivot is not
 * above the part `lost` of its diagonal entry, diagonal (width). */
size_t pma_trapezoid_factor(double *panel, size_t width, size_t height, const double *diagonal,
                            double lost, const pma_blas *blas);

/* From G to a unit diagonal: R_ij = G_ij / G_jj, D_j = G_jj^2. inverse (width): output, of D */
void pma_trapezoid_scale(double *panel, size_t width, size_t height, double *inverse);

/* Unsymmetric: R has the columns, Q the rows of what is factored. R becomes the unit factor, Q that
 * of the transpose times D, with D on its diagonal. As above, pivots of any sign; the one that
 * fails goes to its diagonal entry. */
size_t pma_trapezoid_factor_pair(double *R, double *Q, size_t width, size_t height,
                                 double *diagonal, double lost, const pma_blas *blas);

/* Q to a unit diagonal. inverse (width): output, of D */
void pma_trapezoid_scale_pair(double *R, double *Q, size_t width, size_t height, double *inverse);

#endif
