/* motion.h - prescribed velocities: sum_i L_i v_i = g(t) in some rows, 0 in the others.    (G1) */
#ifndef PMA_MOTION_H
#define PMA_MOTION_H

#include <stddef.h>
#include <stdint.h>

#include "member/load.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    const int64_t *rows; /* load.n rows, each in 0..p-1 */
    pma_load load; /* g(t), as a load on these rows, for every interface problem; not called */
} pma_motion;

/* PMA_BAD_SIZE when a motion has more rows than p, PMA_BAD_INDEX unless they are in 0..p-1. */
pma_status pma_motion_check(size_t count, const pma_motion *motions, size_t p);

/* g (p) := g(t) in the rows of all motions, where t is that of interface problem `number` of the
 * run, counted from 0; scratch (p). Other rows stay as they are. */
void pma_motion_prescribe(size_t count, const pma_motion *motions, double t, int64_t number,
                          double *scratch, double *g);

#endif
