#include "algebra/link.h"

#include <string.h>

#include "algebra/loops.h"

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

__attribute__((noinline)) static void load_lanes(const pma_link *L, const double *lam, double *xb)
{
    memset(xb, 0, L->nb * sizeof *xb);
    pma_loops_add(L->each, lam, xb);
}

void pma_link_load(const pma_link *L, const double *lam, double *xb)
{
    if (L->each) {
        load_lanes(L, lam, xb);
        return;
    }
    const pma_link l = *L; /* or it would be read again after each number that is stored */
    int64_t k = 0;
    for (size_t j = 0; j < l.nb; j++) {
        double sum = 0.0;
        for (; k < l.ptr[j + 1]; k++)
            sum += l.values[k] * lam[l.index[k]];
        xb[j] = sum;
    }
}

void pma_link_add(const pma_link *L, const double *lam, double *xb)
{
    if (L->each) {
        pma_loops_add(L->each, lam, xb);
        return;
    }
    for (size_t j = 0; j < L->nb; j++) {
        for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++)
            xb[j] += L->values[k] * lam[L->index[k]];
    }
}

void pma_link_gather(const pma_link *L, double scale, const double *xb, double *jump)
{
    if (L->each) {
        pma_loops_gather(L->each, scale, xb, jump);
        return;
    }
    const pma_link l = *L; /* or it would be read again after each number that is stored */
    int64_t k = 0;
    for (size_t j = 0; j < l.nb; j++) {
        const double x = scale * xb[j];
        for (; k < l.ptr[j + 1]; k++)
            jump[l.index[k]] += l.values[k] * x;
    }
}
