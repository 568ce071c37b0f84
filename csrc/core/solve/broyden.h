/* broyden.h - an approximate inverse that learns from every residual.                     (N15)
 *
 * B ~ H^-1 starts as an inverse that is known and is corrected by Broyden's good formula, so that
 * it explains the last change of the residual. For few unknowns it is a matrix; for many the
 * corrections of the last macro steps are applied one after another. */
#ifndef PMA_BROYDEN_H
#define PMA_BROYDEN_H

#include <stddef.h>

#include "solve/interface.h"

/* Up to this number of unknowns B is a matrix; beyond, this number of corrections is kept. */
enum { PMA_BROYDEN_DENSE = 500, PMA_BROYDEN_KEPT = 30 };

/* Works on numbers of the caller's, `pma_broyden_size`, of which the state consists. */
typedef struct {
    size_t p;
    const pma_interface *start; /* the inverse that B starts as */
    double *state;
} pma_broyden;

size_t pma_broyden_size(size_t p);

/* The number of counts that these begin with, 0 or 1. */
size_t pma_broyden_counts(size_t p);

/* B := the inverse that it starts as; scratch (p) */
void pma_broyden_begin(const pma_broyden *b, double *scratch);

/* x (p) := B r */
void pma_broyden_apply(const pma_broyden *b, const double *r, double *x);

/* B y = s from now on: the residual has changed by y, where the unknowns changed by s and would
 * have to change by -s for no change. scratch (3 p). A change that says nothing is left out. */
void pma_broyden_learn(const pma_broyden *b, const double *s, const double *y, double *scratch);

#endif
