/* subdomain.h - one subdomain: its matrices, its state, and the member it is to a coupler.
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
#include "forces/internal.h"
#include "forces/load.h"
#include "forces/restoring.h"
#include "forces/springs.h"
#include "observe/balance.h"
#include "observe/energy.h"
#include "rig/limits.h"
#include "state.h"
#include "status.h"
#include "subdomain/impulse.h"
#include "subdomain/iterate.h"
#include "subdomain/levels.h"
#include "subdomain/member.h"
#include "subdomain/response.h"
#include "subdomain/scheme.h"

/* What one step length needs: constants and the factor of Mbar. */
typedef struct {
    pma_step step;
    pma_factor factor;
} pma_operator;

/* Substeps in a macro step; with as many macro steps as a coupler takes, no count overflows. */
#define PMA_MOST_SUBSTEPS ((size_t)1 << 31)

/* What a subdomain is made of. The arrays behind it are the caller's and have to outlive it. Last
 * is what every substep reads. */
typedef struct {
    bool continues;      /* double steps in the first macro step too: it has a time level before the
                       present */
    bool has_responses;  /* has a link response (M3): substeps under macro coupling */
    bool has_internal;   /* forces, iterated or not: M */
    pma_factor mass;     /* of M, under mean coupling */
    pma_matrix M;        /* of a subdomain with internal forces */
    pma_springs springs; /* beside the restoring force, or iterated */
    pma_internal internal;
    const pma_iterate_parts *iterate; /* of an implicit subdomain with internal forces, else NULL;
                                         its factors are then not read */
    pma_impulse_parts
        impulse;        /* contacts: masses of the interface dofs that they reach; else zeroed */
    pma_matrix D_r;     /* estimate of the damping of both (R2) */
    pma_matrix K_r;     /* estimate of their stiffness, for the link response (M3) */
    pma_step second;    /* of a scheme of two stages: that of the second */
    pma_operator twice; /* of the double step, 2 h or, over a change of the step, the time from the
                            level before to the next one; read only if doubled */
    pma_restoring restoring;

    size_t n, nb, substeps;
    bool doubled; /* takes double steps after the start */
    bool staged;  /* substeps are the two stages of a step, with one Mbar: the second by `second` */
    bool lagged;  /* C acts on vs, outside Mbar (R4) */
    bool mean;    /* responds to a constant acceleration of the interface (K3): mean coupling */
    bool deferred;       /* ... with single steps, closed once the multipliers are known (K7) */
    pma_operator single; /* of the substep h */
    pma_link link;
    pma_matrix K, C;
} pma_parts;

/* Checks the parts and allocates all that stepping needs, zeroed. PMA_BAD_STEP when the operator of
 * the double step is not one of twice the length, or not a longer one of a subdomain that
 * continues, and when two stages have not one Mbar. */
pma_status pma_subdomain_create(const pma_parts *parts, pma_subdomain **out);
void pma_subdomain_destroy(pma_subdomain *s); /* NULL is allowed */

const pma_parts *pma_subdomain_parts(const pma_subdomain *s);

/* The numbers that springs and restoring function remember of a time level, in this order. */
size_t pma_parts_memory(const pma_parts *parts);

/* What a coupler is given; the subdomain has to outlive it. */
pma_member pma_subdomain_member(pma_subdomain *s);

/* What is open is discarded. */
void pma_subdomain_set_load(pma_subdomain *s, pma_load load);
const pma_load *pma_subdomain_load(const pma_subdomain *s);

/* ---- the present: the last whole macro step ------------------------------------------------- */

/* State at t = 0: u, v, w (n each) and lam (p); a = w, stored free velocity by (S2), springs taken
 * from no deformation to u. */
void pma_subdomain_start(pma_subdomain *s, const double *u, const double *v, const double *w,
                         const double *lam);

/* The stored free velocity of the present becomes the one that, with lam and the operator of the
 * single or the double step, gives the velocity there (S3); iterated subdomains make their own in
 * each step (N13). What is open is discarded. */
void pma_subdomain_rebase(pma_subdomain *s, bool twice, const double *lam);

/* The state at the present. Valid until the next commit. */
const pma_state *pma_subdomain_present(const pma_subdomain *s);

/* All that the next macro step reads, for analysis and for saving, beside what iterations keep: the
 * arrays of levels.h, valid until the next open or commit, to be read or written in between. What
 * is open is discarded. */
size_t pma_subdomain_arrays(pma_subdomain *s, pma_state_array out[PMA_LEVEL_ARRAYS]);

/* The same to be read, which leaves what is open. */
size_t pma_subdomain_kept(const pma_subdomain *s, pma_state_array out[PMA_LEVEL_ARRAYS]);

/* c (3) := displacement (5), extrapolated velocity (R1) and acceleration at which the restoring
 * force of a substep is evaluated, at position i, before that substep is opened. */
void pma_subdomain_command(const pma_subdomain *s, const pma_substep *step, size_t i, double *c);

/* u, v (n) := the first two at all positions; u has 4 n numbers, which are scratch, and the numbers
 * that functions remember. PMA_LIMITED where the rig of the specimen would refuse that command.
 * Functions that remember something are then called as in the step, and what they make of it is
 * thrown away: one behind compensators learns what it will be given, and may return any code. */
pma_status pma_subdomain_admit(const pma_subdomain *s, const pma_substep *step, double *u,
                               double *v);

/* ---- what set-up evaluates ------------------------------------------------------------------ */

/* F (n) := the functions among the loads at t, as `open` evaluates them */
pma_status pma_subdomain_force(pma_subdomain *s, double t, double *F);

/* r (n) := r(t, u, v) + f(t, u, v; q): the restoring force as `open` evaluates it, with springs
 * that were never loaded before, and the internal forces from their initial histories: what these
 * become is what the next start takes */
pma_status pma_subdomain_evaluate_restoring(pma_subdomain *s, double t, const double *u,
                                            const double *v, double *r);

/* What the function that failed last returned. */
int pma_subdomain_code(const pma_subdomain *s);

/* What an iteration keeps, to be saved and restored; NULL unless the subdomain is iterated. */
pma_iterate *pma_subdomain_iterate(pma_subdomain *s);

/* y (n) := M^-1 L_b^T lam: mean coupling alone                                             (K1) */
void pma_subdomain_push(pma_subdomain *s, const double *lam, double *y);

/* Unit responses that set-up has stored; see response.h. NULL unless it has responses. */
pma_response *pma_subdomain_response(pma_subdomain *s);

/* ---- the balance of forces that are evaluated (balance.h) ------------------------------------ */

/* Watched from the present on, with these matrices: M, and K_r where it acts. Allocates. Steps that
 * follow a motion out of bounds fail with PMA_UNBOUNDED. */
pma_status pma_subdomain_watch(pma_subdomain *s, pma_matrix M, pma_matrix K_r, bool is_explicit);

/* The same for cases side by side (cases.h), as each is. */
pma_status pma_subdomain_watch_lanes(pma_subdomain *s, const pma_subdomain *each);

/* The present was written. */
void pma_subdomain_watch_again(pma_subdomain *s);

/* What was seen so far; NULL where it is not watched. */
const pma_balance *pma_subdomain_balance(const pma_subdomain *s);

/* ---- a specimen among the restoring forces (rig.h) ------------------------------------------- */

/* What it may be commanded and may return; these arrays are the caller's. Allocates. Steps that
 * would leave the limits fail with PMA_LIMITED before the command is given. */
pma_status pma_subdomain_limit(pma_subdomain *s, const pma_limits_parts *parts);
/* What was exceeded, after PMA_LIMITED; the dof is in elimination order. */
pma_breach pma_subdomain_breach(const pma_subdomain *s);

/* From now on, until both are NULL: when its function is called and returns, if it has one, and the
 * clock by which its limits judge commands. Allocates where it has a stamp and no limits. */
pma_status pma_subdomain_time(pma_subdomain *s, pma_stamp *stamp, const pma_limits_clock *clock);

/* ---- energy: from the present on, of every substep until it is ended ------------------------ */

/* Evaluates the internal forces of functions and their potential at the present, time t, from the
 * histories there, so that the energy which is then begun has them at its first time level. */
pma_status pma_subdomain_evaluate_present(pma_subdomain *s, double t);

/* Works are summed up from here, under load (n) and lam (p); M is the mass matrix; what restoring
 * functions gave here (2 n), or NULL where it is not known. Allocates. To be begun again after a
 * start or after time levels were written. */
pma_status pma_subdomain_begin_energy(pma_subdomain *s, pma_matrix M, pma_matrix skew,
                                      const double *load, const double *lam,
                                      const double *functions);
/* NULL where no works are summed up. */
pma_energy *pma_subdomain_energy(const pma_subdomain *s);
/* The works of `from` go on in s, whose present is the same for other steps; nothing if there are
 * none. Allocates. */
pma_status pma_subdomain_follow_energy(pma_subdomain *s, const pma_subdomain *from);
/* What its restoring functions gave at the present, after this number of macro steps: forces, and
 * loads that these contain (2 n). NULL where there are none, or it is not known: writing the state
 * takes it away, after which it may be set. */
const double *pma_subdomain_functions(const pma_subdomain *s, int64_t steps);
void pma_subdomain_set_functions(pma_subdomain *s, int64_t steps, const double *functions);
void pma_subdomain_end_energy(pma_subdomain *s); /* NULL and one without energy are allowed */

#endif
