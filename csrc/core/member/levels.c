#include "member/levels.h"

#include <stdint.h>
#include <stdlib.h>

#include "algebra/lanes.h"

/* ---- memory --------------------------------------------------------------------------------- */

static double *take(double **next, size_t count)
{
    double *taken = *next;
    *next += count;
    return taken;
}

static pma_state take_state(double **next, const pma_levels *l)
{
    pma_state s;
    s.u = take(next, l->n);
    s.v = take(next, l->n);
    s.w = take(next, l->n);
    s.a = take(next, l->n);
    s.springs = take(next, l->springs);
    s.history = take(next, l->history);
    return s;
}

static size_t state_size(const pma_levels *l)
{
    return 4 * l->n + l->springs + l->history;
}

pma_status pma_levels_create(pma_levels *l)
{
    l->count = l->doubled && l->substeps > 1 ? 2 : 1;
    const size_t states = 1 + l->count + (l->doubled ? 1 : 0);
    /* at most 4 (4 n + springs + history) + 4 nb doubles: no overflow below these */
    if (l->n > SIZE_MAX / (128 * sizeof(double)) || l->springs > SIZE_MAX / (16 * sizeof(double)) ||
        l->history > SIZE_MAX / (16 * sizeof(double)))
        return PMA_NO_MEMORY;
    l->block = calloc(states * state_size(l) + 4 * l->nb + PMA_LANES, sizeof(double));
    if (!l->block)
        return PMA_NO_MEMORY;
    double *next = pma_first_line(l->block);
    l->present = take_state(&next, l);
    for (size_t i = 0; i < l->count; i++)
        l->work[i] = take_state(&next, l);
    if (l->doubled)
        l->previous = take_state(&next, l);
    l->vf_present = take(&next, l->nb);
    l->vf_work[0] = take(&next, l->nb);
    l->vf_work[1] = take(&next, l->nb);
    l->vf_most = 1;
    l->vf_previous = take(&next, l->nb);
    return PMA_OK;
}

void pma_levels_destroy(pma_levels *l)
{
    free(l->block);
    free(l->block_ahead);
}

pma_status pma_levels_extend(pma_levels *l)
{
    const size_t count = !l->doubled ? 2 : l->substeps > 1 ? 4 : 3;
    if (l->block_ahead)
        return PMA_OK;
    l->block_ahead =
        calloc((count - l->count) * state_size(l) + 2 * l->nb + PMA_LANES, sizeof(double));
    if (!l->block_ahead)
        return PMA_NO_MEMORY;
    double *next = pma_first_line(l->block_ahead);
    for (size_t i = l->count; i < count; i++)
        l->work[i] = take_state(&next, l);
    l->vf_work[2] = take(&next, l->nb);
    l->vf_work[3] = take(&next, l->nb);
    l->vf_most = 3;
    l->count = count;
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
    l->opened = 0;
}
