/* impulse.h - what impulses on the interface of a subdomain meet: its masses, and its forces.
 * (U4) */
#ifndef PMA_IMPULSE_H
#define PMA_IMPULSE_H

#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* Arrays of the caller, which have to outlive it. Impulses f change velocities by J = M^-1 f, where
 * M is diagonal, and with them the forces of a step: Mbar w_l = -B J with
 * B = C + D_r + h/2 (K + K_r), or where K, C and M are alike w_l = -alpha J - beta Mbar^-1 f. */
typedef struct {
    const double *inverse; /* nb: reciprocals of the masses, 0 of dofs without contact */
    double alpha, beta;
    const int64_t *ptr;   /* nb+1 starts of the columns of B; NULL: by alpha and beta */
    const int32_t *index; /* row of each entry */
    const double *values;
} pma_impulse_parts;

/* PMA_BAD_INDEX unless every row lies in 0..n-1, PMA_BAD_SIZE for masses that are not finite. */
pma_status pma_impulse_check(const pma_impulse_parts *parts, size_t n, size_t nb);

#endif
