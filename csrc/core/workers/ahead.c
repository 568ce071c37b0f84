/* ahead.c - interfield parallel: double-step subdomains that have a worker beside the fine steps.
 *
 * At a node of its own such a subdomain takes the multipliers. Then its worker closes the step that
 * ended there and at once opens the one after next, while the others make their fine steps up to
 * its next node, where it is awaited. A macro step is committed when all of its steps are known to
 * have come out finite; the others go on meanwhile, and never further than the next one. */
#include <string.h>

#include "coupling/schedule.h"

/* Number i of the roster. */
static pma_place *place_of(const pma_coupler *c, size_t i)
{
    return &c->places[c->roster.order[i]];
}

static bool arrives(const pma_place *at)
{
    return at->phase == at->ratio;
}

static pma_status finish(const pma_job *job, pma_subdomain *s, const double *lam)
{
    const pma_status status = pma_subdomain_close(s, job->j, true, lam);
    if (status == PMA_OK && job->row != PMA_NO_ROW)
        pma_record_state(job->nodes, pma_subdomain_at(s, job->j), job->row);
    return status;
}

/* What a worker does with each of its subdomains that have reached a node. */
static void go_ahead(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        pma_place *at = place_of(c, i);
        pma_job *job = &at->job;
        if (!job->running)
            continue;
        if (job->closes)
            job->status = finish(job, at->subdomain, at->lam);
        if (job->opens && job->status == PMA_OK)
            job->status =
                pma_subdomain_open(at->subdomain, job->j + 1, true, job->t1, job->step);
    }
}

/* From now on what this worker has made can be used. */
static void await(pma_coupler *c, size_t worker)
{
    pma_team_await(c->team, worker);
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++)
        place_of(c, i)->job.running = false;
}

static void await_all(pma_coupler *c)
{
    for (size_t w = c->roster.fine; w < c->roster.workers; w++)
        await(c, w);
}

/* Can the step towards this own node be opened already? What was asked of Python is not known
 * beyond the end of a call, and a function of the user's is asked in its turn. */
static bool is_known(const pma_coupler *c, const pma_place *at, size_t node)
{
    const pma_load *load = pma_subdomain_load(at->subdomain);
    const int64_t step = c->step_count * (int64_t)at->substeps + (int64_t)node - 1;
    if (load->kind == PMA_LOAD_TABLE)
        return step - load->first < (int64_t)load->rows;
    return load->kind != PMA_LOAD_CALLED;
}

/* A job at own node j: the step that ended there, and the one after next. */
static void prepare(pma_coupler *c, pma_place *at, size_t j, bool closes)
{
    at->job = (pma_job){.running = true,
                        .closes = closes,
                        .opens = is_known(c, at, j + 2),
                        .j = j,
                        .t1 = pma_instant(c, j + 2, at->substeps),
                        .step = c->step_count * (int64_t)at->substeps + (int64_t)j + 1,
                        .row = PMA_NO_ROW};
    if (at->job.opens)
        at->opened = j + 2;
}

/* Energies are summed up in the order of the steps, one after the other. */
static bool keeps_no_books(const pma_coupler *c)
{
    return !(c->record && c->record->energy);
}

/* Stands at a node with one step opened, of two that could be? */
static bool could_open(const pma_coupler *c, const pma_place *at)
{
    return keeps_no_books(c) && at->phase == 0 && pma_is_double(c, at) &&
           at->opened == at->j + 1 && is_known(c, at, at->j + 2);
}

void pma_ahead_open(pma_coupler *c)
{
    for (size_t w = c->roster.fine; w < c->roster.workers; w++) {
        bool any = false;
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++) {
            pma_place *at = place_of(c, i);
            if (!could_open(c, at))
                continue;
            if (!any)
                await(c, w);
            prepare(c, at, at->j, false);
            any = true;
        }
        if (any)
            pma_team_post(c->team, w, go_ahead, c);
    }
}

/* Awaits those that reach a node now; if a macro step waits to be committed, all. */
static bool await_arriving(pma_coupler *c)
{
    bool any = false;
    for (size_t w = c->roster.fine; w < c->roster.workers; w++) {
        bool arriving = false;
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++)
            arriving = arriving || arrives(place_of(c, i));
        if (arriving)
            await(c, w);
        any = any || arriving;
    }
    if (any && c->pending)
        await_all(c);
    return any;
}

/* A jump that is recorded in the middle of a macro step wants all states at once. */
static bool records_jumps(const pma_coupler *c)
{
    return c->record && c->record->every == 0;
}

/* A closing may wait: not beyond the end of a call, nor where others could not take a step back,
 * for a restoring force is asked once for every step of the macro steps that are completed. */
static bool can_wait(const pma_coupler *c, const pma_place *at)
{
    if (!keeps_no_books(c) || !pma_is_double(c, at))
        return false;
    if (at->j + 1 < at->substeps)
        return !records_jumps(c);
    return !c->restored && c->step_count + 1 < c->end;
}

/* The step that ends at the next node of place `number` is left to its worker. */
static void leave(pma_coupler *c, size_t number)
{
    pma_place *at = &c->places[number];
    const size_t node = at->j + 1;
    prepare(c, at, node, true);
    at->late = true;
    memcpy(at->lam, c->lam_work, c->parts.p * sizeof(double));
    const pma_record_nodes *nodes = c->record ? &c->record->nodes[number] : NULL;
    if (nodes && nodes->count + nodes->springs > 0) {
        at->job.nodes = nodes;
        at->job.row = pma_row(c, node, at->substeps);
    }
}

static bool has_failed(const pma_coupler *c)
{
    for (size_t i = c->roster.begin[c->roster.fine]; i < c->parts.count; i++) {
        const pma_job *job = &place_of(c, i)->job;
        if (!job->running && job->status != PMA_OK)
            return true;
    }
    return false;
}

pma_status pma_ahead_close(pma_coupler *c)
{
    if (!await_arriving(c))
        return PMA_OK;
    c->failed = PMA_INTERFACE;
    if (has_failed(c))
        return PMA_NOT_FINITE; /* settled by the caller */
    if (c->pending)
        pma_coupler_commit(c);
    for (size_t w = c->roster.fine; w < c->roster.workers; w++) {
        bool any = false;
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++) {
            if (!arrives(place_of(c, i)) || !can_wait(c, place_of(c, i)))
                continue;
            leave(c, c->roster.order[i]);
            any = true;
        }
        if (any)
            pma_team_post(c->team, w, go_ahead, c);
    }
    return PMA_OK;
}

bool pma_ahead_is_late(const pma_coupler *c)
{
    for (size_t i = c->roster.begin[c->roster.fine]; i < c->parts.count; i++) {
        if (place_of(c, i)->late)
            return true;
    }
    return false;
}

pma_status pma_ahead_settle(pma_coupler *c, pma_status status)
{
    size_t first = status == PMA_STOPPED ? SIZE_MAX : c->k;
    await_all(c);
    for (size_t number = 0; number < c->parts.count; number++) {
        const pma_place *at = &c->places[number];
        const size_t k = at->job.j * at->ratio;
        if (at->job.status == PMA_OK || k > first || (k == first && number > c->failed))
            continue;
        first = k;
        c->failed = number;
        status = status == PMA_STOPPED ? status : at->job.status;
    }
    if (c->pending && first > c->fine)
        pma_coupler_commit(c);
    c->pending = false;
    return status;
}
