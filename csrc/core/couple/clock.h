/* clock.h - time counted in integers: where a subdomain is at a fine step, and its substeps.
 *
 * Everything follows from the number k of a fine step, counted from the present, and the number of
 * the macro step in which that began, counted from the start or the last change of the steps. */
#ifndef PMA_CLOCK_H
#define PMA_CLOCK_H

#include <assert.h>
#include <stddef.h>
#include <stdint.h>

#include "subdomain/member.h"

/* A subdomain at the end of a fine step: `phase` of `ratio` fine steps inside the substep from time
 * level j to j + 1, phase = 1..ratio. */
typedef struct {
    size_t j, phase;
} pma_moment;

/* Macro steps of one length: `number` macro steps were done when they began, at time t. */
typedef struct {
    int64_t number;
    double t;
} pma_origin;

/* (T1)  t = t0 + (j / levels) dt for time level j of `levels` in a macro step, counted from where
 * macro steps of this length began and in this order of operations: equal times are bitwise
 * identical, whatever `levels` is. Signed numbers become doubles in one instruction. */
static inline double pma_clock_time(double t0, double dt, int64_t macro, size_t j, size_t levels)
{
    const double parts = (double)(int64_t)levels;
    const double count = (double)macro * parts + (double)(int64_t)j;
    return t0 + (levels == 1 ? count : count / parts) * dt;
}

/* (P3)  The end of the first stage of a scheme of two is gamma = 2 - sqrt 2 of both of them: an odd
 * time level is this much later than if they were equal, 2 gamma - 1 of their mean length. */
#define PMA_STAGE_LATER 0.17157287525380990

static inline double pma_clock_later(size_t j, bool staged)
{
    return staged && j % 2 == 1 ? PMA_STAGE_LATER : 0.0;
}

/* (T1) where levels are those of two stages in turn; bitwise as above where they are not. */
static inline double pma_clock_stage_time(double t0, double dt, int64_t macro, size_t j,
                                          size_t levels, bool staged)
{
    if (!staged || j % 2 == 0)
        return pma_clock_time(t0, dt, macro, j, levels);
    const double parts = (double)(int64_t)levels;
    const double count = (double)macro * parts + (double)(int64_t)j;
    return t0 + (count + PMA_STAGE_LATER) / parts * dt;
}

/* theta of (15): where the end of fine step `phase` of `ratio` is in a substep */
static inline double pma_clock_fraction(size_t phase, size_t ratio, bool staged)
{
    return ((double)(int64_t)phase + pma_clock_later(phase, staged)) / (double)(int64_t)ratio;
}

/* The length of the step to time level j, in the mean length. */
static inline double pma_clock_length(size_t j, bool staged)
{
    return 1.0 + pma_clock_later(j, staged) - pma_clock_later(j - 1, staged);
}

/* (15)  j = floor((k - 1) / ratio), theta = phase / ratio, for k >= 1 */
static inline pma_moment pma_clock_moment(size_t k, size_t ratio)
{
    assert(k >= 1 && ratio >= 1);
    /* k <= 2 PMA_MOST_SUBSTEPS = 2^32, and 32 bits are divided faster than 64 */
    const size_t j = ratio == 1 ? k - 1 : (uint32_t)(k - 1) / (uint32_t)ratio;
    return (pma_moment){.j = j, .phase = k - j * ratio};
}

/* The number of the first substep that is a double step: none is, unless the subdomain is
 * doubled; all are where it continues from an earlier time level; else those from the second macro
 * step on, since double steps are not self-starting. */
static inline int64_t pma_clock_first_double(pma_doubling doubling, size_t substeps)
{
    if (doubling == PMA_SINGLE)
        return INT64_MAX;
    return doubling == PMA_CONTINUED ? 0 : (int64_t)substeps;
}

/* The substep from time level j of a subdomain whose substeps are double from `first_double` on.
 * Field by field: a compound literal would be made on the stack and copied from there in pieces
 * larger than those in which it was just written, which has to wait for the cache. */
static inline pma_substep pma_clock_substep(double t0, double dt, int64_t macro, size_t substeps,
                                            size_t j, int64_t first_double, bool staged)
{
    pma_substep step;
    step.j = j;
    step.number = macro * (int64_t)substeps + (int64_t)j;
    step.t1 = pma_clock_stage_time(t0, dt, macro, j + 1, substeps, staged);
    step.twice = step.number >= first_double;
    step.is_free_run = false;
    return step;
}

#endif
