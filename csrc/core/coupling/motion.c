#include "coupling/motion.h"

#include <string.h>

pma_status pma_motion_check(size_t count, const pma_motion *motions, size_t p)
{
    for (size_t i = 0; i < count; i++) {
        const pma_motion *motion = &motions[i];
        if (motion->load.n > p)
            return PMA_BAD_SIZE;
        for (size_t k = 0; k < motion->load.n; k++) {
            if (motion->rows[k] < 0 || (size_t)motion->rows[k] >= p)
                return PMA_BAD_INDEX;
        }
    }
    return PMA_OK;
}

void pma_motion_prescribe(size_t count, const pma_motion *motions, double t, int64_t number,
                          double *scratch, double *g)
{
    for (size_t i = 0; i < count; i++) {
        const pma_motion *motion = &motions[i];
        memset(scratch, 0, motion->load.n * sizeof(double));
        pma_load_add(&motion->load, t, number, scratch);
        for (size_t k = 0; k < motion->load.n; k++)
            g[motion->rows[k]] = scratch[k];
    }
}
