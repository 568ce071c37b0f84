/* factor.h - sweeps over a finished factor A = R D R^T, R unit lower triangular.         (F1)
 *
 * The last nb unknowns are the interface; R = [[R_ii, 0], [R_bi, R_bb]]. Sweeping the interior
 * and the interface apart is what lets one forward and one backward sweep make a coupled step.
 * With nb = n the interface solve is the whole solve: so the interface matrix H is swept too. */
#ifndef PMA_FACTOR_H
#define PMA_FACTOR_H

#include <stddef.h>
#include <stdint.h>

#include "matrix.h"
#include "panels.h"
#include "status.h"

/* Bare arrays of the caller, who keeps them alive. */
typedef struct {
    pma_form form;         /* diagonal: R is the unit matrix */
    size_t n, nb;
    const double *inverse; /* n: the reciprocals of D */
    const double *values;  /* dense: n*n by columns, read below the diagonal; sparse: ptr[n] */
    const int64_t *ptr;    /* sparse: n+1 starts of the columns, else NULL */
    const int32_t *index;  /* sparse: row of each entry, below the diagonal and ascending */
    pma_panels panels;     /* panels: see there */
    double *work;          /* panels: pma_panels_most_height, scratch of the sweeps */
} pma_factor;

/* PMA_BAD_SIZE when nb > n, PMA_BAD_INDEX unless the entries of each column ascend and
 * lie below the diagonal. */
pma_status pma_factor_check(const pma_factor *f);

/* Entries read by one sweep through all columns. */
size_t pma_factor_entries(const pma_factor *f);

/* x (n): x_i := R_ii^-1 x_i, x_b := x_b - R_bi x_i                                      (F2) */
void pma_factor_forward(const pma_factor *f, double *x);

/* xb (nb): xb := S^-1 xb with the Schur complement S = R_bb D_b R_bb^T                  (F3) */
void pma_factor_interface(const pma_factor *f, double *xb);

/* x (n): x_i := R_ii^-T (D_i^-1 x_i - R_bi^T x_b), x_b as it is                         (F5) */
void pma_factor_backward(const pma_factor *f, double *x);

#endif
