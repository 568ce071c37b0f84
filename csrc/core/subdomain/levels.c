#include "subdomain/levels.h"

#include <assert.h>
#include <stdint.h>

#include "memory.h"
#include "object.h"

/* ---- memory --------------------------------------------------------------------------------- */

/* A state in a block, and what follows it. */
static double *take_state(const pma_levels *l, double *x, pma_state *s)
{
    const size_t n = l->n;
    *s = (pma_state){.u = x,
                     .v = x + n,
                     .w = x + 2 * n,
                     .a = x + 3 * n,
                     .springs = x + 4 * n,
                     .history = x + 4 * n + l->springs};
    return s->history + l->history;
}

static size_t state_size(const pma_levels *l)
{
    return 4 * l->n + l->springs + l->history;
}

pma_status pma_levels_create(pma_levels *l)
{
    l->count = l->doubled && l->substeps > 1 ? 2 : 1;
    const size_t states = 1 + l->count + (l->doubled ? 1 : 0);
    const pma_array arrays[] = {
        {offsetof(pma_levels, states), states, state_size(l) * sizeof(double)},
        PMA_ARRAY(pma_levels, vf_present, l->nb),
        PMA_ARRAY(pma_levels, vf_work[0], l->nb),
        PMA_ARRAY(pma_levels, vf_work[1], l->nb),
        PMA_ARRAY(pma_levels, vf_previous, l->nb),
        {0}};
    /* no overflow in the size of a state below these */
    if (l->n > SIZE_MAX / (128 * sizeof(double)) || l->springs > SIZE_MAX / (16 * sizeof(double)) ||
        l->history > SIZE_MAX / (16 * sizeof(double)))
        return PMA_NO_MEMORY;
    l->block = pma_object_fill(l, arrays);
    if (!l->block)
        return PMA_NO_MEMORY;
    double *next = take_state(l, l->states, &l->present);
    for (size_t i = 0; i < l->count; i++)
        next = take_state(l, next, &l->work[i]);
    if (l->doubled)
        take_state(l, next, &l->previous);
    l->vf_most = 1;
    return PMA_OK;
}

void pma_levels_destroy(pma_levels *l)
{
    pma_memory_release(l->block);
    pma_memory_release(l->block_ahead);
}

pma_status pma_levels_extend(pma_levels *l)
{
    const size_t count = !l->doubled ? 2 : l->substeps > 1 ? 4 : 3;
    const pma_array arrays[] = {
        {offsetof(pma_levels, states), count - l->count, state_size(l) * sizeof(double)},
        PMA_ARRAY(pma_levels, vf_work[2], l->nb),
        PMA_ARRAY(pma_levels, vf_work[3], l->nb),
        {0}};
    if (l->block_ahead)
        return PMA_OK;
    l->block_ahead = pma_object_fill(l, arrays);
    if (!l->block_ahead)
        return PMA_NO_MEMORY;
    double *next = l->states;
    for (; l->count < count; l->count++)
        next = take_state(l, next, &l->work[l->count]);
    l->vf_most = 3;
    return PMA_OK;
}

/* ---- commit --------------------------------------------------------------------------------- */

static void swap_states(pma_state *a, pma_state *b)
{
    const pma_state kept = *a;
    *a = *b;
    *b = kept;
}

static void swap_pointers(double **a, double **b)
{
    double *kept = *a;
    *a = *b;
    *b = kept;
}

void pma_levels_commit(pma_levels *l)
{
    const size_t last = l->substeps;
    assert(l->opened >= last);
    if (l->doubled && last > 1) {
        swap_states(&l->previous, &l->work[pma_levels_slot(l, last - 1)]);
        swap_pointers(&l->vf_previous, &l->vf_work[pma_levels_free_slot(l, last - 1)]);
    } else if (l->doubled) {
        swap_states(&l->previous, &l->present);
        swap_pointers(&l->vf_previous, &l->vf_present);
    }
    swap_states(&l->present, &l->work[pma_levels_slot(l, last)]);
    swap_pointers(&l->vf_present, &l->vf_work[pma_levels_free_slot(l, last)]);
    l->first = pma_levels_slot(l, last + 1);
    l->vf_first = pma_levels_free_slot(l, last + 1);
    l->opened = l->opened > last ? l->opened - last : 0;
}

void pma_levels_discard(pma_levels *l)
{
    assert(l->block);
    l->opened = 0;
}

/* ---- by their names ------------------------------------------------------------------------- */

size_t pma_levels_arrays(const pma_levels *l, pma_state_array *out)
{
    static const char *const names[PMA_LEVEL_ARRAYS] = {"u",
                                                        "v",
                                                        "w",
                                                        "a",
                                                        "vf",
                                                        "springs",
                                                        "history",
                                                        "previous_u",
                                                        "previous_v",
                                                        "previous_w",
                                                        "previous_a",
                                                        "previous_vf",
                                                        "previous_springs",
                                                        "previous_history"};
    const pma_state *x = &l->present, *y = &l->previous;
    double *const values[PMA_LEVEL_ARRAYS] = {
        x->u, x->v, x->w, x->a, l->vf_present,  x->springs, x->history,
        y->u, y->v, y->w, y->a, l->vf_previous, y->springs, y->history};
    const size_t counts[] = {l->n, l->n, l->n, l->n, l->nb, l->springs, l->history};
    enum { SPRINGS = 5 };
    const size_t each = sizeof counts / sizeof *counts, count = l->doubled ? 2 * each : each;
    for (size_t i = 0; i < count; i++)
        out[i] =
            (pma_state_array){.name = names[i], .count = counts[i % each], .values = values[i]};
    for (size_t i = SPRINGS; i < count; i += each) {
        out[i].tables = l->tables;
        out[i].counts = l->counts;
        out[i + 1].tables = l->counts ? 1 : 0;
        out[i + 1].counts = l->counts + l->tables;
    }
    return count;
}
