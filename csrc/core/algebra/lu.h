/* lu.h - sweeps over finished factors A = P^T L U Q^T of an unsymmetric matrix, P and Q
 * permutations, of whose unknowns the last p are wanted, with zeros on the right-hand side of the
 * others. */
#ifndef PMA_LU_H
#define PMA_LU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    size_t n, p;           /* unknowns; those that are wanted */
    const double *inverse; /* n: the reciprocals of the diagonal of U; that of L is one */
    const int64_t *below;  /* n+1 starts of the columns of L, below the diagonal */
    const int32_t *lower;  /* row of each entry */
    const double *L;       /* below[n] */
    const int64_t *above;  /* n+1 starts of the columns of U, above the diagonal */
    const int32_t *upper;  /* row of each entry */
    const double *U;       /* above[n] */
    const int32_t *row;    /* p: the row of L of each wanted unknown's equation, */
    const int32_t *column; /* p: and the column of U of the unknown itself */
} pma_lu;

/* PMA_BAD_SIZE when p > n, PMA_BAD_INDEX unless the entries of L are below the diagonal, those of U
 * above it and the places in 0..n-1. */
pma_status pma_lu_check(const pma_lu *f);

/* Entries read by a solution. */
size_t pma_lu_entries(const pma_lu *f);

/* x (p) := the wanted part of A^-1 (0, x); work (n): scratch */
void pma_lu_solve(const pma_lu *f, double *x, double *work);

/* ---- from triangles of another program ------------------------------------------------------- */

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
