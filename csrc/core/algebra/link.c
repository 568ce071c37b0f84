#include "algebra/link.h"

#include <assert.h>

#include "algebra/lanes.h"
#include "algebra/lists.h"

pma_status pma_link_check(const pma_link *L)
{
    if (L->each)
        return PMA_OK;
    const bool good =
        pma_are_starts(L->nb, L->ptr) && pma_are_within(L->p, L->ptr[L->nb], L->index);
    return good ? PMA_OK : PMA_BAD_INDEX;
}

/* `L` is copied, or it would be read again after each number that is stored. */
PMA_LOOP(load, (const pma_link *L, const double *lam, double *xb), {
    const pma_link l = *L;
    const number *from = (const number *)lam;
    number *to = (number *)xb;
    int64_t k = 0;
    for (size_t j = 0; j < l.nb; j++) {
        number sum = {0};
        for (; k < l.ptr[j + 1]; k++)
            PMA_ADD(l.values[k], &from[l.index[k]], &sum);
        to[j] = sum;
    }
})

PMA_LOOP(add, (const pma_link *L, const double *lam, double *xb), {
    const number *from = (const number *)lam;
    number *to = (number *)xb;
    for (size_t j = 0; j < L->nb; j++) {
        number sum = to[j];
        for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++)
            PMA_ADD(L->values[k], &from[L->index[k]], &sum);
        to[j] = sum;
    }
})

PMA_LOOP(gather, (const pma_link *L, double scale, const double *xb, double *jump), {
    const pma_link l = *L;
    const number *from = (const number *)xb;
    number *to = (number *)jump;
    int64_t k = 0;
    for (size_t j = 0; j < l.nb; j++) {
        number x;
        PMA_SCALE(scale, &from[j], &x);
        for (; k < l.ptr[j + 1]; k++)
            PMA_ADD(l.values[k], &x, &to[l.index[k]]);
    }
})

pma_link pma_link_in_lanes(const pma_link *each)
{
    return (pma_link){.p = each->p * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

/* noinline: so that one vector saves no registers for it */
__attribute__((noinline)) static void load_lanes(const pma_link *L, const double *lam, double *xb)
{
    (pma_has_avx2() ? load_avx2 : load_plain)(L->each, lam, xb);
}

void pma_link_load(const pma_link *L, const double *lam, double *xb)
{
    assert(lam || L->p == 0);
    if (L->each)
        load_lanes(L, lam, xb);
    else
        load_one(L, lam, xb);
}

void pma_link_add(const pma_link *L, const double *lam, double *xb)
{
    if (L->each)
        (pma_has_avx2() ? add_avx2 : add_plain)(L->each, lam, xb);
    else
        add_one(L, lam, xb);
}

void pma_link_gather(const pma_link *L, double scale, const double *xb, double *jump)
{
    assert(L->p == 0 || jump);
    if (L->each)
        (pma_has_avx2() ? gather_avx2 : gather_plain)(L->each, scale, xb, jump);
    else
        gather_one(L, scale, xb, jump);
}
