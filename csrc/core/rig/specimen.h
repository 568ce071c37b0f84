/* specimen.h - a restoring force behind actuators and compensators of their delays.
 *
 * A command passes the filters, the outermost first, and what comes out moves the specimen: springs
 * and a function, or a linear system. The displacement measured there, and the forces, pass the
 * filters on their way back. All that a specimen remembers is in `memory`, zeros for one that was
 * never evaluated; arrays of dofs are in the user's order. */
#ifndef PMA_SPECIMEN_H
#define PMA_SPECIMEN_H

#include <stddef.h>
#include <stdint.h>

#include "forces/restoring.h"
#include "forces/springs.h"
#include "rig/filter.h"
#include "rig/linear.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    size_t n;            /* dofs of the subdomain */
    size_t width;        /* commands */
    const int64_t *dofs; /* width: of the commands; NULL: all in turn, width = n */
    size_t count;
    const pma_filter *filters; /* count */
    size_t compensators;       /* filters up to the last compensator of these, 0 without one */
    size_t leading;            /* filters before the first that simulates a part of the rig */
    double h;                  /* of a step; 0: no filter needs accelerations */
    pma_cell *cell; /* decides what compensators may give, as compensator `number`; or NULL */
    size_t number;
    const pma_linear *linear; /* or NULL: springs and function */
    pma_springs springs;
    pma_restoring_function function; /* or NULL; may write the measured displacement into u */
    void *user;
    double *work; /* 5 width: scratch */
} pma_specimen;

/* A command, n each; v and a may be NULL for zeros. */
typedef struct {
    const double *u, *v;
    const double *a; /* `ahead` steps before the command, which has it extrapolated         (Y18) */
    double ahead;
} pma_wanted;

/* The numbers it remembers: the measured displacement (width), the filters in turn, the springs or
 * the linear system, the rest of the trace, the last acceleration. */
size_t pma_specimen_numbers(const pma_specimen *s);
size_t pma_specimen_tables(const pma_specimen *s); /* of counts among these numbers; and these */
void pma_specimen_counts(const pma_specimen *s, pma_state_counts *out);
pma_trace pma_specimen_trace(const pma_specimen *s);

/* r (n) += its forces. Returns what the function returns, or 1 when `cell` refuses what
 * compensators make of the command. Once a step, in the order of time. Does not allocate. */
int pma_specimen_evaluate(const pma_specimen *s, double t, const pma_wanted *wanted, double *r,
                          double *memory);

#endif
