/* inverse.h - the filter of a compensator that inverts a model of the transfer system. */
#ifndef PMA_INVERSE_H
#define PMA_INVERSE_H

#include "rig/filter.h"
#include "rig/signals.h"

/* Arrays of the caller. Outputs of `command` and `regressors`: those of the model (width), then
 * those of each variation (width). */
typedef struct {
    double h, rate, acceleration; /* l1 and l2, factors of d' and d'' */
    pma_modal command;            /* (Y14) */
    pma_modal feedback;           /* (Y15); without states: none */
    size_t variations;            /* 0: nothing adapts */
    pma_modal regressors, low;    /* of what was measured, and of the command           (Y16) */
    double variance;              /* sigma^2 */
    double largest;               /* of each coefficient of a variation */
    double *work;                 /* width (3 + variations) + variations: scratch */
} pma_inverse;

extern const pma_filter_kind pma_inverse_kind;

#endif
