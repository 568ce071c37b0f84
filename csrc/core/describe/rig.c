/* Specimens, and filters in front of them, from their fields. */
#include <stdint.h>
#include <string.h>

#include "describe/describe.h"
#include "rig/actuator.h"
#include "rig/adaptive.h"
#include "rig/inverse.h"
#include "rig/linkage.h"

/* ---- filters of commands -------------------------------------------------------------------- */

/* Lags and samples of a filter: numbers of what it remembers do not overflow. */
enum { MOST = 1 << 30 };

pma_status pma_parts_delay(const pma_field *f, pma_delay *out)
{
    const pma_field lag = pma_field_at(f, "lag"), weight = pma_field_at(f, "weight");
    const void *data = NULL;
    PMA_TRY(pma_field_vector(&lag, PMA_INT64S, &out->taps, &data));
    out->lag = data;
    PMA_TRY(pma_field_doubles(&weight, out->taps, &out->weight));
    out->length = 1;
    for (size_t i = 0; i < out->taps; i++) {
        if (out->lag[i] < 0 || out->lag[i] >= MOST)
            return pma_field_refuse(&lag, "is out of range");
        out->length = (size_t)out->lag[i] + 1 > out->length ? (size_t)out->lag[i] + 1 : out->length;
    }
    return PMA_OK;
}

pma_status pma_parts_rectangle(const pma_field *of, const char *key, size_t rows, size_t columns,
                               const double **out)
{
    const pma_field matrix = pma_field_at(of, key);
    int64_t shape[2] = {(int64_t)rows, (int64_t)columns};
    const void *data = NULL;
    PMA_TRY(pma_field_array(&matrix, PMA_DOUBLES, 2, shape, &data));
    *out = data;
    return PMA_OK;
}

/* ---- actuators ------------------------------------------------------------------------------ */

static pma_status take_dynamics(const pma_field *f, pma_actuator *out)
{
    const pma_field phi = pma_field_at(f, "phi"), slope = pma_field_at(f, "slope");
    const pma_field before = pma_field_at(f, "before"), after = pma_field_at(f, "after");
    int64_t square[2] = {-1, -1};
    const void *data = NULL;
    PMA_TRY(pma_field_array(&phi, PMA_DOUBLES, 2, square, &data));
    out->phi = data;
    out->order = (size_t)square[0];
    if (square[0] > PMA_ACTUATOR_ORDER || square[0] != square[1])
        return pma_field_refuse(&phi, "must be square, and not too large");
    PMA_TRY(pma_field_doubles(&before, out->order, &out->before));
    PMA_TRY(pma_field_doubles(&after, out->order, &out->after));
    return pma_field_doubles(&slope, out->order + 1, &out->slope);
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
    PMA_TRY(pma_parts_delay(f, &out->delay));
    return take_dynamics(f, out);
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

/* ---- the inverse of a model ----------------------------------------------------------------- */

/* outputs: a multiple of `width`; None: without states */
static pma_status take_modal(const pma_field *f, size_t width, pma_modal *out)
{
    const pma_field A = pma_field_at(f, "A"), D = pma_field_at(f, "D");
    int64_t pairs[2] = {-1, 2}, through[2] = {-1, (int64_t)width};
    const void *data = NULL;
    *out = (pma_modal){.inputs = width};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_array(&A, PMA_DOUBLES, 2, pairs, &data));
    out->A = data;
    out->states = (size_t)pairs[0];
    if (out->states % 2 != 0)
        return pma_field_refuse(&A, "must have an even number of rows");
    PMA_TRY(pma_field_array(&D, PMA_DOUBLES, 2, through, &data));
    out->D = data;
    out->outputs = (size_t)through[0];
    if (out->outputs == 0 || out->outputs % width != 0)
        return pma_field_refuse(&D, "must have rows of each command");
    PMA_TRY(pma_parts_rectangle(f, "B", out->states, width, &out->B));
    PMA_TRY(pma_parts_rectangle(f, "C", out->outputs, out->states, &out->C));
    return pma_parts_rectangle(f, "rest", out->states, width, &out->rest);
}

static pma_status take_inverse(const pma_field *f, size_t width, pma_inverse *out)
{
    const pma_field h = pma_field_at(f, "h"), rate = pma_field_at(f, "rate");
    const pma_field acceleration = pma_field_at(f, "acceleration");
    const pma_field sigma = pma_field_at(f, "sigma"), largest = pma_field_at(f, "largest");
    const pma_field command = pma_field_at(f, "command"), feedback = pma_field_at(f, "feedback");
    const pma_field regressors = pma_field_at(f, "regressors"), low = pma_field_at(f, "low");
    double deviation;
    PMA_TRY(pma_field_real(&h, &out->h));
    PMA_TRY(pma_field_real(&rate, &out->rate));
    PMA_TRY(pma_field_real(&acceleration, &out->acceleration));
    PMA_TRY(pma_field_real(&sigma, &deviation));
    PMA_TRY(pma_field_real(&largest, &out->largest));
    out->variance = deviation * deviation;
    PMA_TRY(pma_field_dict(&command));
    PMA_TRY(take_modal(&command, width, &out->command));
    PMA_TRY(take_modal(&feedback, width, &out->feedback));
    PMA_TRY(take_modal(&regressors, width, &out->regressors));
    PMA_TRY(take_modal(&low, width, &out->low));
    out->variations = out->command.outputs / width - 1;
    if (out->feedback.outputs > width || (out->feedback.states > 0 && !out->feedback.outputs))
        return pma_field_refuse(&feedback, "must have an output for each command");
    if (out->variations > 0 &&
        (out->regressors.outputs != out->command.outputs || out->low.outputs != width))
        return pma_field_refuse(&regressors, "must have the outputs of command");
    const size_t scratch = width * (3 + out->variations) + out->variations;
    return pma_field_allocate(f, scratch, sizeof *out->work, (void *)&out->work);
}

/* ---- linkages ------------------------------------------------------------------------------- */

static pma_status take_linkage(const pma_field *f, size_t width, pma_linkage *out)
{
    const double *arms;
    out->has_arms = pma_field_has(f, "arms");
    PMA_TRY(pma_field_allocate(f, width, sizeof *out->work, (void *)&out->work));
    if (!out->has_arms) {
        PMA_TRY(pma_parts_rectangle(f, "matrix", width, width, &out->matrix));
        return pma_parts_rectangle(f, "inverse", width, width, &out->inverse);
    }
    PMA_TRY(pma_parts_rectangle(f, "arms", 2, 2, &arms));
    if (width != 2)
        return pma_field_refuse(f, "must be of two commands");
    for (size_t i = 0; i < 2; i++) {
        out->length[i] = arms[2 * i];
        out->angle[i] = arms[2 * i + 1];
    }
    return PMA_OK;
}

/* ---- any ------------------------------------------------------------------------------------ */

pma_status pma_parts_filter(const pma_field *f, size_t width, pma_filter *out)
{
    union {
        pma_actuator actuator;
        pma_adaptive adaptive;
        pma_inverse inverse;
        pma_linkage linkage;
    } *of;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_allocate(f, 1, sizeof *of, (void *)&of));
    out->of = of;
    if (pma_field_has(f, "limits")) {
        out->kind = &pma_adaptive_kind;
        return take_adaptive(f, &of->adaptive);
    }
    if (pma_field_has(f, "command")) {
        out->kind = &pma_inverse_kind;
        return take_inverse(f, width, &of->inverse);
    }
    if (pma_field_has(f, "arms") || pma_field_has(f, "matrix")) {
        out->kind = &pma_linkage_kind;
        return take_linkage(f, width, &of->linkage);
    }
    out->kind = &pma_actuator_kind;
    return take_actuator(f, &of->actuator);
}

/* ---- specimens ------------------------------------------------------------------------------ */

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
