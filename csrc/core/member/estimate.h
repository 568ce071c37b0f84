/* estimate.h - local errors of recorded steps (D1), and the motion of a small system (D3). */
#ifndef PMA_ESTIMATE_H
#define PMA_ESTIMATE_H

#include <stddef.h>
#include <stdint.h>

/* Recorded motion of a subdomain, a row for each time level. Arrays of the caller. */
typedef struct {
    size_t columns;
    const double *u, *v, *w; /* levels x columns by rows */
} pma_motion_rows;

/* Some of its steps: step s goes from level begin[s] to level end[s], each of them h long. */
typedef struct {
    size_t count;
    const int64_t *begin, *end; /* count */
    double h;
} pma_recorded_steps;

/* e of column k and step s to e[k * count + s] */
void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, double *e);

/* x_k := x_k + P x_{k-1} for k = 1..rows-1; P (n x n), x (rows x n) by rows */
void pma_estimate_follow(size_t n, size_t rows, const double *P, double *x);

#endif
