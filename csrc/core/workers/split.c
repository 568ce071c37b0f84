/* split.c - one large subdomain by all workers of the fine steps.
 *
 * Implicit: branches of its elimination tree. Explicit: a range of rows each.
 * With a diagonal Mbar no row waits for another, but K ut needs all of ut: two stages open a
 * substep, one closes it, and what concerns the interface is done by worker 0. The ranges are
 * fixed, so that rows stay in the caches of one core. */
#include "coupling/schedule.h"

typedef struct {
    size_t begin, end;
} range;

static range range_of(const pma_coupler *c, size_t worker)
{
    const size_t n = c->split->member.n, each = n / c->roster.fine;
    return (range){worker * each, worker + 1 < c->roster.fine ? (worker + 1) * each : n};
}

static void predict(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    const pma_coupled *m = c->split;
    const range rows = range_of(c, worker);
    m->member.table->predict(m->member.self, &m->step, rows.begin, rows.end);
}

static void add_forces(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    const pma_coupled *m = c->split;
    const range rows = range_of(c, worker);
    m->member.table->add_forces(m->member.self, &m->step, rows.begin, rows.end);
}

static void correct(void *ctx, size_t worker)
{
    pma_coupler *c = ctx;
    const pma_coupled *m = c->split;
    const range rows = range_of(c, worker);
    if (!m->member.table->correct(m->member.self, &m->step, rows.begin, rows.end))
        atomic_store(&c->not_finite, true);
}

/* Every worker of the fine steps with its range; all wait for the last. */
static void do_together(pma_coupler *c, pma_work stage)
{
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_share_post(c, w, stage);
    stage(c, 0);
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_share_await(c, w);
}

/* ---- in branches ----------------------------------------------------------------------------- */

static void go(void *ctx, size_t worker)
{
    pma_coupler *c = ctx;
    if (!c->split->member.table->go(c->split->member.self, worker))
        atomic_store(&c->not_finite, true);
}

static pma_status visit(pma_coupler *c, const pma_substep *closed, const pma_substep *opened)
{
    const pma_member *member = &c->split->member;
    const pma_status status =
        member->table->begin_visit(member->self, closed, opened, c->working.lam);
    if (status != PMA_OK)
        return status;
    atomic_store(&c->not_finite, false);
    do_together(c, go);
    return member->table->end_visit(member->self, !atomic_load(&c->not_finite));
}

pma_status pma_split_visit(pma_coupler *c, const pma_substep *opened)
{
    const pma_substep *closed = &c->split->step;
    if (closed->twice == opened->twice)
        return visit(c, closed, opened);
    const pma_status status = visit(c, closed, NULL);
    return status == PMA_OK ? visit(c, NULL, opened) : status;
}

/* ---- either way ------------------------------------------------------------------------------ */

pma_status pma_split_open(pma_coupler *c)
{
    const pma_coupled *m = c->split;
    if (m->member.branches)
        return visit(c, NULL, &m->step);
    const pma_status status = m->member.table->evaluate_load(m->member.self, &m->step);
    if (status != PMA_OK)
        return status;
    do_together(c, predict);
    do_together(c, add_forces);
    m->member.table->open_interface(m->member.self, &m->step);
    return PMA_OK;
}

pma_status pma_split_close(pma_coupler *c)
{
    const pma_coupled *m = c->split;
    if (m->member.branches)
        return visit(c, &m->step, NULL);
    m->member.table->close_interface(m->member.self, &m->step, c->working.lam);
    atomic_store(&c->not_finite, false);
    do_together(c, correct);
    if (atomic_load(&c->not_finite))
        return PMA_NOT_FINITE;
    m->member.table->observe(m->member.self, &m->step, c->working.lam);
    return PMA_OK;
}
