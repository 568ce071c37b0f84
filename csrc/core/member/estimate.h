/* estimate.h - local errors of recorded steps (D1), and norms of them and of the motion.
 *
 * The check of the step sizes after a run, equation (D3) of docs/method.md, needs no more. */
#ifndef PMA_ESTIMATE_H
#define PMA_ESTIMATE_H

#include <stddef.h>
#include <stdint.h>

/* Recorded motion of a subdomain, a row for each time level. Arrays of the caller. */
typedef struct {
    size_t columns, stride;  /* numbers of a row; 0, stride, 2 stride... of them are read */
    const double *u, *v, *w; /* levels x columns by rows */
} pma_motion_rows;

/* Some of its steps: step s goes from level begin[s] to level end[s], each of them h long. */
typedef struct {
    size_t count;
    const int64_t *begin, *end; /* count */
    double h;
} pma_recorded_steps;

/* Over some steps: the mean of |e| per unit of time, and root mean squares of the distance of u from
 * its mean, of v, and of w, where the steps begin; |x|^2 = sum of mass_k x_k^2. */
typedef struct {
    double rate, motion, speed, acceleration;
} pma_norms;

/* The columns that are read. */
size_t pma_motion_read(const pma_motion_rows *x);

/* e of column k that is read and step s to e[k * ld + s] */
void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, size_t ld,
                         double *e);

/* Writes the mean of u into mean (columns read), too. mass (columns read) */
pma_norms pma_estimate_norms(const pma_motion_rows *x, const pma_recorded_steps *steps,
                             const double *mass, double *mean);

/* |u - mean| at some levels; mass, mean (columns read), levels, distance (count) */
void pma_estimate_distance(const pma_motion_rows *x, size_t count, const int64_t *levels,
                           const double *mass, const double *mean, double *distance);

#endif
