/* cone.h - impulses of closed contacts with friction, on cones without facets:        (U5) to (U8)
 *
 *   0 <= P_n  _|_  y_n >= 0,   |P_t| <= mu P_n,   y_t = 0 inside of the cone, against P_t on it
 *
 * Newton's method on which contacts push, stick and slide, which is exact up to rounding, and
 * sweeps over the contacts in turn where it does not come to an end. */
#ifndef PMA_CONE_H
#define PMA_CONE_H

#include <stddef.h>

#include "status.h"

/* Arrays of the caller. */
typedef struct {
    size_t contacts, rows; /* that are closed, and all of their rows */
    const size_t *at;      /* contacts+1: first row of each: normal, then none, one, two tangents */
    const double *mu;      /* contacts */
    double *W, *b;         /* rows x rows, by columns; rows: changed in between, and put back */
    double *z, *y;         /* rows: P, in what pushed last, out the solution; y = W z + b */
} pma_cone_problem;

/* What is kept: the factor of Newton's matrix. */
typedef struct pma_cone pma_cone;

/* For up to `rows` rows: room for a square matrix of them, up to 1000. NULL without memory. */
pma_cone *pma_cone_create(size_t rows);
void pma_cone_destroy(pma_cone *x); /* NULL is allowed */

/* W is another one. */
void pma_cone_forget(pma_cone *x);

enum { PMA_MOST_SWEEPS = 5000 };

/* PMA_NO_IMPULSES when the sweeps do not come to an end; *row is then the row that is furthest from
 * it. The last digits do not depend on what was kept. Does not allocate. */
pma_status pma_cone_solve(pma_cone *x, const pma_cone_problem *p, size_t *row);

#endif
