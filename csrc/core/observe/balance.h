/* balance.h - the energy that evaluated and iterated forces give to the motion of a subdomain
 * beyond what they have taken from it.
 *
 * What acts, r_a, does the work  (r_a0 + r_a1) . (u1 - u0) / 2  in a substep. Forces of springs and
 * of specimens hold no more than they were given; what they give beyond that comes from steps that
 * do not resolve them, a delay, or a wrong sign.                                   (B8) to (B10) */
#ifndef PMA_BALANCE_H
#define PMA_BALANCE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "forces/springs.h"
#include "observe/stiffness.h"
#include "state.h"
#include "status.h"

/* Matrices in elimination order, arrays of the caller. */
typedef struct {
    size_t n;
    size_t lanes;       /* number i is that of lane i % lanes; otherwise 1 */
    size_t substeps;    /* of a macro step */
    bool has_responses; /* forces are evaluated in free macro runs, */
    bool corrects;      /* ... and K_r acts on u, not on the predictor */
    bool is_passive;    /* functions are evaluated once a step: their path is not known */
    bool estimates;     /* ... and K_r is one of theirs, in an implicit scheme */
    bool is_pushed;     /* w is without what the interface does: mean coupling */
    bool doubled;       /* double steps: from the time level before the last one */
    bool is_explicit;   /* K is evaluated at the predictor */
    bool has_functions; /* what is evaluated once is not r alone, */
    bool has_rates;     /* ... and is evaluated at the velocity vs */
    pma_step_limits single, twice; /* of both operators */
    pma_matrix M, K;               /* for the kinetic and the strain energy */
    pma_matrix K_r, D_r;           /* as in (R2) and (M3); zero where they do not act */
    const pma_springs *springs;    /* among the forces */
    bool iterates;         /* some of them are evaluated at the state, not at the predictor, */
    bool iterates_springs; /* ... springs among them */
    const int64_t *ptr;    /* n + 1: the stiffness of functions that are iterated, by rows; */
    const int32_t *index;  /* ... NULL: there are none. One lane */
} pma_balance_parts;

typedef struct pma_balance pma_balance;

pma_status pma_balance_create(const pma_balance_parts *parts, pma_balance **out);
void pma_balance_destroy(pma_balance *b); /* NULL is allowed */
const pma_balance_parts *pma_balance_get_parts(const pma_balance *b);

/* From the present on, whose forces are not known: from the end of the first substep. */
void pma_balance_begin(pma_balance *b);

/* What functions give at the next start, once a step or iterated (n each), and the stiffness of the
 * latter (as parts.ptr says). */
typedef struct {
    double *once, *iterated, *stiffness;
} pma_first_forces;
pma_first_forces *pma_balance_first(pma_balance *b);

/* After `begin`: from the start x on, with these forces and those of springs. */
void pma_balance_start(pma_balance *b, const pma_state *x);

/* To be filled when a substep is opened, n each. r: the forces evaluated there or, of iterated
 * ones, at the state. With parts.has_functions, otherwise NULL: total, what was evaluated once,
 * with loads that depend on the motion; vs, with parts.has_rates, the velocity at which it was. */
typedef struct {
    double *r, *total, *vs;
} pma_evaluated_forces;

/* Of the substep with this number, when it is opened: keeps the predictor ut (n). Two can be
 * open. */
pma_evaluated_forces pma_balance_open(pma_balance *b, int64_t number, const double *ut);

/* Before the substep is closed: those of its forces (n) that are evaluated at its end. */
void pma_balance_iterate(pma_balance *b, const pma_substep *step, const double *r);

/* Functions that are iterated, before the substep is closed: their force (n) at its end u (n), and
 * their stiffness there, or NULL where it is not known. Their work is that along a path on which
 * the stiffness changes once; where it is not known, that of the trapezoidal rule. */
void pma_balance_bend(pma_balance *b, const pma_substep *step, const double *u, const double *f,
                      const double *K);

/* The substep is closed: the state x at its end. Begins again from the present with the first one:
 * a double step from a time level before whose forces are not known goes on from the last one. */
void pma_balance_close(pma_balance *b, const pma_substep *step, const pma_state *x);

/* Where forces are evaluated in a free macro run, after all of its substeps are closed: the link
 * response at time level j, one after the other; its predictor is u - al1 w. */
void pma_balance_advance_response(pma_balance *b, size_t j, bool twice, const pma_state *link);

/* The last time level becomes the present, with state x, and is judged. */
void pma_balance_commit(pma_balance *b, const pma_state *x);

/* The largest energy that was added to the motion, and that it had; when the ratio first exceeded
 * 0.1; of the lane in which it is largest. Zeros where it does not now.                    (B10) */
typedef struct {
    double added, energy, t;
} pma_gain;
pma_gain pma_balance_gain(const pma_balance *b);

/* Since t the forces that are evaluated once have been stiffer than the step h allows, at macro
 * time levels in turn at which the motion was faster than ever and grew; t = 0: they have not.
 *                                                                                         (B15) */
typedef struct {
    pma_excess excess;
    double h, t;
} pma_stiff;
pma_stiff pma_balance_stiff(const pma_balance *b);

/* As how much of the mass an estimate K_r has acted that is above the stiffness of the forces, in
 * the motion up to the present; 0 unless parts.estimates.                                  (B13) */
double pma_balance_added_mass(const pma_balance *b);

/* Whether the motion is beyond 1e100 of its beginning: there it is no motion any more. */
bool pma_balance_is_broken(const pma_balance *b);

#endif
