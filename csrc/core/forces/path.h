/* path.h - a point that runs with constant speed along segments, such as the beams of a bridge.
 *
 * Its displacement is that of the dofs of the segment under it times their shape functions, which
 * are cubic polynomials of xi, from 0 to 1 along the segment. A force there acts on these dofs by
 * the same numbers. Off the path there is neither. */
#ifndef PMA_PATH_H
#define PMA_PATH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

enum { PMA_SHAPE = 4 }; /* coefficients of 1, xi, xi^2, xi^3 */

/* Arrays of the caller, which have to outlive it. */
typedef struct {
    size_t segments, width; /* width: dofs of a segment */
    const double *ends;     /* segments + 1: the distances at which they begin and end, rising */
    const int64_t *dofs;    /* segments x width, -1: none */
    const double *shape;    /* segments x width x PMA_SHAPE */
    double start, speed;    /* at t = 0 it is at the distance `start` */
} pma_path;

/* Where the point is. */
typedef struct {
    bool is_on;
    size_t segment;
    double xi;
} pma_place;

/* PMA_BAD_INDEX unless all dofs are in -1..n-1, PMA_BAD_SIZE unless the distances rise. */
pma_status pma_path_check(const pma_path *path, size_t n);

/* At t; both ends belong to the path, up to the rounding of the distance. */
pma_place pma_path_at(const pma_path *path, double t);

/* N(s) u, and its rate N(s) v + s' N'(s) u; zero off the path. v may be NULL at rest. */
double pma_path_value(const pma_path *path, const pma_place *place, const double *u);
double pma_path_rate(const pma_path *path, const pma_place *place, const double *u,
                     const double *v);

/* y += N(s)^T f for the dofs begin..end-1 */
void pma_path_add(const pma_path *path, const pma_place *place, double f, size_t begin, size_t end,
                  double *y);

#endif
