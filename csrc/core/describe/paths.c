/* Paths along which loads and ends of springs move, from their fields. */
#include "describe/describe.h"

pma_status pma_parts_path(const pma_field *f, size_t n, pma_path *out)
{
    const pma_field ends = pma_field_at(f, "ends"), dofs = pma_field_at(f, "dofs");
    const pma_field shape = pma_field_at(f, "shape");
    const pma_field start = pma_field_at(f, "start"), speed = pma_field_at(f, "speed");
    int64_t extents[3] = {-1, -1, PMA_SHAPE};
    size_t count;
    const void *data = NULL;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_array(&dofs, PMA_INT64S, 2, extents, &data));
    out->dofs = data;
    out->segments = (size_t)extents[0];
    out->width = (size_t)extents[1];
    PMA_TRY(pma_field_array(&shape, PMA_DOUBLES, 3, extents, &data));
    out->shape = data;
    PMA_TRY(pma_field_vector(&ends, PMA_DOUBLES, &count, &data));
    out->ends = data;
    PMA_TRY(pma_field_real(&start, &out->start));
    PMA_TRY(pma_field_real(&speed, &out->speed));
    if (count != out->segments + 1)
        return pma_field_refuse(&ends, "must be one more than there are segments");
    const pma_status status = pma_path_check(out, n);
    if (status == PMA_BAD_INDEX)
        return pma_field_refuse(&dofs, "must be dofs, or -1");
    return status == PMA_OK ? PMA_OK : pma_field_refuse(&ends, "must rise");
}
