/* internal.h - internal forces f(t, u, v; q) of a subdomain, with their tangents.          (N1)
 *
 * They are functions of the user's, called any number of times in a step until its equilibrium is
 * found; q is the history at the beginning of the step, q1 at its end. Springs that are iterated
 * are evaluated beside them (springs.h). */
#ifndef PMA_INTERNAL_H
#define PMA_INTERNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* f (n) and q1 at t, u, v from the history q; where K is not NULL, the values of df/du and df/dv in
 * the pattern of the function too. In the user's order of dofs; f, K, C arrive zeroed, q1 as q.
 * Other than 0: stop the run. u, v and q are copies. */
typedef int (*pma_internal_function)(double t, intptr_t n, double *u, double *v, double *q,
                                     double *f, double *K, double *C, double *q1, void *user);

/* The energy of a force that is the slope of one, at u (n), a copy. Other than 0: stop the run. */
typedef int (*pma_internal_potential_function)(intptr_t n, double *u, double *energy, void *user);

/* One of them. Arrays of the caller, which have to outlive it. */
typedef struct {
    pma_internal_function function;
    void *user;
    bool by_caller;          /* to be called by the thread that called advance */
    size_t history, entries; /* numbers in q; entries of its pattern */
    const int64_t *where;    /* entries: position of each in the pattern of the tangent */
    const int64_t *across;   /* entries: the one on the other side of the diagonal, or -1 for none;
                                NULL for tangents that need not be symmetric */
    pma_internal_potential_function potential; /* with the same `user`; NULL: none */
} pma_internal_force;

typedef struct {
    size_t n, count, history; /* dofs; functions; numbers in the histories of all of them */
    const pma_internal_force *forces;
    const int64_t *order;  /* n: the user's dof of each of ours */
    const double *initial; /* history: at t = 0 */
} pma_internal;

/* PMA_BAD_INDEX unless all dofs and positions are in range, PMA_BAD_SIZE unless the histories add
 * up. `entries`: of the pattern of the tangent. */
pma_status pma_internal_check(const pma_internal *internal, size_t entries);

/* Doubles of scratch of pma_internal_evaluate. */
size_t pma_internal_scratch(const pma_internal *internal);

/* Where they are evaluated: u and v (n) in elimination order, the histories q. */
typedef struct {
    double t;
    const double *u, *v, *q;
} pma_internal_point;

/* f (n) += f(t, u, v; q), q1 := the histories at the end, which may be q; where `tangent` (of the
 * entries of the pattern) is not NULL, tangent += al1 df/du + al2 df/dv, and where `stiffness` is
 * not NULL either, stiffness += df/du in the same pattern. */
typedef struct {
    double *f, *q1;
    double al1, al2, *tangent, *stiffness;
} pma_internal_values;

/* PMA_INTERNAL_FAILED when a function returns other than 0, which goes to *code, PMA_UNSYMMETRIC
 * for a tangent that should be symmetric. Does not allocate. */
pma_status pma_internal_evaluate(const pma_internal *internal, const pma_internal_point *at,
                                 const pma_internal_values *out, double *scratch, int *code);

/* *energy := the sum of the potentials of those that have one, at u (n). As above. */
pma_status pma_internal_potential(const pma_internal *internal, const double *u, double *energy,
                                  double *scratch, int *code);

/* Has any of them a potential? */
bool pma_internal_has_potential(const pma_internal *internal);

#endif
