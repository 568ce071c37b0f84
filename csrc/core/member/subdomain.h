/* subdomain.h - one subdomain: its matrices, its state and the verbs of a step.
 *
 *   open        the free problem of one own step, as far as the free velocity on the interface
 *   close       the same step with the multipliers: the new state
 *   compliance  velocity on the interface for a unit of multipliers: the subdomain's block of H
 *
 * All arrays are in elimination order: the nb interface dofs come last. */
#ifndef PMA_SUBDOMAIN_H
#define PMA_SUBDOMAIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "algebra/matrix.h"
#include "member/energy.h"
#include "member/load.h"
#include "member/restoring.h"
#include "member/scheme.h"
#include "member/springs.h"
#include "member/state.h"
#include "status.h"

/* What one step length needs: constants and the factor of Mbar. */
typedef struct {
    pma_step step;
    pma_factor factor;
} pma_operator;

/* Own steps in a macro step; with as many macro steps as a coupler takes, no count overflows. */
#define PMA_MOST_SUBSTEPS ((size_t)1 << 31)

/* What a subdomain is made of. The arrays behind it are the caller's, who keeps them alive. */
typedef struct {
    size_t n, nb, substeps;
    bool doubled;        /* takes double steps after the start */
    bool lagged;         /* C acts on vs, outside Mbar (R4) */
    bool ramped;         /* has to answer to ramps (M3): substeps under macro coupling */
    pma_matrix K, C;
    pma_restoring restoring;
    pma_springs springs; /* beside the restoring force */
    pma_matrix D_r;      /* estimate of the damping of both (R2) */
    pma_matrix K_r;      /* estimate of its stiffness, as a ramp meets it (M3) */
    pma_operator single; /* own step h */
    pma_operator twice;  /* 2 h; read only if doubled */
    pma_link link;
} pma_parts;

typedef struct pma_subdomain pma_subdomain;

/* Checks the parts and allocates all that stepping needs, zeroed. */
pma_status pma_subdomain_create(const pma_parts *parts, pma_subdomain **out);
void pma_subdomain_destroy(pma_subdomain *s); /* NULL is allowed */

const pma_parts *pma_subdomain_parts(const pma_subdomain *s);

/* Room for going on before the last macro step is committed: own nodes up to twice the substeps,
 * and for a double-step subdomain two steps that are opened. */
pma_status pma_subdomain_look_ahead(pma_subdomain *s);

void pma_subdomain_set_load(pma_subdomain *s, pma_load load);
const pma_load *pma_subdomain_load(const pma_subdomain *s);

/* out (p) += al2 L_b S^-1 L_b^T lam, lam (p), with the operator of the single or double step: L_b
 * times the link velocity of lam (14), and for unit multipliers the block of H (F6) */
void pma_subdomain_compliance(pma_subdomain *s, bool twice, const double *lam, double *out);

/* ---- the present: the last whole macro step --------------------------------------------- */

/* State at t = 0: u, v, w (n each) and lam (p); a = w, stored free velocity by (S2), springs taken
 * from no deformation to u. */
void pma_subdomain_start(pma_subdomain *s, const double *u, const double *v, const double *w,
                         const double *lam);

/* All that the next macro step reads, for analysis and for saving; pointers into the subdomain,
 * valid until the next open or commit, to be read or written in between. Steps opened beyond the
 * present are discarded. */
typedef struct {
    pma_state present;
    double *vf;            /* nb: stored free velocity of the present */
    pma_state previous;    /* the own node before; NULL pointers unless doubled */
    double *vf_previous;   /* nb: its stored free velocity, which no step reads */
} pma_nodes;

pma_nodes pma_subdomain_nodes(pma_subdomain *s);

/* ---- energy: from the present on, of every own step until it is ended --------------------- */

/* Works are summed up from here, under load (n) and lam (p); M is the mass matrix. Allocates. */
pma_status pma_subdomain_begin_energy(pma_subdomain *s, pma_matrix M, const double *load,
                                      const double *lam);
void pma_subdomain_end_energy(pma_subdomain *s); /* NULL and one without energy are allowed */
bool pma_subdomain_has_energy(const pma_subdomain *s);

/* The works of own step j of a ramped subdomain, when its response to dlam (p) has come to j: the
 * known run was under lam (p). */
void pma_subdomain_add_works(pma_subdomain *s, size_t j, const double *lam, const double *dlam);

/* out (PMA_ENERGIES): at own node j, the last one closed */
void pma_subdomain_tell_energy(const pma_subdomain *s, size_t j, double *out);

/* ---- inside a macro step: own nodes are counted 0..substeps from its beginning ------------
 *
 * Having looked ahead, they go on beyond it, and commit takes the first `substeps` away. */

/* The state at own node j; j = 0 is the present. Valid until the next open or commit. */
const pma_state *pma_subdomain_at(const pma_subdomain *s, size_t j);

/* Free problem (13) from own node j to j+1 at time t1, own step number `step` of the whole run;
 * double: from j-1, with twice the step. A called load and the restoring force are asked here,
 * once. They may fail: PMA_FORCE_FAILED, PMA_RESTORING_FAILED, with the code they returned. */
pma_status pma_subdomain_open(pma_subdomain *s, size_t j, bool twice, double t1, int64_t step);

/* What the function that failed last returned. */
int pma_subdomain_code(const pma_subdomain *s);

/* F (n) := F(t) of a load that is no table, as open would ask for it */
pma_status pma_subdomain_force(pma_subdomain *s, double t, double *F);

/* r (n) := r(u, v, t), the restoring force as open would ask for it, with springs that were never
 * loaded before */
pma_status pma_subdomain_restore(pma_subdomain *s, double t, const double *u, const double *v,
                                 double *r);

/* jump (p) += scale L_b vf at own node j + theta, by linear interpolation                (15) */
void pma_subdomain_free_velocity(const pma_subdomain *s, size_t j, double theta, double scale,
                                 double *jump);

/* jump (p) += L_b v and L_b u at own node j */
void pma_subdomain_total_velocity(const pma_subdomain *s, size_t j, double *jump);
void pma_subdomain_total_displacement(const pma_subdomain *s, size_t j, double *jump);

/* Link problem (14) of the step opened towards own node j, added. PMA_NOT_FINITE when a value of
 * the new state is not finite. */
pma_status pma_subdomain_close(pma_subdomain *s, size_t j, bool twice, const double *lam);

/* ---- the same single step by several threads, in ranges of rows ---------------------------
 *
 * Of a subdomain that divides: open is ask, predict_rows, force_rows and open_interface, close is
 * close_interface, correct_rows and close_energy. Of the rows of one stage all have to be done
 * before the next one begins. The same bits, whatever the ranges are. */

/* Diagonal Mbar, linear, single steps: no row waits for another in the same stage. */
bool pma_subdomain_divides(const pma_subdomain *s);

/* The load at time t1; fails as open does. */
pma_status pma_subdomain_ask(pma_subdomain *s, double t1, int64_t step);

/* (5), (6) of the step from own node j, and (11) */
void pma_subdomain_predict_rows(const pma_subdomain *s, size_t j, size_t begin, size_t end);
void pma_subdomain_force_rows(const pma_subdomain *s, size_t j, double t1, int64_t step,
                              size_t begin, size_t end);

/* The free velocity on the interface; the step is open then. */
void pma_subdomain_open_interface(pma_subdomain *s, size_t j);

/* (14) on the interface, of the step opened towards own node j */
void pma_subdomain_close_interface(pma_subdomain *s, size_t j, const double *lam);

/* (14) inside, (8), (9); true when every new value is finite */
bool pma_subdomain_correct_rows(const pma_subdomain *s, size_t j, size_t begin, size_t end);

/* Tells the energy, if somebody asks for it, of the state at own node j. */
void pma_subdomain_close_energy(pma_subdomain *s, size_t j, bool twice, const double *lam);

/* true while vf at own node j is finite */
bool pma_subdomain_free_is_finite(const pma_subdomain *s, size_t j);

/* Changes the stored free velocity at own node j over to the double step, after the start  (S3) */
void pma_subdomain_rebase(pma_subdomain *s, size_t j, const double *lam);

/* The last own node of the macro step becomes the present. Swaps pointers, cannot fail. */
void pma_subdomain_commit(pma_subdomain *s);

/* The own node up to which steps have been opened, counted from the present; a new state or load
 * and `discard` make it 0, and they have to be opened again. */
size_t pma_subdomain_opened(const pma_subdomain *s);
void pma_subdomain_discard(pma_subdomain *s);

/* ---- macro coupling: the response to a ramp of multipliers, of a ramped subdomain ---------- */

/* States at the end of a macro step for unit multipliers, so that (M3) need not be repeated. */
typedef struct {
    size_t count;         /* conditions; 0: nothing is stored, the substeps are repeated */
    const int64_t *rows;  /* count, each in 0..p-1 */
    const double *values; /* count x 4 x n by rows: u, v, w, a of each */
} pma_response;

void pma_subdomain_set_response(pma_subdomain *s, pma_response response);
bool pma_subdomain_is_stored(const pma_subdomain *s);

/* vf at own node 1 += al2 S^-1 L_b^T lam: the velocity with the multipliers held          (M6) */
void pma_subdomain_hold(pma_subdomain *s, bool twice, const double *lam);

/* Substep j = 1..substeps of the response, from rest, to lam (p) times j / substeps       (M3) */
void pma_subdomain_respond(pma_subdomain *s, size_t j, const double *lam);

/* The state of the response after the last substep asked for; u, v, w, a lie in a row. */
const pma_state *pma_subdomain_response(const pma_subdomain *s);

/* The last own node of the macro step += its response to lam, stored or just repeated. (M5)
 * PMA_NOT_FINITE as close. */
pma_status pma_subdomain_add_response(pma_subdomain *s, const double *lam);

/* All substeps of the response to lam (p): end (p) += L_b v of the last, mean (p) += the mean of
 * all of them, which is far larger where the subdomain resonates with the macro step. */
pma_status pma_subdomain_ramp(pma_subdomain *s, const double *lam, double *end, double *mean);

/* Entries read by one own step, a measure of its duration. */
size_t pma_subdomain_entries(const pma_subdomain *s);

#endif
