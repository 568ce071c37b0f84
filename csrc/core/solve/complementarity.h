/* complementarity.h - impulses that push and never pull: find P with               (U5) (U7) (U8)
 *
 *   0 <= P_n  _|_  y_n >= 0,   |P_t| <= mu P_n,   y = W P + b
 *
 * in the rows of contacts that are closed; P is zero in all others. Without friction by block
 * principal pivoting, which is exact and begins with the set of rows that pushed last; with
 * friction by sweeps over the contacts in turn. Deterministic: one thread solves, in a fixed
 * order. */
#ifndef PMA_COMPLEMENTARITY_H
#define PMA_COMPLEMENTARITY_H

#include <stddef.h>
#include <stdint.h>

#include "factor/elimination.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    size_t contacts;
    const int64_t *first; /* contacts+1: their rows; a normal one, then none, one or two tangents */
    const double *friction; /* contacts: mu */
    pma_blas blas;
} pma_complementarity_parts;

typedef struct pma_complementarity pma_complementarity;

/* Room for all rows at once: one square matrix of them. */
pma_status pma_complementarity_create(const pma_complementarity_parts *parts,
                                      pma_complementarity **out);
void pma_complementarity_destroy(pma_complementarity *x); /* NULL is allowed */

/* The matrix (rows x rows, by columns) is another one: nothing is kept of the last solution. */
void pma_complementarity_set(pma_complementarity *x, const double *W);

/* P (rows): in, what pushed last; out, the solution for b (rows) with the contacts of `closed`
 * (count, ascending) closed. PMA_NO_IMPULSES when the sweeps do not come to an end; *row is then
 * the row that is furthest from it. Does not allocate. */
pma_status pma_complementarity_solve(pma_complementarity *x, size_t count, const size_t *closed,
                                     const double *b, double *P, size_t *row);

/* How often block pivoting solved with another set of rows, the last time. */
size_t pma_complementarity_turns(const pma_complementarity *x);

#endif
