/* lanes.h - PMA_LANES vectors side by side, in one pass over a matrix or factor.
 *
 * Number i of lane l is at i * PMA_LANES + l (kernel.h): a vector register of numbers for each
 * unknown. A pass over a large factor takes about as long as for one vector, since it is the factor
 * that has to be read. Every lane is bitwise what one vector gets; no lane depends on another, so
 * that those that are not needed may hold zeros. Where one vector is updated element by element, as
 * by pma_update, it may as well be n * PMA_LANES long. */
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

/* out[l] (n): the vector of lane l, for the first `count` lanes */
void pma_lanes_split(size_t n, const double *x, size_t count, double *const *out);

#endif
