/* Specimens behind actuators and compensators from their fields. */
#include <stdint.h>

#include "describe/describe.h"

/* ---- a linear system ------------------------------------------------------------------------ */

static pma_status take_sensors(const pma_field *f, pma_linear *out)
{
    const pma_field largest = pma_field_at(f, "largest"), quantum = pma_field_at(f, "quantum");
    const pma_field noise = pma_field_at(f, "noise"), seed = pma_field_at(f, "seed");
    const pma_field force_noise = pma_field_at(f, "force_noise");
    int64_t number;
    PMA_TRY(pma_field_real(&largest, &out->largest));
    PMA_TRY(pma_field_real(&quantum, &out->quantum));
    PMA_TRY(pma_field_real(&noise, &out->noise));
    PMA_TRY(pma_field_real(&force_noise, &out->force_noise));
    PMA_TRY(pma_field_integer(&seed, INT64_MIN, &number));
    out->seed = (uint64_t)number;
    return pma_parts_delay(f, &out->delay);
}

static pma_status take_linear(const pma_field *f, size_t width, pma_linear *out)
{
    const pma_field phi = pma_field_at(f, "phi");
    int64_t square[2] = {-1, -1};
    const void *data = NULL;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_array(&phi, PMA_DOUBLES, 2, square, &data));
    if (square[0] < 1 || square[0] != square[1])
        return pma_field_refuse(&phi, "must be square");
    out->phi = data;
    out->inputs = width;
    out->states = (size_t)square[0];
    PMA_TRY(pma_parts_rectangle(f, "before", out->states, width, &out->before));
    PMA_TRY(pma_parts_rectangle(f, "after", out->states, width, &out->after));
    PMA_TRY(pma_parts_rectangle(f, "rest", out->states, width, &out->rest));
    PMA_TRY(pma_parts_rectangle(f, "displacement", width, out->states, &out->displacement));
    PMA_TRY(pma_parts_rectangle(f, "force", width, out->states, &out->force));
    PMA_TRY(pma_field_allocate(f, out->states, sizeof *out->work, (void *)&out->work));
    return take_sensors(f, out);
}

/* ---- a specimen ----------------------------------------------------------------------------- */

/* The dofs of the commands, and how many there are. */
static pma_status take_dofs(const pma_field *f, size_t n, pma_specimen *out)
{
    const pma_field dofs = pma_field_at(f, "dofs");
    out->n = out->width = n;
    return pma_field_is_none(&dofs) ? PMA_OK
                                    : pma_field_positions(&dofs, n, &out->width, &out->dofs);
}

static pma_status take_filters(const pma_field *f, pma_specimen *out)
{
    const pma_field list = pma_field_at(f, "filters"), leading = pma_field_at(f, "leading");
    const pma_field compensators = pma_field_at(f, "compensators");
    pma_filter *filters;
    PMA_TRY(pma_field_tuple(&list, &out->count));
    PMA_TRY(pma_field_count(&compensators, 0, &out->compensators));
    PMA_TRY(pma_field_count(&leading, 0, &out->leading));
    if (out->compensators > out->count || out->leading > out->count)
        return pma_field_refuse(&compensators, "must be among the filters");
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *filters, (void *)&filters));
    out->filters = filters;
    for (size_t k = 0; k < out->count; k++) {
        const pma_field filter = pma_field_item(&list, k);
        PMA_TRY(pma_parts_filter(&filter, out->width, &filters[k]));
    }
    return PMA_OK;
}

/* Springs and a function, or a linear system */
static pma_status take_inner(const pma_field *f, pma_specimen *out, bool *by_caller)
{
    const pma_field springs = pma_field_at(f, "springs"), linear = pma_field_at(f, "linear");
    const pma_field function = pma_field_at(f, "function");
    pma_function inner = {.function = NULL};
    pma_linear *own;
    *by_caller = false;
    PMA_TRY(pma_parts_springs(&springs, &out->springs));
    if (pma_springs_check(&out->springs, out->width) != PMA_OK)
        return pma_field_refuse(&springs, "has a dof that is out of range");
    if (!pma_field_is_none(&linear)) {
        PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
        out->linear = own;
        return take_linear(&linear, out->width, own);
    }
    if (!pma_field_is_none(&function))
        PMA_TRY(pma_field_find(&function, PMA_RESTORING_ROLE, &inner));
    out->function = inner.function;
    out->user = inner.user;
    *by_caller = inner.by_caller;
    return PMA_OK;
}

/* Time levels and copies that have what it remembers. */
enum { LEVELS = 8 };

pma_status pma_parts_specimen(const pma_field *f, size_t n, pma_specimen **out, bool *by_caller)
{
    const pma_field h = pma_field_at(f, "h");
    pma_specimen *own;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    PMA_TRY(take_dofs(f, n, own));
    PMA_TRY(pma_field_real(&h, &own->h));
    PMA_TRY(pma_field_allocate(f, 5 * own->width, sizeof *own->work, (void *)&own->work));
    PMA_TRY(take_filters(f, own));
    PMA_TRY(take_inner(f, own, by_caller));
    PMA_TRY(pma_field_room(f, pma_specimen_numbers(own), LEVELS * sizeof(double)));
    *out = own;
    return PMA_OK;
}
