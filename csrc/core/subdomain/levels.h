/* levels.h - the time levels of a subdomain: the present, and those of the macro step at hand.
 *
 * Time levels after the present are in memory of their own, in turn; only `commit` changes the
 * present, so that whatever ends a macro step early leaves the last whole one. */
#ifndef PMA_LEVELS_H
#define PMA_LEVELS_H

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>

#include "state.h"
#include "status.h"

/* A closed substep, two that are open and the level before. */
enum { PMA_MOST_LEVELS = 4 };

/* First is what every substep reads. */
typedef struct {
    size_t substeps;
    size_t opened;       /* substeps up to this time level are open, counted from the present */
    size_t count, first; /* of `work`: how many there are, and where they begin */
    size_t vf_most, vf_first; /* of `vf_work`: the last of 2 or 4, and where they begin */
    bool doubled;
    double *vf_present; /* stored free velocities */
    double *vf_work[PMA_MOST_LEVELS];
    pma_state present, work[PMA_MOST_LEVELS];
    pma_state previous;       /* time level -1, for double steps */
    double *vf_previous;      /* no step reads it */
    size_t n, nb;             /* sizes of a state and of a free velocity */
    size_t springs, history;  /* ... of what springs and internal forces remember */
    size_t tables;            /* of counts in the former, */
    pma_state_counts *counts; /* ... and after these that of the latter, which is empty without */
    double *states;           /* those that were made last */
    void *block, *block_ahead;
} pma_levels;

/* All levels zero, none open. l->n, nb, springs, substeps and doubled are set by the caller. */
pma_status pma_levels_create(pma_levels *l);
void pma_levels_destroy(pma_levels *l);

/* Room for time levels up to 2 substeps, and for a double-step subdomain two open substeps: the
 * next macro step can then begin before the last one is committed. */
pma_status pma_levels_extend(pma_levels *l);

/* The last time level of the macro step becomes the present. Swaps pointers, cannot fail. */
void pma_levels_commit(pma_levels *l);

/* Nothing is open: the macro step at hand begins again. */
void pma_levels_discard(pma_levels *l);

/* What belongs to a state: u, v, w, a, vf, springs and history of the present and, with double
 * steps, the same of the level before, each as previous_u; their number. */
enum { PMA_LEVEL_ARRAYS = 14 };
size_t pma_levels_arrays(const pma_levels *l, pma_state_array *out);

/* ---- where a time level is, at hand for every step ------------------------------------------ */

/* Single steps are made in place: a macro step has one slot, the next one another if there are two.
 * Double steps need the level before, so those levels take turns. */
static inline size_t pma_levels_slot(const pma_levels *l, size_t j)
{
    if (l->count == 1)
        return 0;
    return (l->first + (l->doubled ? j - 1 : j > l->substeps)) % l->count;
}

/* Of the stored free velocity of time level j > 0. Those of the level before and of all that are
 * open are needed too, so they take turns: 2 of them, or 4 where the next macro step can begin. */
static inline size_t pma_levels_free_slot(const pma_levels *l, size_t j)
{
    assert(j >= 1);
    return (l->vf_first + j - 1) & l->vf_most;
}

/* The state of time level j. Valid until the next commit. */
static inline const pma_state *pma_levels_at(const pma_levels *l, size_t j)
{
    return j == 0 ? &l->present : &l->work[pma_levels_slot(l, j)];
}

/* Its stored free velocity (nb). */
static inline double *pma_levels_free_velocity(const pma_levels *l, size_t j)
{
    return j == 0 ? l->vf_present : l->vf_work[pma_levels_free_slot(l, j)];
}

/* The state from which a substep starts. */
static inline const pma_state *pma_levels_origin(const pma_levels *l, const pma_substep *step)
{
    assert(!step->twice || l->doubled);
    if (!step->twice)
        return pma_levels_at(l, step->j);
    return step->j == 0 ? &l->previous : pma_levels_at(l, step->j - 1);
}

/* The states at the ends of a substep, and the stored free velocity (nb) at its end. */
typedef struct {
    const pma_state *from, *to;
    double *vf;
} pma_span;

static inline pma_span pma_levels_span(const pma_levels *l, const pma_substep *step)
{
    return (pma_span){.from = pma_levels_origin(l, step),
                      .to = pma_levels_at(l, step->j + 1),
                      .vf = pma_levels_free_velocity(l, step->j + 1)};
}

#endif
