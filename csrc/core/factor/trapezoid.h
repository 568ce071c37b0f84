/* trapezoid.h - the factor of one panel, a dense trapezoid by columns; of a dense matrix as well.
 *
 * height rows, of which the first `width` are those of its columns. What is above the diagonal is
 * neither read nor of use afterwards. */
#ifndef PMA_TRAPEZOID_H
#define PMA_TRAPEZOID_H

#include <stdbool.h>
#include <stddef.h>

#include "factor/blas.h"

/* A = G S G^T in place, in blocks, where S has the signs of the diagonal of G: its Cholesky factor
 * if they are positive. Its width, or the first column whose pivot is not above the part `lost` of
 * its diagonal entry, diagonal (width); indefinite: whose size is not. */
size_t pma_trapezoid_factor(double *panel, size_t width, size_t height, const double *diagonal,
                            double lost, bool indefinite, const pma_blas *blas);

/* From G to a unit diagonal: R_ij = G_ij / G_jj, D_j = S_j G_jj^2. inverse (width): output, of D */
void pma_trapezoid_scale(double *panel, size_t width, size_t height, double *inverse);

/* C (m x columns) := beta C + alpha X S Y^T, with `width` columns of X and Y, and S the signs of
 * the diagonal of G. */
void pma_trapezoid_multiply(pma_block G, size_t width, double alpha, pma_block X, size_t m,
                            pma_block Y, size_t columns, double beta, pma_block C,
                            const pma_blas *blas);

/* Unsymmetric: R has the columns, Q the rows of what is factored. R becomes the unit factor, Q that
 * of the transpose times D, with D on its diagonal. As above, pivots of any sign; the one that
 * fails goes to its diagonal entry. */
size_t pma_trapezoid_factor_pair(double *R, double *Q, size_t width, size_t height,
                                 double *diagonal, double lost, const pma_blas *blas);

/* Q to a unit diagonal. inverse (width): output, of D */
void pma_trapezoid_scale_pair(double *R, double *Q, size_t width, size_t height, double *inverse);

#endif
