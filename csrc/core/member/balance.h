/* balance.h - the energy that a scheme adds to a subdomain through forces that it evaluates.
 *
 * Between two time levels the forces r do the work  (r0 + r1) . (ut1 - ut0) / 2  along the path of
 * their evaluations, springs that of (H5); what the velocities see of it is
 * h (r0 + r1) . (v0 + v1) / 4  with the forces as they act. The difference is what the scheme adds,
 * whatever the forces are: one that feeds in energy does so in both.               (B8) to (B10) */
#ifndef PMA_BALANCE_H
#define PMA_BALANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "member/springs.h"
#include "member/state.h"
#include "status.h"

/* Matrices in elimination order, arrays of the caller. */
typedef struct {
    size_t n;
    size_t lanes;               /* number i is that of lane i % lanes; otherwise 1 */
    size_t substeps;            /* of a macro step */
    bool has_responses;         /* forces are evaluated in free macro runs, */
    bool jumps;                 /* ... functions among them, */
    bool corrects;              /* ... and K_r acts on u, not on the predictor */
    double h;                   /* between two time levels */
    pma_matrix M;               /* for the kinetic energy */
    pma_matrix K_r, D_r;        /* as in (R2) and (M3); zero where they do not act */
    const pma_springs *springs; /* among the forces */
    bool looks;                 /* for contact that closes; one lane */
    bool functions;             /* of the motion are evaluated, which may alternate; one lane */
    const int64_t *ptr;         /* n + 1: the stiffness of functions that are iterated, by rows; */
    const int32_t *index;       /* ... NULL: there are none. One lane */
} pma_balance_parts;

typedef struct pma_balance pma_balance;

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out);
void pma_balance_destroy(pma_balance *b); /* NULL is allowed */
const pma_balance_parts *pma_balance_get_parts(const pma_balance *b);

/* From the present on, with the velocity v (n). */
void pma_balance_begin(pma_balance *b, const double *v);

/* Of the substep with this number, when it is opened: keeps the predictor ut (n); -> r (n), zeroed,
 * for the forces evaluated there. Two of them can be open. */
double *pma_balance_open(pma_balance *b, int64_t number, const double *ut);

/* Functions that are iterated, before the substep is closed: their force (n) at its end u (n), and
 * their stiffness there, or NULL where it is not known. Their work is that along a path on which
 * the stiffness changes once. */
void pma_balance_bend(pma_balance *b, const pma_substep *step, const double *u, const double *f,
                      const double *K);

/* The substep is closed: its velocity v and acceleration w (n), and what its springs remember;
 * u - ut = al1 w. Begins again from the present with the first one. */
void pma_balance_close(pma_balance *b, const pma_substep *step, double al1, const double *v,
                       const double *w, const double *springs);

/* Where forces are evaluated in a free macro run, after all of its substeps are closed: the link
 * response at time level j, one after the other; its predictor is u - al1 w. */
void pma_balance_advance_response(pma_balance *b, size_t j, double al1, const pma_state *link);

/* The last time level becomes the present. It is judged, or where forces are evaluated in a free
 * macro run the first one, which is nearest to the motion. */
void pma_balance_commit(pma_balance *b);

/* The contact that was seen to close, the first one or a much stiffer one: du . dr / du . M du, the
 * share of K_r in du . dr, and
 * the time; 0 before there is one. */
typedef struct {
    double square, share, t;
} pma_impact;
pma_impact pma_balance_impact(const pma_balance *b);

/* When forces were first seen to alternate with the velocity from step to step, as those of a
 * dashpot do that is too steep for the step; 0 before they are.                           (B13) */
double pma_balance_alternates(const pma_balance *b);

/* The energy that the scheme has added, in multiples of the largest one of the motion without it
 * (kinetic, and what the forces took up), kept over some macro steps: the largest so far, of all
 * lanes, and whether it is out of bounds. */
double pma_balance_gain(const pma_balance *b);
bool pma_balance_is_broken(const pma_balance *b);

#endif
