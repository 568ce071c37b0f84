/* signals.h - what filters make of signals: late, with noise, through a linear system. */
#ifndef PMA_SIGNALS_H
#define PMA_SIGNALS_H

#include <stddef.h>
#include <stdint.h>

/* ---- late: a weighted sum of the last ones (Y1) --------------------------------------------- */

/* Arrays of the caller. What is remembered is a ring of `length` numbers. */
typedef struct {
    size_t taps, length;  /* `length` exceeds all lags */
    const int64_t *lag;   /* taps: in steps */
    const double *weight; /* taps */
} pma_delay;

/* sum_i w_i d(k - l_i); the last signal, d(k), is at `now` of the ring                      (Y1) */
double pma_delay_sum(const pma_delay *delay, const double *ring, size_t now);

/* ---- random numbers that follow from a seed and a counter alone ----------------------------- */

/* Number `number` of a normal distribution of mean 0 and deviation 1                        (Y3) */
double pma_noise_normal(uint64_t seed, uint64_t number);

/* ---- a linear filter in modal form ---------------------------------------------------------- */

/* y = C z + D u, z := A z + B u; A has the poles in pairs: a state depends on itself and on the
 * other one of its pair. Arrays of the caller, matrices by rows, and the state (states) too. */
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
