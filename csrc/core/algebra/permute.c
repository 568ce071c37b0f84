#include "algebra/permute.h"

/* Shell's sort with the gaps 1, 4, 13, 40, ...: rows are short, and mostly in ascending pieces. */
void pma_permute_sort(int64_t count, int32_t *index, double *values)
{
    int64_t gap = 1;
    while (3 * gap + 1 < count)
        gap = 3 * gap + 1;
    for (; gap > 0; gap /= 3) {
        for (int64_t e = gap; e < count; e++) {
            const int32_t own = index[e];
            const double value = values[e];
            int64_t at = e;
            for (; at >= gap && index[at - gap] > own; at -= gap) {
                index[at] = index[at - gap];
                values[at] = values[at - gap];
            }
            index[at] = own;
            values[at] = value;
        }
    }
}

void pma_permute(size_t n, const int64_t *ptr, const int32_t *index, const double *values,
                 const int64_t *order, const int32_t *position, int64_t *B_ptr, int32_t *B_index,
                 double *B_values)
{
    int64_t count = 0;
    for (size_t k = 0; k < n; k++) {
        B_ptr[k] = count;
        for (int64_t e = ptr[order[k]]; e < ptr[order[k] + 1]; e++, count++) {
            B_index[count] = position[index[e]];
            B_values[count] = values[e];
        }
        pma_permute_sort(count - B_ptr[k], B_index + B_ptr[k], B_values + B_ptr[k]);
    }
    B_ptr[n] = count;
}
