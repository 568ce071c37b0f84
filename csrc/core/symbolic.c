#include "symbolic.h"

/* Row i of R has an entry in column j when j is reached from an entry of row i of the matrix by
 * going up the elimination tree; the tree grows as the rows are walked. */
void pma_symbolic_count(size_t n, const int64_t *ptr, const int32_t *index, int64_t *parent,
                        int64_t *mark, int64_t *count)
{
    for (size_t i = 0; i < n; i++) {
        const int64_t row = (int64_t)i;
        parent[i] = -1;
        mark[i] = row;
        count[i] = 0;
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++) {
            for (int64_t j = index[k]; j < row && mark[j] != row; j = parent[j]) {
                if (parent[j] < 0)
                    parent[j] = row;
                mark[j] = row;
                count[j]++;
            }
        }
    }
}
