/* path.h - an interface anywhere in the order of elimination, reached along paths of the tree.
 *
 * Where an interface covers much of a subdomain, to eliminate it last fills the factor several
 * times. In the ordinary order a right-hand side on the interface reaches only the supernodes
 * between it and the roots of the elimination tree, and the solution on the interface needs no
 * others: sweeps along these paths couple, at the cost of reading their part of the factor. */
#ifndef PMA_PATH_H
#define PMA_PATH_H

#include <stddef.h>
#include <stdint.h>

#include "algebra/panels.h"
#include "status.h"

/* Bare arrays of the caller. */
typedef struct {
    const int64_t *place;      /* n: position in the order of each unknown, the interface last */
    const int64_t *supernodes; /* count, ascending: of the interface and all above them */
    size_t count;
} pma_path;

/* PMA_BAD_INDEX unless place is a permutation and the supernodes are closed upwards and hold the
 * last nb unknowns. Allocates n bytes meanwhile: PMA_NO_MEMORY. */
pma_status pma_path_check(const pma_path *path, const pma_panels *p, size_t n, size_t nb);

/* Entries of the factor on the paths. */
size_t pma_path_entries(const pma_path *path, const pma_panels *p);

/* A = P^T R D R^T P, P x the unknowns in the order of elimination. `lanes` vectors side by side, 1
 * or PMA_LANES (kernel.h); sizes count numbers of one of them. aside: scratch,
 * n + pma_panels_most_height: a vector in the order of elimination, and what panels need.
 *
 * x (n) := y = R^-1 P x, the free problem swept forward; xb (nb) := (P^T R^-T D^-1 y)_b    (F7) */
void pma_path_open(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                   size_t nb, size_t lanes, double *x, double *xb, double *aside);

/* x (n) := P^T R^-T D^-1 (x + R^-1 P fb), fb (nb) on the interface                         (F8) */
void pma_path_close(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                    size_t nb, size_t lanes, const double *fb, double *x, double *aside);

/* x (n) := A^-1 x */
void pma_path_solve(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                    size_t lanes, double *x, double *aside);

/* xb (nb) := (A^-1)_bb xb                                                                   (F9) */
void pma_path_interface(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                        size_t nb, size_t lanes, double *xb, double *aside);

#endif
