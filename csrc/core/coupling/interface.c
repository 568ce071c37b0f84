#include "coupling/interface.h"

#include <stdlib.h>

pma_status pma_ldl_create(const pma_factor *H, pma_ldl *out)
{
    *out = (pma_ldl){.work = NULL};
    if (H->nb != H->n)
        return PMA_BAD_SIZE;
    const pma_status status = pma_factor_check(H);
    if (status != PMA_OK)
        return status;
    out->work = calloc(pma_factor_scratch(H) + 1, sizeof *out->work);
    if (!out->work)
        return PMA_NO_MEMORY;
    out->factor = *H;
    return PMA_OK;
}

void pma_ldl_destroy(pma_ldl *ldl)
{
    free(ldl->work);
    *ldl = (pma_ldl){.work = NULL};
}

static void solve(void *self, double *x)
{
    const pma_ldl *ldl = self;
    pma_factor_interface(&ldl->factor, x, ldl->work);
}

static const pma_interface_table LDL = {.solve = solve};

pma_interface pma_ldl_interface(pma_ldl *ldl)
{
    return (pma_interface){.table = &LDL,
                           .self = ldl,
                           .p = ldl->factor.n,
                           .entries = 2 * pma_factor_entries(&ldl->factor)};
}

/* ---- L U ------------------------------------------------------------------------------------ */

pma_status pma_gap_create(const pma_lu *S, pma_gap *out)
{
    *out = (pma_gap){.work = NULL};
    const pma_status status = pma_lu_check(S);
    if (status != PMA_OK)
        return status;
    out->work = calloc(S->n + 1, sizeof *out->work);
    if (!out->work)
        return PMA_NO_MEMORY;
    out->factor = *S;
    return PMA_OK;
}

void pma_gap_destroy(pma_gap *gap)
{
    free(gap->work);
    *gap = (pma_gap){.work = NULL};
}

static void solve_gap(void *self, double *x)
{
    const pma_gap *gap = self;
    pma_lu_solve(&gap->factor, x, gap->work);
}

static const pma_interface_table GAP = {.solve = solve_gap};

pma_interface pma_gap_interface(pma_gap *gap)
{
    return (pma_interface){
        .table = &GAP, .self = gap, .p = gap->factor.p, .entries = pma_lu_entries(&gap->factor)};
}
