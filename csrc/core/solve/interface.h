/* interface.h - the interface problem H Lam = b (18), by a finished factor of H.
 *
 * H = sum_i al2_i L_i Mbar_i^-1 L_i^T is the dual Schur complement, a discrete Steklov-Poincare
 * operator. */
#ifndef PMA_INTERFACE_H
#define PMA_INTERFACE_H

#include <stddef.h>

#include "algebra/factor.h"
#include "status.h"

/* A value that can be copied, all copies with one scratch. */
typedef struct {
    pma_factor factor; /* of any form, all p unknowns on the interface: nb = n = p */
    size_t p;          /* constraints */
    size_t entries;    /* matrix entries read by one solution */
    double *work;      /* scratch of the sweeps */
} pma_interface;

/* Checks the factor, whose arrays are the caller's, and allocates scratch. PMA_BAD_SIZE unless
 * nb = n, and what pma_factor_check finds; *out is then empty. */
pma_status pma_interface_create(const pma_factor *H, pma_interface *out);
void pma_interface_destroy(pma_interface *x); /* an empty one is allowed */

/* x (p) := H^-1 x. One thread at a time; does not allocate. */
static inline void pma_interface_solve(const pma_interface *H, double *x)
{
    pma_factor_interface(&H->factor, x, H->work);
}

#endif
