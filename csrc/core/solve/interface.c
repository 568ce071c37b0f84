#include "solve/interface.h"

#include "memory.h"

pma_status pma_interface_create(const pma_factor *H, pma_interface *out)
{
    *out = (pma_interface){.work = NULL};
    PMA_TRY(H->nb == H->n ? pma_factor_check(H) : PMA_BAD_SIZE);
    double *work = pma_memory_allocate(pma_factor_scratch(H) + 1, sizeof *work);
    if (!work)
        return PMA_NO_MEMORY;
    *out = (pma_interface){
        .factor = *H, .p = H->n, .entries = 2 * pma_factor_entries(H), .work = work};
    return PMA_OK;
}

void pma_interface_destroy(pma_interface *x)
{
    pma_memory_release(x->work);
    *x = (pma_interface){.work = NULL};
}
