/* specimen.h - a restoring force behind actuators and compensators of their delays.
 *
 * A command passes the filters, the outermost first, and what comes out moves the specimen: springs
 * and a function. The displacement measured there is what compensators adapt to. All that a
 * specimen remembers is in `memory`, zeros for one that was never evaluated; n values of each dof,
 * in the user's order, each on its own. */
#ifndef PMA_SPECIMEN_H
#define PMA_SPECIMEN_H

#include <stddef.h>
#include <stdint.h>

#include "member/restoring.h"
#include "member/springs.h"
#include "status.h"

enum { PMA_ACTUATOR_ORDER = 3, PMA_ADAPTIVE_TERMS = 3 };

/* A weighted sum of commands (Y1), within limits, and linear dynamics (Y2) with noise (Y3). */
typedef struct {
    size_t taps, length;          /* `length` exceeds all lags */
    const int64_t *lag;           /* taps: in steps */
    const double *weight;         /* taps */
    double largest;               /* of the sum, infinite for none */
    size_t order;                 /* 0: x is the sum itself */
    const double *phi;            /* order x order by rows */
    const double *before, *after; /* order */
    const double *slope;          /* order + 1: of state and sum makes the velocity */
    double noise, quantum;        /* 0 for none */
    uint64_t seed;
} pma_actuator;

/* The compensation that adapts its coefficients while it runs                         (Y6), (Y7) */
typedef struct {
    double h, start[PMA_ADAPTIVE_TERMS], least[PMA_ADAPTIVE_TERMS], most[PMA_ADAPTIVE_TERMS];
    double change[PMA_ADAPTIVE_TERMS]; /* largest, in an adaptation */
    double threshold;                  /* share of the largest displacement, to adapt at all */
    size_t every, window;              /* steps between samples; samples */
    size_t sections;                   /* of the low-pass filter */
    const double *section;             /* sections x 5: b0, b1, b2, a1, a2 */
} pma_adaptive;

/* One of the two: `adaptive` unless it is NULL. */
typedef struct {
    pma_actuator actuator;
    const pma_adaptive *adaptive;
} pma_filter;

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    size_t n, count, compensators; /* filters that are compensators, before all others */
    const pma_filter *filters;     /* count */
    pma_cell *cell; /* decides what they may give, as compensator `number`; or NULL */
    size_t number;
    pma_springs springs;
    pma_restoring_function function; /* or NULL; may write the measured displacement into u */
    void *user;
    double *work; /* n: scratch */
} pma_specimen;

/* The numbers it remembers: the measured displacement (n), the filters in turn, the springs. */
size_t pma_specimen_numbers(const pma_specimen *s);

/* r (n) += r(u, v, t); u and v (n) are used up, u is what was measured. Returns what the function
 * returns, or 1 when `cell` refuses what compensators make of the command. Once a step, in the
 * order of time. Does not allocate. */
int pma_specimen_evaluate(const pma_specimen *s, double t, double *u, double *v, double *r,
                          double *memory);

#endif
