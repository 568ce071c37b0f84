/* lu.h - the factor R D R^T from the triangles A = L U of another program. */
#ifndef PMA_LU_H
#define PMA_LU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"

/* Entries below the diagonal of L that are not zero: ptr (n+1) is output, their starts. */
void pma_lu_count(const pma_matrix *L, int64_t *ptr);

/* R and D of A = R D R^T, from A = L U with a one on the diagonal of L: R is L, and D the diagonal
 * of U. False unless U = D R^T, which holds if A is symmetric and its pivots were on the diagonal;
 * compared for one vector, to 1e-9 of the terms.
 *
 * L, U: sparse, by columns, in any order of rows. ptr (n+1) as counted. index, values (ptr[n]):
 * output, the entries of R below the diagonal, ascending in each column. D (n): output.
 * scratch: 2 n. Does not allocate. */
bool pma_lu_take(const pma_matrix *L, const pma_matrix *U, const int64_t *ptr, int32_t *index,
                 double *values, double *D, double *scratch);

#endif
