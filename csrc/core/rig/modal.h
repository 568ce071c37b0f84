/* modal.h - a linear filter of several inputs and outputs, in modal form.
 *
 *     y = C z + D u,   z := A z + B u
 *
 * A has the poles in pairs: a state depends on itself and on the other one of its pair. */
#ifndef PMA_MODAL_H
#define PMA_MODAL_H

#include <stddef.h>

/* Arrays of the caller, matrices by rows. The state (states) is the caller's too. */
typedef struct {
    size_t inputs, states, outputs; /* an even number of states */
    const double *A;                /* states x 2: of itself, of the other one */
    const double *B;                /* states x inputs */
    const double *C;                /* outputs x states */
    const double *D;                /* outputs x inputs */
    const double *rest;             /* states x inputs: under a constant input */
} pma_modal;

/* z (states) := its state under the constant input u (inputs) */
void pma_modal_rest(const pma_modal *f, const double *u, double *z);

/* y (outputs) of the input u (inputs), two arrays, and the state after it */
void pma_modal_filter(const pma_modal *f, const double *u, double *z, double *y);

#endif
