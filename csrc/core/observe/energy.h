/* energy.h - where the energy of a subdomain goes: works summed up substep by substep.
 *
 * An observer: it is shown each substep that is closed and copies what it needs; the numbers of the
 * subdomain are read and never changed. Its sums belong to time levels, so they are committed with
 * them, and the sums of a macro step that is abandoned are lost with it. */
#ifndef PMA_ENERGY_H
#define PMA_ENERGY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/link.h"
#include "algebra/matrix.h"
#include "forces/load.h"
#include "forces/restoring.h"
#include "forces/springs.h"
#include "state.h"
#include "status.h"

/* Of a time level: T and U there, the works done since the beginning, and the share in E*, or if
 * that is not asked for T + U - F . u.                                         (B1) (B2) (M9) */
enum {
    PMA_KINETIC,
    PMA_STRAIN,
    PMA_DISSIPATED,
    PMA_EXTERNAL,
    PMA_INTERFACE_WORK,
    PMA_CONTACT_WORK,
    PMA_CONSERVED,
    PMA_ENERGIES
};

/* Matrices in elimination order. What is pointed to is the subdomain's, and the caller's. */
typedef struct {
    size_t n, nb, substeps;
    bool has_responses; /* all substeps may be closed in a free macro run before any is complete */
    bool doubled;
    bool implicit; /* and so are the double steps */
    pma_matrix M, K, C;
    pma_matrix skew; /* (K - K^T) / 2, whose work is counted as dissipated                  (B7) */
    pma_link link;
    const pma_load *load;
    const pma_restoring *restoring;
    const double *internal;  /* n: internal forces of functions, as evaluated last; NULL: none */
    const double *potential; /* their energy, as evaluated last; NULL: none has one */
    const pma_springs *springs;
} pma_energy_parts;

typedef struct pma_energy pma_energy;

/* Checks M and skew, which the subdomain does not have, and allocates all that is needed. */
pma_status pma_energy_create(const pma_energy_parts *parts, pma_energy **out);
void pma_energy_destroy(pma_energy *e); /* NULL is allowed */

/* All works are zero at the present x, under load (n) and multipliers lam (p). Internal forces and
 * their potential have been evaluated there. Restoring functions gave `functions` there, forces and
 * loads that they contain (2 n), or where that is NULL what they give in the first substep. */
void pma_energy_begin(pma_energy *e, const pma_state *x, const double *load, const double *lam,
                      const double *functions);

/* The works of `from` go on, for the same subdomain with other steps. */
void pma_energy_follow(pma_energy *e, const pma_energy *from);
const pma_energy_parts *pma_energy_get_parts(const pma_energy *e);

/* What a later run goes on with, `size` numbers: u, F, C v + r (n each), L_b^T Lam (nb), what
 * springs remember, and 5 sums, at the present and at the time level before it, from which double
 * steps begin. False before the first macro step. A run that resumes has begun, with works that are
 * zero at the present. */
size_t pma_energy_size(const pma_energy *e);
bool pma_energy_keep(const pma_energy *e, double *out);
void pma_energy_resume(pma_energy *e, const double *in);

/* A substep has been closed: the state x at its end, lam (p). No later substep has been opened yet,
 * so that a called load and the restoring force have the values of this one. The works of a double
 * step are added to the sums of the time level before the last one. The first substep after the
 * beginning has none there: its works are those from the present, and in implicit subdomains that
 * of the interface such that nothing is added to the energy.                       (B3) (B14) */
void pma_energy_close(pma_energy *e, const pma_substep *step, const pma_state *x,
                      const double *lam);

/* The same in two calls: in the free macro run (M2) and, substep after substep, when the link
 * response r (M3) has come to time level j, under lam + j / substeps dlam (p each). */
void pma_energy_close_free(pma_energy *e, const pma_substep *step, const pma_state *x);
void pma_energy_advance_response(pma_energy *e, size_t j, bool twice, const pma_state *r,
                                 const double *lam, const double *dlam);

/* Mean coupling: the multipliers of the macro step, which begin with it, and those of a double step
 * with the macro step before. */
void pma_energy_hold(pma_energy *e, bool twice, const double *lam);

/* (M9)  E* is asked for from here on: w . (M + weight K) w / 2 + v . K v / 2 */
void pma_energy_conserve(pma_energy *e, double weight);

/* The work of the impulses of contacts in the substep that ended at time level j          (U10) */
void pma_energy_add_work(pma_energy *e, size_t j, double work);

void pma_energy_commit(pma_energy *e);

/* out (PMA_ENERGIES): T and U of the state x at time level j, the works up to it, and a share in
 * what is conserved */
void pma_energy_at(pma_energy *e, size_t j, const pma_state *x, double *out);

#endif
