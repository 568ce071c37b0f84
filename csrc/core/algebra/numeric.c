#include "algebra/numeric.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

/* A pivot below this part of its diagonal entry has lost all digits. */
#define LOST (64.0 * DBL_EPSILON)

static size_t entries_of(const pma_numeric_parts *parts)
{
    return (size_t)parts->ptr[parts->n];
}

static bool is_diagonal(const pma_numeric_parts *parts)
{
    return entries_of(parts) == parts->n;
}

/* ---- making --------------------------------------------------------------------------------- */

static pma_status check_row(const pma_numeric_parts *parts, size_t i)
{
    bool diagonal = false;
    for (int64_t k = parts->ptr[i]; k < parts->ptr[i + 1]; k++) {
        if (k > parts->ptr[i] && parts->index[k] <= parts->index[k - 1])
            return PMA_BAD_INDEX;
        diagonal = diagonal || (size_t)parts->index[k] == i;
    }
    return diagonal ? PMA_OK : PMA_BAD_INDEX;
}

static pma_status check(const pma_numeric_parts *parts)
{
    const pma_matrix pattern = {
        .form = PMA_SPARSE, .n = parts->n, .ptr = parts->ptr, .index = parts->index};
    pma_status status = pma_matrix_check(&pattern);
    for (size_t i = 0; i < parts->n && status == PMA_OK; i++)
        status = check_row(parts, i);
    if (status != PMA_OK || is_diagonal(parts))
        return status;
    return pma_panels_check(&parts->panels, parts->n, parts->nb);
}

pma_status pma_numeric_create(const pma_numeric_parts *parts, pma_numeric *out)
{
    *out = (pma_numeric){.values = NULL};
    const pma_status status = check(parts);
    if (status != PMA_OK)
        return status;
    const bool diagonal = is_diagonal(parts);
    const pma_panels *panels = &parts->panels;
    const size_t n = parts->n, entries = entries_of(parts);
    const size_t size = diagonal ? 0 : (size_t)panels->start[panels->count];
    const size_t update = diagonal ? 0 : pma_panels_update_size(panels);
    double *block = calloc(entries + n + size + update + 1, sizeof *block);
    int64_t *integers = calloc(diagonal ? 1 : 3 * panels->count + n + 1, sizeof *integers);
    if (!block || !integers) {
        free(block);
        free(integers);
        return PMA_NO_MEMORY;
    }
    *out = (pma_numeric){.parts = *parts,
                         .values = block,
                         .inverse = block + entries,
                         .update = block + entries + n + size,
                         .integers = integers,
                         .block = block};
    for (size_t i = 0; i < n; i++)
        out->inverse[i] = 1.0;
    out->parts.panels.values = out->inverse + n;
    out->factor = (pma_factor){.form = diagonal ? PMA_DIAGONAL : PMA_PANELS,
                               .n = n,
                               .nb = parts->nb,
                               .inverse = out->inverse,
                               .panels = out->parts.panels};
    return PMA_OK;
}

void pma_numeric_destroy(pma_numeric *f)
{
    free(f->block);
    free(f->integers);
    *f = (pma_numeric){.values = NULL};
}

/* ---- numbers -------------------------------------------------------------------------------- */

static bool never(void *ctx)
{
    (void)ctx;
    return false;
}

static pma_status invert(pma_numeric *f, size_t *column)
{
    for (size_t i = 0; i < f->parts.n; i++) {
        *column = i;
        if (!(f->values[i] > DBL_MIN))
            return PMA_NOT_DEFINITE;
        f->inverse[i] = 1.0 / f->values[i];
    }
    return PMA_OK;
}

pma_status pma_numeric_factor(pma_numeric *f, size_t *column)
{
    const pma_numeric_parts *parts = &f->parts;
    if (is_diagonal(parts))
        return invert(f, column);
    const pma_panels_input input = {
        .n = parts->n, .ptr = parts->ptr, .index = parts->index, .values = f->values, .lost = LOST};
    return pma_panels_factor(&f->parts.panels, &input, parts->owner, &parts->blas, f->inverse,
                             f->update, f->integers, column, never, NULL);
}

size_t pma_numeric_entry(const pma_numeric_parts *parts, size_t row, size_t column)
{
    int64_t low = parts->ptr[row], high = parts->ptr[row + 1];
    while (low < high) {
        const int64_t middle = low + (high - low) / 2;
        if ((size_t)parts->index[middle] < column)
            low = middle + 1;
        else
            high = middle;
    }
    const bool found = low < parts->ptr[row + 1] && (size_t)parts->index[low] == column;
    return found ? (size_t)low : SIZE_MAX;
}

void pma_numeric_multiply(const pma_numeric *f, const double *x, double *y)
{
    for (size_t i = 0; i < f->parts.n; i++) {
        double sum = 0.0;
        for (int64_t k = f->parts.ptr[i]; k < f->parts.ptr[i + 1]; k++)
            sum += f->values[k] * x[f->parts.index[k]];
        y[i] += sum;
    }
}
