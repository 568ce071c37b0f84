/* Loads, springs, and paths along which they move, from their fields. */
#include "algebra/lanes.h"
#include "describe/describe.h"
#include "forces/laws.h"

/* ---- paths along which loads and ends of springs move --------------------------------------- */

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

/* ---- orders of dofs ------------------------------------------------------------------------- */

pma_status pma_parts_order(const pma_field *of, size_t n, const int64_t **out)
{
    const pma_field order = pma_field_at(of, "order");
    size_t count;
    PMA_TRY(pma_field_positions(&order, n, &count, out));
    return count == n ? PMA_OK : pma_field_refuse(&order, "must have a dof for each position");
}

/* ---- external forces ------------------------------------------------------------------------ */

/* The times of the samples that a load has. */
static pma_status take_times(const pma_field *f, pma_load *out)
{
    const pma_field values = pma_field_at(f, "values"), begin = pma_field_at(f, "begin");
    const pma_field dt = pma_field_at(f, "dt"), hold = pma_field_at(f, "hold");
    PMA_TRY(pma_field_real(&dt, &out->dt));
    PMA_TRY(pma_field_flag(&hold, &out->hold));
    PMA_TRY(pma_field_real(&begin, &out->begin));
    if (out->samples == 0)
        return pma_field_refuse(&values, "must have samples");
    return out->dt > 0.0 ? PMA_OK : pma_field_refuse(&dt, "must be positive");
}

/* {values (samples,), dt, hold, begin, path} */
static pma_status take_moving(const pma_field *f, pma_load *out)
{
    const pma_field values = pma_field_at(f, "values"), path = pma_field_at(f, "path");
    pma_path *own;
    const void *data = NULL;
    out->kind = PMA_LOAD_MOVING;
    out->k = 1;
    PMA_TRY(pma_field_vector(&values, PMA_DOUBLES, &out->samples, &data));
    out->values = data;
    PMA_TRY(take_times(f, out));
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    out->path = own;
    return pma_parts_path(&path, out->n, own);
}

static pma_status take_sampled(const pma_field *f, pma_load *out)
{
    const pma_field values = pma_field_at(f, "values"), shape = pma_field_at(f, "shape");
    int64_t samples[2] = {-1, -1};
    const void *data = NULL;
    out->kind = PMA_LOAD_SAMPLED;
    PMA_TRY(pma_field_array(&values, PMA_DOUBLES, 2, samples, &data));
    out->values = data;
    out->samples = (size_t)samples[0];
    out->k = (size_t)samples[1];
    PMA_TRY(take_times(f, out));
    if (pma_field_is_none(&shape))
        return out->k == out->n ? PMA_OK
                                : pma_field_refuse(&values, "must have n columns without a shape");
    int64_t extents[2] = {(int64_t)out->k, (int64_t)out->n};
    PMA_TRY(pma_field_array(&shape, PMA_DOUBLES, 2, extents, &data));
    out->shape = data;
    return PMA_OK;
}

static pma_status take_table(const pma_field *f, pma_load *out)
{
    const pma_field rows = pma_field_at(f, "rows"), first = pma_field_at(f, "first");
    int64_t extents[2] = {-1, (int64_t)out->n};
    const void *data = NULL;
    out->kind = PMA_LOAD_TABLE;
    PMA_TRY(pma_field_array(&rows, PMA_DOUBLES, 2, extents, &data));
    out->values = data;
    out->rows = (size_t)extents[0];
    return pma_field_integer(&first, INT64_MIN, &out->first);
}

static pma_status take_called(const pma_field *f, pma_load *out)
{
    const pma_field function = pma_field_at(f, "function");
    out->kind = PMA_LOAD_CALLED;
    PMA_TRY(pma_parts_order(f, out->n, &out->order));
    PMA_TRY(pma_field_allocate(f, out->n, sizeof *out->work, (void *)&out->work));
    return pma_field_find(&function, PMA_LOAD_ROLE, out);
}

/* One load. */
static pma_status take_term(const pma_field *f, pma_load *out)
{
    if (pma_field_is_none(f))
        return PMA_OK;
    if (pma_field_has(f, "path"))
        return take_moving(f, out);
    if (pma_field_has(f, "values"))
        return take_sampled(f, out);
    if (pma_field_has(f, "rows"))
        return take_table(f, out);
    if (pma_field_has(f, "function"))
        return take_called(f, out);
    out->kind = PMA_LOAD_CONSTANT;
    return pma_field_doubles(f, out->n, &out->values);
}

pma_status pma_parts_load(const pma_field *f, size_t n, pma_load *out)
{
    pma_load *each;
    *out = (pma_load){.kind = PMA_LOAD_NONE, .n = n};
    if (f->node->kind != PMA_TUPLE)
        return take_term(f, out);
    PMA_TRY(pma_field_tuple(f, &out->count));
    if (out->count == 0)
        return pma_field_refuse(f, "must not be empty");
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *each, (void *)&each));
    for (size_t i = 0; i < out->count; i++) {
        const pma_field item = pma_field_item(f, i);
        each[i] = (pma_load){.kind = PMA_LOAD_NONE, .n = n};
        PMA_TRY(take_term(&item, &each[i]));
    }
    out->kind = PMA_LOAD_SUM;
    out->each = each;
    return PMA_OK;
}

pma_status pma_parts_lane_loads(const pma_field *f, size_t n, pma_load *out)
{
    pma_load *each;
    pma_lane_term *terms;
    double *shapes;
    size_t count;
    *out = (pma_load){.kind = PMA_LOAD_NONE, .n = n};
    PMA_TRY(pma_field_tuple(f, &count));
    if (count != PMA_LANES)
        return pma_field_refuse(f, "must have a load for each lane");
    PMA_TRY(pma_field_allocate(f, count, sizeof *each, (void *)&each));
    for (size_t l = 0; l < count; l++) {
        const pma_field item = pma_field_item(f, l);
        PMA_TRY(pma_parts_load(&item, n / PMA_LANES, &each[l]));
        if (pma_load_has(&each[l], PMA_LOAD_CALLED) || pma_load_has(&each[l], PMA_LOAD_TABLE) ||
            pma_load_has(&each[l], PMA_LOAD_MOVING))
            return pma_field_refuse(&item, "must not be a function, a table or moving in lanes");
    }
    PMA_TRY(pma_field_allocate(f, pma_load_lane_terms(each), sizeof *terms, (void *)&terms));
    PMA_TRY(pma_field_allocate(f, pma_load_lane_shapes(each), sizeof *shapes, (void *)&shapes));
    *out = pma_load_in_lanes(each, terms, shapes);
    return PMA_OK;
}

/* ---- springs -------------------------------------------------------------------------------- */

/* As many elements as there are parameters for; false where these do not fit. */
static bool take_elements(size_t law, size_t count, pma_spring_set *set)
{
    const size_t own = pma_laws[law].parameters, each = pma_laws[law].each_parameters;
    set->law = (pma_spring_law)law;
    set->elements = each > 0 && count > own ? (count - own) / each : 0;
    return count <= PMA_SPRING_PARAMETERS && pma_spring_parameters(set) == count;
}

static pma_status take_set(const pma_field *f, pma_spring_set *set)
{
    const pma_field law = pma_field_at(f, "law"), parameters = pma_field_at(f, "parameters");
    const pma_field first = pma_field_at(f, "first"), second = pma_field_at(f, "second");
    const void *data = NULL;
    size_t number, count;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&law, 0, &number));
    PMA_TRY(pma_field_vector(&first, PMA_INT32S, &set->count, &data));
    set->first = data;
    PMA_TRY(pma_field_ints(&second, set->count, &set->second));
    PMA_TRY(pma_field_tuple(&parameters, &count));
    if (number >= PMA_SPRING_LAWS || !take_elements(number, count, set))
        return pma_field_refuse(&parameters, "must be as many as the law has");
    for (size_t k = 0; k < count; k++) {
        const pma_field parameter = pma_field_item(&parameters, k);
        PMA_TRY(pma_field_doubles(&parameter, set->count, &set->parameters[k]));
    }
    return PMA_OK;
}

pma_status pma_parts_springs(const pma_field *f, pma_springs *out)
{
    pma_spring_set *sets;
    *out = (pma_springs){.count = 0};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_tuple(f, &out->count));
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *sets, (void *)&sets));
    out->sets = sets;
    for (size_t i = 0; i < out->count; i++) {
        const pma_field set = pma_field_item(f, i);
        PMA_TRY(take_set(&set, &sets[i]));
        out->total += sets[i].count;
    }
    return PMA_OK;
}
