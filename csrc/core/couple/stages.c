/* stages.c - what the schedules share: where members are, the commit; and a stage of a step by all
 * workers, each with the subdomains that it has, or several with one. */
#include <assert.h>

#include "couple/inside.h"

void pma_coupler_move_to(pma_coupler *c, size_t k)
{
    c->k = k;
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_coupled *m = &c->coupled[i];
        m->now = pma_clock_moment(k, m->ratio);
        if (m->now.phase == 1 || m->step.j != m->now.j)
            m->step = pma_substep_of(c, m, m->now.j);
    }
}

bool pma_coupler_poll(pma_coupler *c)
{
    assert(c->poll);
    c->unpolled = 0;
    if (c->poll->stop(c->poll->ctx))
        atomic_store(&c->stopped, true);
    return atomic_load(&c->stopped);
}

void pma_coupler_commit(pma_coupler *c)
{
    assert(c->reached.number == c->present.number + 1);
    for (pma_coupled *m = c->own; m < c->end_of_own; m++)
        m->member.table->commit(m->member.self);
    pma_macro_level_swap(&c->present, &c->reached);
    c->reached.number = c->present.number;
    c->k -= c->fine;
    if (c->record && c->record->ring)
        pma_record_end(c->record, c->origin.number + c->present.number);
}

pma_status pma_coupler_take_paced(pma_coupler *c)
{
    bool is_due;
    do {
        is_due = pma_pace_wait(c->pace);
        if (c->poll && pma_coupler_poll(c))
            return PMA_STOPPED;
    } while (!is_due);
    pma_pace_begin(c->pace);
    PMA_TRY(c->parts.schedule->fine_step(c));
    return pma_pace_end(c->pace);
}

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
    assert(c->team && worker >= 1 && worker < c->roster.workers);
    pma_team_await(c->team, worker, look, c);
}

void pma_teamwork_post(pma_coupler *c, size_t worker, pma_work work)
{
    pma_teamwork_await(c, worker);
    pma_team_post(c->team, worker, work, c);
}

/* ---- shares --------------------------------------------------------------------------------- */

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
        pma_coupled *m = pma_member_of(c, i);
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
        if (is_due(c, pma_member_of(c, i)))
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
    assert(c->team && c->roster.workers > 1);
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
