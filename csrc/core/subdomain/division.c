/* division.c - a substep of a large explicit subdomain, divided among several workers.
 *
 * With a diagonal Mbar no row waits for another: every worker has a range of them, which is fixed,
 * so that it stays in the caches of one core. */
#include <assert.h>

#include "algebra/lists.h"
#include "memory.h"
#include "subdomain/inside.h"

/* Diagonal Mbar, linear, single steps: no row waits for another. */
static bool is_in_ranges(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->evaluates;
}

pma_status pma_division_find(pma_subdomain *s)
{
    if (!is_in_ranges(s))
        return PMA_OK;
    s->division = pma_memory_allocate(1, sizeof *s->division);
    return s->division ? PMA_OK : PMA_NO_MEMORY;
}

static const pma_division *begin(pma_subdomain *s, const pma_substep *step,
                                 const pma_workers *workers)
{
    pma_division *d = s->division;
    assert(d && workers->count > 0);
    d->op = pma_operator_at(s, step);
    d->step = step;
    d->from = pma_levels_origin(&s->levels, step);
    d->x = pma_levels_at(&s->levels, step->j + 1);
    d->workers = workers;
    return d;
}

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    const pma_workers *workers = s->division->workers;
    return workers->share(workers->ctx, work, s);
}

/* The first row of a range. */
static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->division->workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

/* ---- open ----------------------------------------------------------------------------------- */

/* (5), (6) */
static bool predict(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    s->update->predict(&d->op->step, begin_of(s, worker), begin_of(s, worker + 1), d->from, d->x);
    return true;
}

/* (11) */
static bool add_forces(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    pma_substep_add_forces(s, s->division->step, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

pma_status pma_division_open(pma_subdomain *s, const pma_substep *step, const pma_workers *workers)
{
    PMA_TRY(pma_substep_load(s, step));
    const pma_division *d = begin(s, step, workers);
    (void)share(s, predict); /* of all rows, before K ut of any */
    (void)share(s, add_forces);
    pma_factor_open_border(&d->op->factor, d->x->w,
                           pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
    return PMA_OK;
}

/* ---- close ---------------------------------------------------------------------------------- */

/* (14) inside, (8), (9) */
static bool close_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = pma_least(end, s->parts.n - s->parts.nb);
    if (begin < inside)
        pma_factor_divide(&d->op->factor, begin, inside, d->x->w);
    return s->update->correct(&d->op->step, begin, end, d->x);
}

pma_status pma_division_close(pma_subdomain *s, const pma_substep *step, const double *lam,
                              const pma_workers *workers)
{
    const pma_division *d = begin(s, step, workers);
    pma_substep_load_interface(s, lam);
    pma_factor_close_border(&d->op->factor, s->closing, d->x->w, s->work);
    if (!share(s, close_range))
        return PMA_NOT_FINITE;
    return s->is_observed ? pma_observers_close(s, step, lam) : PMA_OK;
}
