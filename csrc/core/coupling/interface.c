#include "coupling/interface.h"

#include <stdlib.h>

static pma_status allocate(pma_interface interface, size_t scratch, pma_interface *out)
{
    interface.work = calloc(scratch + 1, sizeof *interface.work);
    if (interface.work)
        *out = interface;
    return interface.work ? PMA_OK : PMA_NO_MEMORY;
}

pma_status pma_interface_create(const pma_factor *H, pma_interface *out)
{
    *out = (pma_interface){.work = NULL};
    PMA_TRY(H->nb == H->n ? pma_factor_check(H) : PMA_BAD_SIZE);
    const pma_interface interface = {.factor = *H, .p = H->n, .entries = 2 * pma_factor_entries(H)};
    return allocate(interface, pma_factor_scratch(H), out);
}

void pma_interface_destroy(pma_interface *x)
{
    free(x->work);
    *x = (pma_interface){.work = NULL};
}
