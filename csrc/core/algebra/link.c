#include "algebra/link.h"

#include <string.h>

#include "algebra/lanes.h"

pma_status pma_link_check(const pma_link *L)
{
    if (L->each)
        return PMA_OK;
    if (L->ptr[0] != 0)
        return PMA_BAD_INDEX;
    for (size_t j = 0; j < L->nb; j++) {
        if (L->ptr[j + 1] < L->ptr[j])
            return PMA_BAD_INDEX;
    }
    for (int64_t k = 0; k < L->ptr[L->nb]; k++) {
        if (L->index[k] < 0 || (size_t)L->index[k] >= L->p)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

void pma_link_load_each(const pma_link *L, const double *lam, double *xb)
{
    memset(xb, 0, L->nb * sizeof *xb);
    pma_lanes_add(L->each, lam, xb);
}

void pma_link_add_each(const pma_link *L, const double *lam, double *xb)
{
    pma_lanes_add(L->each, lam, xb);
}

void pma_link_gather_each(const pma_link *L, double scale, const double *xb, double *jump)
{
    pma_lanes_gather(L->each, scale, xb, jump);
}
