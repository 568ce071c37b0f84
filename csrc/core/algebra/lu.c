#include "algebra/lu.h"

#include <stdbool.h>
#include <string.h>

/* Are the entries of column j in the rows first(j)..last(j)-1? */
static bool is_triangle(size_t n, const int64_t *ptr, const int32_t *index, bool lower)
{
    if (ptr[0] != 0)
        return false;
    for (size_t j = 0; j < n; j++) {
        if (ptr[j + 1] < ptr[j])
            return false;
    }
    for (size_t j = 0; j < n; j++) {
        const int64_t first = lower ? (int64_t)j + 1 : 0, last = lower ? (int64_t)n : (int64_t)j;
        for (int64_t k = ptr[j]; k < ptr[j + 1]; k++) {
            if (index[k] < first || index[k] >= last)
                return false;
        }
    }
    return true;
}

static bool are_places(size_t n, size_t p, const int32_t *place)
{
    for (size_t k = 0; k < p; k++) {
        if (place[k] < 0 || (size_t)place[k] >= n)
            return false;
    }
    return true;
}

pma_status pma_lu_check(const pma_lu *f)
{
    if (f->p > f->n)
        return PMA_BAD_SIZE;
    const bool good = is_triangle(f->n, f->below, f->lower, true) &&
                      is_triangle(f->n, f->above, f->upper, false) &&
                      are_places(f->n, f->p, f->row) && are_places(f->n, f->p, f->column);
    return good ? PMA_OK : PMA_BAD_INDEX;
}

size_t pma_lu_entries(const pma_lu *f)
{
    return f->n + (size_t)f->below[f->n] + (size_t)f->above[f->n];
}

void pma_lu_solve(const pma_lu *f, double *x, double *work)
{
    memset(work, 0, f->n * sizeof *work);
    for (size_t k = 0; k < f->p; k++)
        work[f->row[k]] = x[k];

    /* L^-1, column by column */
    for (size_t j = 0; j < f->n; j++) {
        for (int64_t k = f->below[j]; k < f->below[j + 1]; k++)
            work[f->lower[k]] -= f->L[k] * work[j];
    }

    /* U^-1, from the last column on */
    for (size_t j = f->n; j-- > 0;) {
        work[j] *= f->inverse[j];
        for (int64_t k = f->above[j]; k < f->above[j + 1]; k++)
            work[f->upper[k]] -= f->U[k] * work[j];
    }
    for (size_t k = 0; k < f->p; k++)
        x[k] = work[f->column[k]];
}
