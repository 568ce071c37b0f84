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

/* PMA_BAD_INDEX unless every row index lies in 0..p-1. */
pma_status pma_link_check(const pma_link *L);

/* What follows in lanes. */
void pma_link_load_each(const pma_link *L, const double *lam, double *xb);
void pma_link_add_each(const pma_link *L, const double *lam, double *xb);
void pma_link_gather_each(const pma_link *L, double scale, const double *xb, double *jump);

/* sum + column j of L_b times lam */
static inline double pma_link_column(const pma_link *L, size_t j, const double *lam, double sum)
{
    for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++)
        sum += L->values[k] * lam[L->index[k]];
    return sum;
}

/* xb (nb) := L_b^T lam, lam (p) */
static inline void pma_link_load(const pma_link *L, const double *lam, double *xb)
{
    if (L->each) {
        pma_link_load_each(L, lam, xb);
        return;
    }
    for (size_t j = 0; j < L->nb; j++)
        xb[j] = pma_link_column(L, j, lam, 0.0);
}

/* xb (nb) += L_b^T lam, lam (p) */
static inline void pma_link_add(const pma_link *L, const double *lam, double *xb)
{
    if (L->each) {
        pma_link_add_each(L, lam, xb);
        return;
    }
    for (size_t j = 0; j < L->nb; j++)
        xb[j] = pma_link_column(L, j, lam, xb[j]);
}

/* jump (p) += scale L_b xb, xb (nb) */
static inline void pma_link_gather(const pma_link *L, double scale, const double *xb, double *jump)
{
    if (L->each) {
        pma_link_gather_each(L, scale, xb, jump);
        return;
    }
    for (size_t j = 0; j < L->nb; j++) {
        const double x = scale * xb[j];
        for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++)
            jump[L->index[k]] += L->values[k] * x;
    }
}

#endif
