/* interface.h - the interface problem H Lam = b (18), as the coupler sees it.
 *
 * H = sum_i al2_i L_i Mbar_i^-1 L_i^T is the dual Schur complement, a discrete Steklov-Poincare
 * operator. A coupler knows it by a table of operations, so that there can be other factors behind
 * it: pma_ldl is the one of this core. */
#ifndef PMA_INTERFACE_H
#define PMA_INTERFACE_H

#include <stddef.h>

#include "algebra/factor.h"
#include "algebra/lu.h"
#include "status.h"

typedef struct {
    /* x (p) := H^-1 x. Called by one thread at a time; does not allocate. */
    void (*solve)(void *self, double *x);
} pma_interface_table;

typedef struct {
    const pma_interface_table *table;
    void *self;
    size_t p;       /* constraints */
    size_t entries; /* matrix entries read by one solve */
} pma_interface;

/* ---- H = R D R^T, whatever form R has ------------------------------------------------------- */

typedef struct {
    pma_factor factor; /* all p unknowns are on the interface: nb = n = p */
    double *work;      /* scratch of the sweeps */
} pma_ldl;

/* Checks the factor, whose arrays are the caller's, and allocates scratch. PMA_BAD_SIZE unless
 * nb = n, and what pma_factor_check finds; *out is then empty. */
pma_status pma_ldl_create(const pma_factor *H, pma_ldl *out);
void pma_ldl_destroy(pma_ldl *ldl); /* an empty one is allowed */

/* What a coupler is given; ldl has to outlive it. */
pma_interface pma_ldl_interface(pma_ldl *ldl);

/* ---- an unsymmetric matrix, by factors L U: S_mu of (V4) ------------------------------------- */

typedef struct {
    pma_lu factor;
    double *work;
} pma_gap;

/* The same for these factors; entries is that of two triangles. */
pma_status pma_gap_create(const pma_lu *S, pma_gap *out);
void pma_gap_destroy(pma_gap *gap);
pma_interface pma_gap_interface(pma_gap *gap);

#endif
