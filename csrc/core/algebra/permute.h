/* permute.h - the rows and columns of a sparse matrix in another order. */
#ifndef PMA_PERMUTE_H
#define PMA_PERMUTE_H

#include <stddef.h>
#include <stdint.h>

/* B with B_kl = A_ij, i = order[k] and j = order[l]; ascending in each row, whatever A is.
 *
 * A by rows: ptr (n+1), index and values (ptr[n]). order (n): a permutation, and position (n) its
 * inverse. B_ptr (n+1), B_index, B_values (ptr[n]): output. Does not allocate. */
void pma_permute(size_t n, const int64_t *ptr, const int32_t *index, const double *values,
                 const int64_t *order, const int32_t *position, int64_t *B_ptr, int32_t *B_index,
                 double *B_values);

/* The entries of one row in ascending order of their indices, which differ. */
void pma_permute_sort(int64_t count, int32_t *index, double *values);

#endif
