/* wheels.h - springs with ends that run along paths, such as those of vehicles on a bridge.
 *
 * Each end of a spring is a dof, the ground or a point of a path. While one of its points is off
 * its path the spring has no force, and what it remembers stays. Dofs are in the user's order. */
#ifndef PMA_WHEELS_H
#define PMA_WHEELS_H

#include <stddef.h>
#include <stdint.h>

#include "forces/path.h"
#include "forces/restoring.h"
#include "forces/springs.h"
#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    pma_springs springs;   /* spring i is between ends 2 i and 2 i + 1 */
    const int64_t *dofs;   /* 2 for each spring: -1 for the ground and for points */
    const int64_t *points; /* 2 for each spring: the path, or -1 */
    size_t count;          /* paths */
    const pma_path *paths;
    pma_place *places; /* one for each path: scratch */
    double *work;      /* 3 for each end: scratch */
} pma_wheels;

/* PMA_BAD_INDEX unless dofs, paths and ends are there, PMA_BAD_SIZE as of springs. */
pma_status pma_wheels_check(const pma_wheels *wheels, size_t n);

/* r (n) += r(t, u, v); `memory` is what the springs remember before it, then after it. */
void pma_wheels_add(const pma_wheels *wheels, double t, const double *u, const double *v, double *r,
                    double *memory);

#endif
