/* pull.h - the laws of springs, (H1) to (H4), for each kind of processor. */
#ifndef PMA_PULL_H
#define PMA_PULL_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#include "member/springs.h"

/* The forces f and inner variables inner1 (count each) of the springs begin..begin+count-1 of a set
 * that go from the deformations d0 with inner0 to d. Bitwise the same on all processors. */
typedef void pma_pull(const pma_spring_set *set, size_t begin, size_t count, const double *d0,
                      const double *d, const double *inner0, double *inner1, double *f);

pma_pull *pma_pull_best(void);
pma_pull *pma_pull_plain(void);

/* clang-format off: attributes are long, and a name begins its line */

/* dz/dx on a path on which d moves one way, sign = +-1, and x = |d - d0| / d_y grows      (H4)
 * With `whole` n is 1 or 2. */
__attribute__((always_inline)) static inline double
pma_pull_slope(double z, double sign, double n, double beta, double gamma, bool whole)
{
    const double size = fabs(z), square = size * size;
    const double power = n == 1.0 ? size : whole || n == 2.0 ? square : pow(size, n);
    return sign * (1.0 - power * (gamma + (sign * z < 0.0 ? -beta : beta)));
}

#endif
