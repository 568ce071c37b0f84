/* Specimens behind actuators and compensators from their fields. */
#include <stdint.h>
#include <string.h>

#include "parts/parts.h"

/* Lags and samples of a filter: numbers of what it remembers do not overflow. */
enum { MOST = 1 << 30 };

static pma_status take_vectors(const pma_field *f, pma_actuator *out)
{
    const pma_field lag = pma_field_at(f, "lag"), weight = pma_field_at(f, "weight");
    const pma_field phi = pma_field_at(f, "phi"), slope = pma_field_at(f, "slope");
    const pma_field before = pma_field_at(f, "before"), after = pma_field_at(f, "after");
    int64_t square[2] = {-1, -1};
    const void *data = NULL;
    PMA_TRY(pma_field_vector(&lag, PMA_INT64S, &out->taps, &data));
    out->lag = data;
    PMA_TRY(pma_field_array(&phi, PMA_DOUBLES, 2, square, &data));
    out->phi = data;
    out->order = (size_t)square[0];
    if (square[0] > PMA_ACTUATOR_ORDER || square[0] != square[1])
        return pma_field_refuse(&phi, "must be square, and not too large");
    PMA_TRY(pma_field_doubles(&weight, out->taps, &out->weight));
    PMA_TRY(pma_field_doubles(&before, out->order, &out->before));
    PMA_TRY(pma_field_doubles(&after, out->order, &out->after));
    PMA_TRY(pma_field_doubles(&slope, out->order + 1, &out->slope));
    out->length = 1;
    for (size_t i = 0; i < out->taps; i++) {
        if (out->lag[i] < 0 || out->lag[i] >= MOST)
            return pma_field_refuse(&lag, "is out of range");
        out->length = (size_t)out->lag[i] + 1 > out->length ? (size_t)out->lag[i] + 1 : out->length;
    }
    return PMA_OK;
}

static pma_status take_actuator(const pma_field *f, pma_actuator *out)
{
    const pma_field largest = pma_field_at(f, "largest"), noise = pma_field_at(f, "noise");
    const pma_field quantum = pma_field_at(f, "quantum"), seed = pma_field_at(f, "seed");
    int64_t number;
    PMA_TRY(pma_field_real(&largest, &out->largest));
    PMA_TRY(pma_field_real(&noise, &out->noise));
    PMA_TRY(pma_field_real(&quantum, &out->quantum));
    PMA_TRY(pma_field_integer(&seed, INT64_MIN, &number));
    out->seed = (uint64_t)number;
    return take_vectors(f, out);
}

static pma_status take_adaptive(const pma_field *f, pma_adaptive *out)
{
    const pma_field limits = pma_field_at(f, "limits"), section = pma_field_at(f, "section");
    const pma_field h = pma_field_at(f, "h"), threshold = pma_field_at(f, "threshold");
    const pma_field every = pma_field_at(f, "every"), window = pma_field_at(f, "window");
    int64_t four[2] = {4, PMA_ADAPTIVE_TERMS}, five[2] = {-1, 5};
    const void *data = NULL;
    PMA_TRY(pma_field_real(&h, &out->h));
    PMA_TRY(pma_field_real(&threshold, &out->threshold));
    PMA_TRY(pma_field_count(&every, 1, &out->every));
    PMA_TRY(pma_field_count(&window, 1, &out->window));
    if (out->window > MOST)
        return pma_field_refuse(&window, "is too large");
    PMA_TRY(pma_field_array(&limits, PMA_DOUBLES, 2, four, &data));
    const double *values = data;
    double *const rows[4] = {out->start, out->least, out->most, out->change};
    for (size_t i = 0; i < 4; i++)
        memcpy(rows[i], values + i * PMA_ADAPTIVE_TERMS, sizeof out->start);
    PMA_TRY(pma_field_array(&section, PMA_DOUBLES, 2, five, &data));
    out->sections = (size_t)five[0];
    out->section = data;
    return PMA_OK;
}

static pma_status take_filter(const pma_field *f, pma_filter *out)
{
    pma_adaptive *adaptive;
    PMA_TRY(pma_field_dict(f));
    if (!pma_field_has(f, "limits"))
        return take_actuator(f, &out->actuator);
    PMA_TRY(pma_field_allocate(f, 1, sizeof *adaptive, (void *)&adaptive));
    out->adaptive = adaptive;
    return take_adaptive(f, adaptive);
}

pma_status pma_parts_specimen(const pma_field *f, size_t n, pma_specimen **out, bool *by_caller)
{
    const pma_field list = pma_field_at(f, "filters"), springs = pma_field_at(f, "springs");
    const pma_field function = pma_field_at(f, "function");
    const pma_field compensators = pma_field_at(f, "compensators");
    pma_specimen *own;
    pma_filter *filters;
    pma_function inner = {.function = NULL};
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    own->n = n;
    PMA_TRY(pma_field_tuple(&list, &own->count));
    PMA_TRY(pma_field_count(&compensators, 0, &own->compensators));
    if (own->compensators > own->count)
        return pma_field_refuse(&compensators, "must be among the filters");
    PMA_TRY(pma_field_allocate(f, own->count, sizeof *filters, (void *)&filters));
    PMA_TRY(pma_field_allocate(f, n, sizeof *own->work, (void *)&own->work));
    PMA_TRY(pma_parts_springs(&springs, &own->springs));
    if (pma_springs_check(&own->springs, n) != PMA_OK)
        return pma_field_refuse(&springs, "has a dof that is out of range");
    own->filters = filters;
    for (size_t k = 0; k < own->count; k++) {
        const pma_field filter = pma_field_item(&list, k);
        PMA_TRY(take_filter(&filter, &filters[k]));
    }
    PMA_TRY(pma_field_room(&list, pma_specimen_numbers(own), sizeof(double)));
    if (!pma_field_is_none(&function))
        PMA_TRY(pma_field_find(&function, PMA_RESTORING_ROLE, &inner));
    own->function = inner.function;
    own->user = inner.user;
    *by_caller = inner.by_caller;
    *out = own;
    return PMA_OK;
}
