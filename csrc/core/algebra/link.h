/* link.h - L_b, the columns of a subdomain's constraint matrix that are not zero.
 *
 * L_b is p x nb, stored by columns: one column for each interface dof. */
#ifndef PMA_LINK_H
#define PMA_LINK_H

#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* Arrays of the caller, which have to outlive it. */
typedef struct pma_link {
    size_t p, nb;
    const int64_t *ptr;          /* nb+1 starts of the columns */
    const int32_t *index;        /* row (constraint) of each entry */
    const double *values;        /* +1 and -1 for a tie */
    const struct pma_link *each; /* in lanes: the link of each, and p and nb are those of all */
} pma_link;

/* The link that does the same in every lane (lanes.h), of PMA_LANES times its size; `each` has to
 * outlive it. */
pma_link pma_link_in_lanes(const pma_link *each);

/* PMA_BAD_INDEX unless every row index lies in 0..p-1. */
pma_status pma_link_check(const pma_link *L);

/* xb (nb) := L_b^T lam, lam (p) */
void pma_link_load(const pma_link *L, const double *lam, double *xb);

/* xb (nb) += L_b^T lam, lam (p) */
void pma_link_add(const pma_link *L, const double *lam, double *xb);

/* jump (p) += scale L_b xb, xb (nb) */
void pma_link_gather(const pma_link *L, double scale, const double *xb, double *jump);

#endif
