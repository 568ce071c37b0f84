/* factor.h - sweeps over a finished factor A = R D Q^T, R and Q unit lower triangular. (F1) (F10)
 *
 * Q is R where A is symmetric; else it has the pattern and the layout of R. The last nb unknowns
 * are the interface; R = [[R_ii, 0], [R_bi, R_bb]]. Sweeping the interior and the interface apart
 * is what lets one forward and one backward sweep make a coupled step.
 * With nb = n the interface solve is the whole solve: so the interface matrix H is swept too. */
#ifndef PMA_FACTOR_H
#define PMA_FACTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "algebra/panels.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct pma_factor {
    pma_form form; /* diagonal: R is the unit matrix */
    size_t n, nb;
    const double *inverse; /* n: the reciprocals of D */
    const double *values;  /* dense: n*n by columns, read below the diagonal; sparse: ptr[n];
                              band: n*width by columns, R_j+1+k,j at values[j*width + k] */
    const int64_t *ptr;    /* sparse: n+1 starts of the columns, else NULL */
    const int32_t *index;  /* sparse: row of each entry, below the diagonal and ascending */
    size_t width;          /* band: entries of a column below the diagonal, 1..n-1; in the last
                              columns the entries outside the matrix are zero */
    size_t Q;              /* where Q begins in values, laid out like R; 0: Q is R. Of panels,
                              panels.Q instead */
    pma_panels panels;     /* panels: see there */
    const struct pma_factor *each; /* in lanes: the factor of each, else NULL */
} pma_factor;

/* The factor that does the same in every lane (lanes.h), of PMA_LANES times its size; `each` has to
 * outlive it. */
pma_factor pma_factor_in_lanes(const pma_factor *each);

/* PMA_BAD_SIZE when nb > n or a band is too wide, PMA_BAD_INDEX unless the entries of each column
 * ascend and lie below the diagonal. */
pma_status pma_factor_check(const pma_factor *f);

/* Doubles of scratch that every function below needs as `work`; of a factor that was checked. */
size_t pma_factor_scratch(const pma_factor *f);

/* Entries read by a sweep through all columns. */
size_t pma_factor_entries(const pma_factor *f);

/* A step is opened with the right-hand side and closed with what acts on the interface:
 *
 * x (n): swept as far as the interface needs; xb (nb) := (A^-1 x)_b              (F2) (F3) */
void pma_factor_open(const pma_factor *f, double *x, double *xb, double *work);

/* The same without xb, which only an interface problem needs. */
void pma_factor_open_interior(const pma_factor *f, double *x, double *work);

/* x (n) as open left it := A^-1 (right-hand side + fb on the interface)       (F4) (F5) */
void pma_factor_close(const pma_factor *f, const double *fb, double *x, double *work);

/* ---- in parts, of which several threads can do the first ------------------------------------- */

/* x_i *= inverse_i in the rows begin..end-1 above the interface, of a diagonal factor: to close. */
void pma_factor_divide(const pma_factor *f, size_t begin, size_t end, double *x);

/* The interface: opened after the other rows, closed before them. */
void pma_factor_open_border(const pma_factor *f, double *x, double *xb, double *work);
void pma_factor_close_border(const pma_factor *f, const double *fb, double *x, double *work);

/* x (n) := A^-1 x, both at once */
void pma_factor_solve(const pma_factor *f, double *x, double *work);

/* xb (nb) := (A^-1)_bb xb = S^-1 xb with the Schur complement S = R_bb D_b Q_bb^T       (F3) */
void pma_factor_interface(const pma_factor *f, double *xb, double *work);

#endif
