#include "state.h"

/* False for NaN. */
static bool is_count(double x, double most)
{
    return x >= 0.0 && x <= most && (double)(int64_t)x == x;
}

const double *pma_state_wrong_count(const pma_state_array *array, const double *values,
                                    double *most)
{
    for (size_t k = 0; k < array->tables; k++) {
        const pma_state_counts *counts = &array->counts[k];
        *most = counts->most;
        for (size_t i = counts->first; i < counts->first + counts->count; i++) {
            if (!is_count(values[i], *most))
                return &values[i];
        }
    }
    return NULL;
}
