/* ranges.c - one large explicit subdomain by several workers, in ranges of its rows.
 *
 * With a diagonal Mbar no row waits for another, but K ut needs all of ut: two stages open a
 * substep, one closes it, and what concerns the interface is done by one worker. The ranges are
 * fixed, so that rows stay in the caches of one core. */
#include "member/subdomain_struct.h"

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

bool pma_ranges_are_apart(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->restores;
}

static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->visit.workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    return s->visit.workers->share(s->visit.workers->ctx, work, s);
}

/* ---- open ----------------------------------------------------------------------------------- */

/* (5), (6) */
static bool predict(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_visit *v = &s->visit;
    s->update->predict(&v->op->step, begin_of(s, worker), begin_of(s, worker + 1), v->from, v->to);
    return true;
}

/* (11) */
static bool add_forces(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    pma_substep_add_forces(s, s->visit.opened, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

static pma_status open_ranges(pma_subdomain *s, const pma_substep *step)
{
    const size_t n = s->parts.n;
    const pma_status status = pma_substep_load(s, step);
    if (status != PMA_OK)
        return status;
    (void)share(s, predict);
    (void)share(s, add_forces);
    pma_factor_open_part(&s->visit.op->factor, n, n, s->visit.to->w,
                         pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
    return PMA_OK;
}

/* ---- close ---------------------------------------------------------------------------------- */

/* (14) inside, (8), (9) */
static bool correct(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_visit *v = &s->visit;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = least(end, s->parts.n - s->parts.nb);
    pma_factor_close_part(&v->op->factor, begin, inside, s->closing, v->x->w, s->work);
    return s->update->correct(&v->op->step, begin, end, v->x);
}

/* (14) on the interface, then in all ranges */
static pma_status close_ranges(pma_subdomain *s, const pma_substep *step)
{
    const size_t n = s->parts.n;
    pma_substep_load_interface(s, s->visit.lam);
    pma_factor_close_part(&s->visit.op->factor, n, n, s->closing, s->visit.x->w, s->work);
    return share(s, correct) ? pma_substep_observe(s, step, s->visit.lam) : PMA_NOT_FINITE;
}

pma_status pma_ranges_advance(pma_subdomain *s, const pma_substep *closed,
                              const pma_substep *opened, const double *lam,
                              const pma_workers *workers)
{
    s->visit = pma_visit_make(s, closed, opened, lam, workers);
    const pma_status status = closed ? close_ranges(s, closed) : PMA_OK;
    return opened && status == PMA_OK ? open_ranges(s, opened) : status;
}
