/* delay.h - a signal some steps late: a weighted sum of the last ones (Y1). */
#ifndef PMA_DELAY_H
#define PMA_DELAY_H

#include <stddef.h>
#include <stdint.h>

/* Arrays of the caller. What is remembered is a ring of `length` numbers. */
typedef struct {
    size_t taps, length;  /* `length` exceeds all lags */
    const int64_t *lag;   /* taps: in steps */
    const double *weight; /* taps */
} pma_delay;

/* sum_i w_i d(k - l_i); the last signal, d(k), is at `now` of the ring                      (Y1) */
double pma_delay_sum(const pma_delay *delay, const double *ring, size_t now);

#endif
