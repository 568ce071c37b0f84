/* Matrices, factors and links from their fields. */
#include <stdint.h>

#include "describe/describe.h"

/* Doubles in up to two axes, or two such arrays in one with an axis more: where the second of them
 * begins goes to *second, 0 where there is none. An extent of -1 is any, and is set. */
static pma_status take_once_or_twice(const pma_field *f, uint32_t axes, int64_t *extent,
                                     const double **values, size_t *second)
{
    int64_t pair[PMA_AXES] = {2, extent[0], axes > 1 ? extent[1] : 0};
    const void *data = NULL;
    const bool twice = pma_field_is_array(f, axes + 1);
    PMA_TRY(pma_field_array(f, PMA_DOUBLES, axes + twice, twice ? pair : extent, &data));
    size_t size = 1;
    for (uint32_t i = 0; i < axes; i++) {
        extent[i] = twice ? pair[i + 1] : extent[i];
        size *= (size_t)extent[i];
    }
    *values = data;
    *second = twice ? size : 0;
    return PMA_OK;
}

/* `count` + 1 starts of what `f` has the parts of. */
static pma_status take_starts(const pma_field *f, const char *name, size_t count,
                              const int64_t **out)
{
    const pma_field starts = pma_field_at(f, name);
    PMA_TRY(pma_field_longs(&starts, count + 1, out));
    return (*out)[count] < 0 ? pma_field_refuse(&starts, "must not end with a negative number")
                             : PMA_OK;
}

/* ptr (n + 1) and index of as many entries as it ends with. */
static pma_status take_pattern(const pma_field *f, size_t n, const int64_t **ptr,
                               const int32_t **index)
{
    const pma_field indices = pma_field_at(f, "indices");
    PMA_TRY(take_starts(f, "ptr", n, ptr));
    return pma_field_ints(&indices, (size_t)(*ptr)[n], index);
}

/* The number of groups that `first` divides rows or columns in. */
static pma_status take_first(const pma_field *f, size_t *count, const int64_t **out)
{
    const pma_field first = pma_field_at(f, "first");
    const void *data = NULL;
    PMA_TRY(pma_field_vector(&first, PMA_INT64S, count, &data));
    *out = data;
    if (*count == 0)
        return pma_field_refuse(&first, "must not be empty");
    *count -= 1;
    return PMA_OK;
}

/* ---- matrices ------------------------------------------------------------------------------- */

static pma_status refuse_band(const pma_field *f)
{
    return pma_field_refuse(f, "cannot have these extents in a matrix of this size");
}

static pma_status take_matrix_band(const pma_field *f, size_t n, pma_matrix *out)
{
    const pma_field band = pma_field_at(f, "band");
    int64_t extent[2] = {-1, -1};
    out->form = PMA_BAND;
    PMA_TRY(take_once_or_twice(&band, 2, extent, &out->values, &out->below));
    if (extent[1] != (int64_t)n || extent[0] < 1 || extent[0] > extent[1])
        return refuse_band(&band);
    out->width = (size_t)extent[0] - 1;
    return PMA_OK;
}

static pma_status take_strips(const pma_field *f, pma_matrix *out)
{
    pma_strips *S = &out->strips;
    const pma_field values = pma_field_at(f, "values");
    out->form = PMA_STRIPS;
    PMA_TRY(take_first(f, &S->count, &S->first));
    PMA_TRY(take_pattern(f, S->count, &S->ptr, &S->index));
    PMA_TRY(take_starts(f, "start", S->count, &S->start));
    return pma_field_doubles(&values, (size_t)S->start[S->count], &S->values);
}

static pma_status take_rows(const pma_field *f, size_t n, pma_matrix *out)
{
    const pma_field values = pma_field_at(f, "values");
    out->form = PMA_SPARSE;
    PMA_TRY(take_pattern(f, n, &out->ptr, &out->index));
    return pma_field_doubles(&values, (size_t)out->ptr[n], &out->values);
}

static pma_status take_dense(const pma_field *f, size_t n, pma_matrix *out)
{
    int64_t square[2] = {(int64_t)n, (int64_t)n};
    const void *data = NULL;
    out->form = PMA_DENSE;
    PMA_TRY(pma_field_array(f, PMA_DOUBLES, 2, square, &data));
    out->values = data;
    return PMA_OK;
}

pma_status pma_parts_matrix(const pma_field *f, size_t n, pma_matrix *out)
{
    *out = (pma_matrix){.form = PMA_ZERO, .n = n};
    if (pma_field_is_none(f))
        return PMA_OK;
    if (pma_field_has(f, "band"))
        return take_matrix_band(f, n, out);
    if (pma_field_has(f, "first"))
        return take_strips(f, out);
    if (f->node->kind == PMA_DICT)
        return take_rows(f, n, out);
    if (pma_field_is_array(f, 2))
        return take_dense(f, n, out);
    out->form = PMA_DIAGONAL;
    return pma_field_doubles(f, n, &out->values);
}

/* ---- factors -------------------------------------------------------------------------------- */

static pma_status take_factor_band(const pma_field *R, size_t n, pma_factor *out)
{
    const pma_field band = pma_field_at(R, "band");
    int64_t extent[2] = {-1, -1};
    out->form = PMA_BAND;
    PMA_TRY(take_once_or_twice(&band, 2, extent, &out->values, &out->Q));
    if (extent[0] != (int64_t)n || extent[1] < 1 || extent[1] >= extent[0])
        return refuse_band(&band);
    out->width = (size_t)extent[1];
    return PMA_OK;
}

static pma_status take_columns(const pma_field *R, size_t n, pma_factor *out)
{
    const pma_field values = pma_field_at(R, "values");
    out->form = PMA_SPARSE;
    PMA_TRY(take_pattern(R, n, &out->ptr, &out->index));
    int64_t entries = out->ptr[n];
    return take_once_or_twice(&values, 1, &entries, &out->values, &out->Q);
}

static pma_status take_structure(const pma_field *f, pma_panels *out)
{
    const pma_field rows = pma_field_at(f, "rows");
    *out = (pma_panels){.count = 0};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_first(f, &out->count, &out->first));
    PMA_TRY(take_starts(f, "row_ptr", out->count, &out->row_ptr));
    PMA_TRY(take_starts(f, "start", out->count, &out->start));
    return pma_field_ints(&rows, (size_t)out->row_ptr[out->count], &out->rows);
}

static pma_status take_panels(const pma_field *f, pma_panels *out)
{
    const pma_field values = pma_field_at(f, "values");
    const double *data = NULL;
    PMA_TRY(take_structure(f, out));
    int64_t length = out->start[out->count];
    PMA_TRY(take_once_or_twice(&values, 1, &length, &data, &out->Q));
    out->values = (double *)(uintptr_t)data; /* written only where a factor is made */
    return PMA_OK;
}

pma_status pma_parts_factor(const pma_field *f, size_t n, size_t nb, pma_factor *out)
{
    const pma_field inverse = pma_field_at(f, "inverse"), R = pma_field_at(f, "R");
    int64_t square[2] = {(int64_t)n, (int64_t)n};
    *out = (pma_factor){.form = PMA_DIAGONAL, .n = n, .nb = nb};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_doubles(&inverse, n, &out->inverse));
    if (pma_field_is_none(&R))
        return PMA_OK;
    if (pma_field_has(&R, "band"))
        return take_factor_band(&R, n, out);
    if (pma_field_has(&R, "first")) {
        out->form = PMA_PANELS;
        return take_panels(&R, &out->panels);
    }
    if (R.node->kind == PMA_DICT)
        return take_columns(&R, n, out);
    out->form = PMA_DENSE;
    return take_once_or_twice(&R, 2, square, &out->values, &out->Q);
}

/* ---- links, and what is factored again ------------------------------------------------------ */

/* Numbers that a member has of each constraint, also of those that do not reach it. */
enum { OF_CONSTRAINT = 4 };

pma_status pma_parts_link(const pma_field *f, size_t nb, pma_link *out)
{
    const pma_field p = pma_field_at(f, "p"), values = pma_field_at(f, "values");
    *out = (pma_link){.nb = nb};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&p, 0, &out->p));
    PMA_TRY(pma_field_room(&p, out->p, OF_CONSTRAINT * sizeof(double)));
    PMA_TRY(take_pattern(f, nb, &out->ptr, &out->index));
    return pma_field_doubles(&values, (size_t)out->ptr[nb], &out->values);
}

pma_status pma_parts_blas(const pma_field *of, pma_blas *out)
{
    const pma_field dgemm = pma_field_at(of, "dgemm"), dtrsm = pma_field_at(of, "dtrsm");
    *out = (pma_blas){.from = PMA_BLAS_FROM};
    if (pma_field_is_none(&dgemm) && pma_field_is_none(&dtrsm))
        return PMA_OK;
    PMA_TRY(pma_field_find(&dgemm, PMA_DGEMM_ROLE, out));
    return pma_field_find(&dtrsm, PMA_DTRSM_ROLE, out);
}

pma_status pma_parts_numeric(const pma_field *f, size_t n, size_t nb, pma_numeric_parts *out)
{
    const pma_field structure = pma_field_at(f, "structure"), flag = pma_field_at(f, "unsymmetric");
    const pma_field owner = pma_field_at(&structure, "owner");
    *out = (pma_numeric_parts){.n = n, .nb = nb};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_flag(&flag, &out->unsymmetric));
    PMA_TRY(take_pattern(f, n, &out->ptr, &out->index));
    if (pma_field_is_none(&structure))
        return PMA_OK;
    PMA_TRY(pma_parts_blas(f, &out->blas));
    PMA_TRY(take_structure(&structure, &out->panels));
    const int64_t numbers = out->panels.start[out->panels.count];
    /* of the factor, and of what is subtracted from a supernode */
    PMA_TRY(pma_field_room(&structure, numbers > 0 ? (size_t)numbers : 0,
                           (out->unsymmetric ? 3 : 2) * sizeof(double)));
    return pma_field_longs(&owner, n, &out->owner);
}
