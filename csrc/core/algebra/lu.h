/* lu.h - sweeps over finished factors A = P^T L U Q^T of an unsymmetric matrix, P and Q
 * permutations, of whose unknowns the last p are wanted, with zeros on the right-hand side of the
 * others. */
#ifndef PMA_LU_H
#define PMA_LU_H

#include <stddef.h>
#include <stdint.h>

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

#endif
