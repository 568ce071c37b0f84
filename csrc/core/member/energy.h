/* energy.h - where the energy of a subdomain goes: works summed up own step by own step.
 *
 * Only for a run that asks for it. A subdomain that has an energy tells it the load of each step it
 * opens, and each state it closes; its own numbers are read and never changed. */
#ifndef PMA_ENERGY_H
#define PMA_ENERGY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/link.h"
#include "algebra/matrix.h"
#include "status.h"

/* What is told of a node: T and U there, and the works done since the beginning.     (B1) (B2) */
enum { PMA_KINETIC, PMA_STRAIN, PMA_DISSIPATED, PMA_EXTERNAL, PMA_INTERFACE_WORK, PMA_ENERGIES };

/* Matrices in elimination order. The arrays behind them are the caller's, who keeps them alive. */
typedef struct {
    size_t n, nb;
    size_t ahead; /* steps opened before the first of them is closed: 1, or those of a known run */
    pma_matrix M, K, C;
    pma_link link;
} pma_energy_parts;

typedef struct pma_energy pma_energy;

/* Checks M, which the subdomain does not have, and allocates all that is needed. */
pma_status pma_energy_create(const pma_energy_parts *parts, pma_energy **out);
void pma_energy_destroy(pma_energy *e); /* NULL is allowed */

/* All works are zero at this node: u and v (n), under load (n) and multipliers lam (p). */
void pma_energy_begin(pma_energy *e, const double *u, const double *v, const double *load,
                      const double *lam);

/* A step is being opened: where to add the load (n) at its end. */
double *pma_energy_open(pma_energy *e);

/* The restoring force r (n) of the step opened last, r[order[i]] that of dof i. Of the node at the
 * beginning nobody knows it: there it counts as that of the first step. */
void pma_energy_restore(pma_energy *e, const int64_t *order, const double *r);

/* What the springs dissipated in the step opened last; of the first one after the beginning, from
 * the node where it all began. */
void pma_energy_slip(pma_energy *e, double dissipated);
bool pma_energy_is_first(const pma_energy *e); /* is that step the first one? */

/* A step has been closed: u and v (n) at its end, lam (p). A double step adds its works to those of
 * the node before the last one, but for the first step after the beginning.                 (B3) */
void pma_energy_close(pma_energy *e, const double *u, const double *v, const double *lam,
                      bool twice);

/* The step opened last has been closed as far as it is known (M2): u and v (n) there. */
void pma_energy_know(pma_energy *e, const double *u, const double *v);

/* The first step that is known and not closed yet: u and v (n) of its response (M3) added to what
 * is known, under lam + share dlam (p each). */
void pma_energy_add(pma_energy *e, const double *u, const double *v, const double *lam,
                    const double *dlam, double share);

/* out (PMA_ENERGIES): T and U (without springs) of u and v (n), the node last closed, and the works
 * up to it */
void pma_energy_tell(pma_energy *e, const double *u, const double *v, double *out);

#endif
