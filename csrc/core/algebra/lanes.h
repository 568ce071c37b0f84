/* lanes.h - PMA_LANES vectors side by side, in one pass over a matrix or factor.
 *
 * Number i of lane l is at i * PMA_LANES + l (kernel.h): a vector register of numbers for each
 * unknown. A pass over a large factor takes about as long as for one vector, since it is the factor
 * that has to be read. Each function does in every lane what the function of one vector does
 * that it names, bitwise; no lane depends on another, so that those that are not needed may hold
 * zeros. Sizes are those of one lane: an `x (n)` has
 * n * PMA_LANES doubles, and scratch `work` has PMA_LANES times that of one vector. Where one
 * vector is updated element by element, as by pma_update, it may as well be n * PMA_LANES long. */
#ifndef PMA_LANES_H
#define PMA_LANES_H

#include "algebra/factor.h"
#include "algebra/kernel.h"
#include "algebra/link.h"
#include "algebra/matrix.h"

/* A matrix or factor that does the same in every lane, of PMA_LANES times its size, for the
 * functions of matrix.h and factor.h: ranges of rows begin and end with whole unknowns. `each` has
 * to outlive it. */
pma_matrix pma_lanes_matrix(const pma_matrix *each);
pma_factor pma_lanes_factor(const pma_factor *each);
pma_link pma_lanes_link(const pma_link *each);

/* y (n) -= A x                                                           pma_matrix_subtract */
void pma_lanes_subtract(const pma_matrix *A, const double *x, double *y);
void pma_lanes_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                             double *y);

/* Sweeps over a factor                         pma_factor_open, _close, _solve and _interface */
void pma_lanes_open(const pma_factor *f, double *x, double *xb, double *work);
void pma_lanes_close(const pma_factor *f, const double *fb, double *x, double *work);
void pma_lanes_solve(const pma_factor *f, double *x, double *work);
void pma_lanes_interface(const pma_factor *f, double *xb, double *work);

/* Forward through the columns first..last-1 of a factor whose interface is last, and backward; x[0]
 * is unknown `first`. */
void pma_lanes_eliminate(const pma_factor *f, size_t first, size_t last, double *x, double *work);
void pma_lanes_substitute(const pma_factor *f, size_t first, size_t last, double *x, double *work);

/* xb (nb) += L_b^T lam, lam (p)                                                  pma_link_add */
void pma_lanes_add(const pma_link *L, const double *lam, double *xb);

/* jump (p) += scale L_b xb                                                    pma_link_gather */
void pma_lanes_gather(const pma_link *L, double scale, const double *xb, double *jump);

/* out[l] (n): the vector of lane l, for the first `count` lanes */
void pma_lanes_split(size_t n, const double *x, size_t count, double *const *out);

#endif
