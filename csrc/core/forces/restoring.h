/* restoring.h - a further restoring force r(t, u, v) of a subdomain, beyond K u + C v. */
#ifndef PMA_RESTORING_H
#define PMA_RESTORING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "state.h"
#include "status.h"

/* r (n) := r(t, u, v), in the user's order of dofs; r arrives zeroed. Other than 0: stop the run.
 * u and v are copies: what the function writes into them is lost. */
typedef int (*pma_restoring_function)(double t, intptr_t n, double *u, double *v, double *r,
                                      void *user);

/* What functions share with the subdomain that evaluates them. */
typedef struct {
    double *memory; /* what they remember, set for each evaluation */
    /* May compensator i give the command u, v (width each) of these dofs of the user (NULL: of all
     * in turn)? NULL: any. One that may not makes its function return at once. */
    bool (*allows)(void *self, size_t i, const int64_t *dofs, size_t width, const double *u,
                   const double *v);
    void *self;
    bool refused; /* has the last evaluation ended so? */
    double *a;    /* n, in the user's order: see pma_restoring_accelerate; NULL: not needed */
    double ahead;
} pma_cell;

/* Where a specimen behind filters has what was last in an evaluation, `width` numbers each, in what
 * functions remember: the command of the structure, that which the simulated rig was sent, what was
 * measured, and the force. */
typedef struct {
    size_t width, command, sent, measured, force;
} pma_trace;

/* The arrays are the caller's and have to outlive it. */
typedef struct {
    pma_restoring_function function; /* NULL: there is no such force */
    void *user;
    bool by_caller; /* to be called by the thread that called advance */
    size_t n;
    const int64_t *order; /* n: the user's dof of each of ours */
    double *work;         /* 3 n: scratch */
    const double *load;   /* n, in the user's order: an external load f(t, u, v) that the last r
                             contains as - f, for its work; or NULL */
    size_t memory;        /* numbers that the function remembers from one evaluation to the next */
    size_t tables;        /* of counts among these numbers */
    const pma_state_counts *counts; /* tables */
    size_t compensators;            /* of commands, among the functions */
    pma_cell *cell;                 /* NULL without memory and compensators */
    size_t traces;                  /* specimens behind filters among the functions */
    const pma_trace *trace;         /* traces */
} pma_restoring;

/* PMA_BAD_INDEX unless every dof lies in 0..n-1 */
pma_status pma_restoring_check(const pma_restoring *restoring);

/* w (n, in elimination order; NULL: not known) is the acceleration `ahead` steps before the end of
 * the substep whose force is evaluated next. */
void pma_restoring_accelerate(const pma_restoring *restoring, const double *w, double ahead);

/* y (n) -= r(t, u, v), all in elimination order; `to` (memory) is what the function remembers
 * after it, `from` before it, which may be the same. PMA_RESTORING_FAILED when the function returns
 * other than 0, which goes to *code, PMA_LIMITED when it gives no command since `cell` refuses it;
 * y is then as it was. Does not allocate. */
pma_status pma_restoring_subtract(const pma_restoring *restoring, double t, const double *u,
                                  const double *v, const double *from, double *to, double *y,
                                  int *code);

/* What the last call has returned at position i, without an external load that it contains. */
double pma_restoring_force(const pma_restoring *restoring, size_t i);

/* r (n) of the last call, in the user's order. */
const double *pma_restoring_last(const pma_restoring *restoring);

#endif
