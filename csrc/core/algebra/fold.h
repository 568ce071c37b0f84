/* fold.h - a chain folded in the middle: a tridiagonal matrix in the order 0, n-1, 1, n-2, ...
 *
 * A chain is eliminated from both ends at once without fill. Row i < n-1 couples with one row that
 * comes later, i + 2, or n - 1 for the last but one. So the sweeps are two recurrences side by side,
 * which do not wait for each other: one alone takes as long as both, since each operation waits for
 * the one before. R, Q and the entries beside the diagonal have one number a row, the last of which
 * is not read. */
#ifndef PMA_FOLD_H
#define PMA_FOLD_H

#include <stddef.h>

#include "status.h"

/* The row after row i < n-1 that it couples with. */
static inline size_t pma_fold_next(size_t n, size_t i)
{
    return i + 2 < n ? i + 2 : n - 1;
}

/* y -= A x for the rows begin..end-1, A_i,next(i) at above[i] and A_next(i),i at below[i]; bitwise
 * what the band of width 2 subtracts. */
void pma_fold_subtract(size_t n, const double *diagonal, const double *above, const double *below,
                       size_t begin, size_t end, const double *x, double *y);

/* Forward through the columns first..last-1, and backward; x[0] is unknown `first`. */
void pma_fold_eliminate(size_t n, const double *R, size_t first, size_t last, double *x);
void pma_fold_substitute(size_t n, const double *Q, const double *inverse, size_t first,
                         size_t last, double *x);

/* A = R D Q^T, R and Q in place of the entries below and above the diagonal; Q is NULL if A is
 * symmetric. inverse (n): the reciprocals of D. PMA_NOT_DEFINITE with the column whose pivot is not
 * above `lost` times its diagonal entry or has no reciprocal, or from which, if unsymmetric, more
 * than `growth` times that entry is subtracted                                      (F1) (F10) */
pma_status pma_fold_factor(size_t n, const double *diagonal, double lost, double growth, double *R,
                           double *Q, double *inverse, size_t *column);

#endif
