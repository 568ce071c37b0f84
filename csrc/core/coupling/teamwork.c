/* teamwork.c - a stage of a step by all workers: each with the subdomains that it has, or several
 * with one large one. */
#include "coupling/schedule.h"

/* ---- waiting -------------------------------------------------------------------------------- */

/* Once stopped the poll is not called again: what made it stop is still to be reported. */
static void look(void *ctx)
{
    pma_coupler *c = ctx;
    if (c->poll && !atomic_load(&c->stopped))
        pma_coupler_poll(c);
}

void pma_teamwork_await(pma_coupler *c, size_t worker)
{
    pma_team_await(c->team, worker, look, c);
}

void pma_teamwork_post(pma_coupler *c, size_t worker, pma_work work)
{
    pma_teamwork_await(c, worker);
    pma_team_post(c->team, worker, work, c);
}

/* ---- shares --------------------------------------------------------------------------------- */

static pma_coupled *member_of(const pma_coupler *c, size_t i)
{
    return &c->coupled[c->roster.order[i]];
}

static bool is_due(const pma_coupler *c, const pma_coupled *m)
{
    return c->due(m) && m != c->split;
}

/* The first that goes wrong ends a worker's share; in ascending order, so that what went wrong
 * first of all is found whichever worker has it. */
static void work_through(void *ctx, size_t worker)
{
    pma_coupler *c = ctx;
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        pma_coupled *m = member_of(c, i);
        const pma_status status = is_due(c, m) ? c->task(c, m) : PMA_OK;
        if (status != PMA_OK) {
            m->status = status;
            atomic_store(&c->has_failed, true);
            return;
        }
    }
}

static bool has_work(const pma_coupler *c, size_t worker)
{
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        if (is_due(c, member_of(c, i)))
            return true;
    }
    return false;
}

/* What went wrong first in the order of the members; all are PMA_OK again. */
static pma_status take_status(pma_coupler *c)
{
    pma_status first = PMA_OK;
    atomic_store(&c->has_failed, false);
    for (size_t i = c->parts.count; i-- > 0;) {
        if (c->coupled[i].status == PMA_OK)
            continue;
        first = c->coupled[i].status;
        c->coupled[i].status = PMA_OK;
        c->failed = i;
    }
    return first;
}

pma_status pma_teamwork_do(pma_coupler *c, pma_task task, pma_due due)
{
    c->task = task;
    c->due = due;
    if (c->split && due(c->split)) {
        c->split->status = task(c, c->split);
        atomic_store(&c->has_failed, c->split->status != PMA_OK);
    }
    for (size_t w = 1; w < c->roster.workers; w++) {
        if (has_work(c, w))
            pma_teamwork_post(c, w, work_through);
    }
    work_through(c, 0);
    for (size_t w = 1; w < c->roster.workers; w++) {
        if (pma_team_is_at(c->team, w, work_through))
            pma_teamwork_await(c, w);
    }
    return atomic_load(&c->has_failed) ? take_status(c) : PMA_OK;
}

/* ---- one member by several workers ---------------------------------------------------------- */

static void work_on_split(void *ctx, size_t worker)
{
    pma_coupler *c = ctx;
    if (!c->shared.work(c->shared.self, worker))
        atomic_store(&c->shared.failed, true);
}

/* Every worker of the fine steps; all wait for the last. */
static bool share(void *ctx, bool (*work)(void *self, size_t worker), void *self)
{
    pma_coupler *c = ctx;
    c->shared.work = work;
    c->shared.self = self;
    atomic_store(&c->shared.failed, false);
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_teamwork_post(c, w, work_on_split);
    work_on_split(c, 0);
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_teamwork_await(c, w);
    return !atomic_load(&c->shared.failed);
}

pma_workers pma_teamwork_workers(pma_coupler *c)
{
    return (pma_workers){.count = c->roster.fine, .ctx = c, .share = share};
}
