/* actuator.h - the filter of a simulated actuator, or of a compensator with constant weights. */
#ifndef PMA_ACTUATOR_H
#define PMA_ACTUATOR_H

#include <stdint.h>

#include "rig/filter.h"
#include "rig/signals.h"

enum { PMA_ACTUATOR_ORDER = 3 };

/* A weighted sum of commands (Y1), within limits, and linear dynamics (Y2) with noise (Y3), of each
 * dof on its own. */
typedef struct {
    pma_delay delay;
    double largest;               /* of the sum, infinite for none */
    size_t order;                 /* 0: x is the sum itself */
    const double *phi;            /* order x order by rows */
    const double *before, *after; /* order */
    const double *slope;          /* order + 1: of state and sum makes the velocity */
    double noise, quantum;        /* 0 for none */
    uint64_t seed;
} pma_actuator;

extern const pma_filter_kind pma_actuator_kind;

#endif
