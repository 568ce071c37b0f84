/* look_ahead.c - interfield parallel: double-step subdomains with a worker beside the fine steps.
 *
 * At its own time level such a subdomain takes the multipliers. Its worker is then assigned to
 * close the step that ended there, and to open the one after next at once, while the others make
 * their fine steps up to its next time level, where it is awaited. A macro step is committed when
 * all of its steps are known to be finite; the others go on meanwhile, never further than the next
 * macro step. */
#include <assert.h>
#include <string.h>

#include "couple/inside.h"
#include "memory.h"

/* The members beside the fine steps are the last ones of the roster. */
static size_t first_parallel(const pma_coupler *c)
{
    return c->roster.begin[c->roster.fine];
}

static size_t end_of_parallel(const pma_coupler *c)
{
    return c->roster.begin[c->roster.workers];
}

pma_status pma_look_ahead_create(pma_coupler *c)
{
    const size_t first = first_parallel(c), end = end_of_parallel(c), p = c->parts.p;
    c->lam_deferred = pma_memory_allocate((end - first) * p + 1, sizeof(double));
    if (!c->lam_deferred)
        return PMA_NO_MEMORY;
    for (size_t i = first; i < end; i++)
        pma_member_of(c, i)->lam = c->lam_deferred + (i - first) * p;
    return PMA_OK;
}

/* ---- assigned work, and waiting for it ------------------------------------------------------ */

static pma_status close_assigned(pma_coupled *m)
{
    const pma_assignment *work = &m->assigned;
    const pma_member *member = &m->member;
    const pma_status status =
        member->table->advance(member->self, &work->closed, NULL, m->lam, NULL);
    if (status == PMA_OK && work->row != PMA_NO_ROW)
        member->table->record(member->self, PMA_MOTION, work->closed.j + 1, NULL, work->selection,
                              work->row);
    return status;
}

/* What a worker does with each of its members that has been assigned something. */
static void go_ahead(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        pma_coupled *m = pma_member_of(c, i);
        pma_assignment *work = &m->assigned;
        if (work->closes)
            work->status = close_assigned(m);
        if (work->opens && work->status == PMA_OK)
            work->status =
                m->member.table->advance(m->member.self, NULL, &work->opened, NULL, NULL);
    }
}

/* From now on what this worker has made can be used. */
static void await(pma_coupler *c, size_t worker)
{
    assert(worker >= c->roster.fine && worker < c->roster.workers);
    pma_teamwork_await(c, worker);
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++)
        pma_member_of(c, i)->assigned.closes = pma_member_of(c, i)->assigned.opens = false;
}

static void await_all(pma_coupler *c)
{
    for (size_t w = c->roster.fine; w < c->roster.workers; w++)
        await(c, w);
}

/* Every worker is assigned what is prepared for those of its members that are due. It has finished
 * what it was assigned before when the first of them is prepared. */
static void assign(pma_coupler *c, bool (*is_due)(const pma_coupler *c, const pma_coupled *m),
                   void (*prepare)(pma_coupler *c, pma_coupled *m))
{
    for (size_t w = c->roster.fine; w < c->roster.workers; w++) {
        bool any = false;
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++) {
            pma_coupled *m = pma_member_of(c, i);
            if (!is_due(c, m))
                continue;
            if (!any)
                await(c, w);
            prepare(c, m);
            any = true;
        }
        if (any)
            pma_teamwork_post(c, w, go_ahead);
    }
}

static bool can_open(const pma_coupler *c, const pma_coupled *m, size_t j)
{
    const pma_substep step = pma_substep_of(c, m, j);
    return m->member.table->is_known(m->member.self, &step);
}

/* ---- opening the step after next ------------------------------------------------------------ */

/* At a time level with one step open, of two that could be? */
static bool could_open(const pma_coupler *c, const pma_coupled *m)
{
    const size_t j = m->now.j;
    return m->now.phase == 1 && !m->assigned.opens && m->step.twice &&
           m->member.table->opened(m->member.self) == j + 1 && can_open(c, m, j + 1);
}

static void prepare_opening(pma_coupler *c, pma_coupled *m)
{
    assert(!m->assigned.opens && !m->assigned.closes);
    m->assigned = (pma_assignment){
        .opens = true, .closed = m->step, .opened = pma_substep_of(c, m, m->now.j + 1)};
}

void pma_look_ahead_open(pma_coupler *c)
{
    assert(pma_look_ahead_is_used(c));
    if (!c->observed)
        assign(c, could_open, prepare_opening);
}

/* ---- closing beside the fine steps ---------------------------------------------------------- */

static bool has_failed_assignment(const pma_coupler *c)
{
    for (size_t i = first_parallel(c); i < end_of_parallel(c); i++) {
        const pma_assignment *work = &pma_member_of(c, i)->assigned;
        if (!work->closes && !work->opens && work->status != PMA_OK)
            return true;
    }
    return false;
}

pma_status pma_look_ahead_await(pma_coupler *c)
{
    assert(pma_look_ahead_is_used(c));
    bool any = false;
    for (size_t w = c->roster.fine; w < c->roster.workers; w++) {
        bool ending = false;
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++)
            ending = ending || pma_is_ending(pma_member_of(c, i));
        if (ending)
            await(c, w);
        any = any || ending;
    }
    if (!any)
        return PMA_OK;
    if (pma_is_pending(c))
        await_all(c);
    c->failed = PMA_INTERFACE;
    return has_failed_assignment(c) ? PMA_NOT_FINITE
                                    : PMA_OK; /* pma_look_ahead_end finds the first one */
}

bool pma_look_ahead_is_busy(const pma_coupler *c)
{
    for (size_t i = first_parallel(c); i < end_of_parallel(c); i++) {
        const pma_assignment *work = &pma_member_of(c, i)->assigned;
        if (work->closes || work->opens || work->status != PMA_OK)
            return true;
    }
    return false;
}

/* A jump that is recorded in the middle of a macro step needs all states at once. */
static bool records_inner_jumps(const pma_coupler *c)
{
    return c->record && c->record->every == 0;
}

/* Not at the end of a call, nor of a macro step that several processes commit, and not where the
 * next macro step would have to be taken back: a restoring force is evaluated once for every step
 * of the macro steps that are completed. */
static bool can_defer(const pma_coupler *c, const pma_coupled *m)
{
    if (!pma_is_ending(m) || !m->step.twice)
        return false;
    if (m->now.j + 1 < m->member.substeps)
        return !records_inner_jumps(c);
    return !c->evaluates && !c->exchange && c->present.number + 1 < c->end;
}

static void prepare_closing(pma_coupler *c, pma_coupled *m)
{
    assert(!m->assigned.opens && !m->assigned.closes);
    const size_t j = m->now.j;
    m->assigned = (pma_assignment){.closes = true,
                                   .closed = m->step,
                                   .opens = can_open(c, m, j + 2),
                                   .opened = pma_substep_of(c, m, j + 2),
                                   .row = PMA_NO_ROW};
    memcpy(m->lam, c->working.lam, c->parts.p * sizeof(double));
    const pma_selection *selection = c->record ? &c->record->selections[m - c->coupled] : NULL;
    if (selection && !pma_selection_is_empty(selection)) {
        m->assigned.selection = selection;
        m->assigned.row = pma_recorder_row(c, j + 1, m->member.substeps);
    }
}

void pma_look_ahead_defer(pma_coupler *c)
{
    assert(pma_look_ahead_is_used(c));
    if (!c->observed)
        assign(c, can_defer, prepare_closing);
}

pma_status pma_look_ahead_end(pma_coupler *c, pma_status status)
{
    size_t first = status == PMA_STOPPED ? SIZE_MAX : c->k;
    await_all(c);
    if (status == PMA_ELSEWHERE)
        return status; /* the failure that all processes know of */
    for (size_t number = 0; number < c->parts.count; number++) {
        const pma_coupled *m = &c->coupled[number];
        const size_t k = (m->assigned.closed.j + 1) * m->ratio;
        if (m->assigned.status == PMA_OK || k > first || (k == first && number > c->failed))
            continue;
        first = k;
        c->failed = number;
        status = status == PMA_STOPPED ? status : m->assigned.status;
    }
    if (pma_is_pending(c) && first > c->fine) {
        pma_recorder_complete(c);
        pma_coupler_commit(c);
    }
    return status;
}
