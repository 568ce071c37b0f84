#include "couple/coupler.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/lists.h"
#include "couple/inside.h"
#include "memory.h"
#include "object.h"
#include "workers/denormals.h"
#include "workers/thread.h"

/* ---- checks --------------------------------------------------------------------------------- */

/* h substeps = dt > 0, but for the rounding of dt / substeps and of the product */
static bool has_step(const pma_member *member, double dt)
{
    return dt > 0.0 && fabs(member->h * (double)member->substeps - dt) <= 4.0 * DBL_EPSILON * dt;
}

/* Does it what the schedule calls? */
static bool fits(const pma_member *member, const pma_schedule *schedule)
{
    const bool pushes = schedule->tie && !schedule->tie->ramps;
    return (schedule->internal || !member->has_internal) &&
           (schedule->iterates || !member->iterated.table) &&
           (member->elsewhere || pushes == (member->table->push != NULL));
}

/* Schemes of two stages were derived for fine steps of one process. */
static bool can_be_staged(const pma_coupler_parts *parts)
{
    return parts->schedule->fine_step && !parts->contact && !parts->exchange;
}

static pma_status check_members(const pma_coupler_parts *parts)
{
    if (pma_parts_are_staged(parts) && !can_be_staged(parts))
        return PMA_BAD_SIZE;
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        if (member->link->p != parts->p || !fits(member, parts->schedule))
            return PMA_BAD_SIZE;
    }
    PMA_TRY(parts->schedule->check(parts));
    for (size_t i = 0; i < parts->count; i++) {
        if (!has_step(&parts->members[i], parts->dt))
            return PMA_BAD_STEP;
    }
    return PMA_OK;
}

/* PMA_BAD_SIZE when a motion has more rows than p, PMA_BAD_INDEX unless they are in 0..p-1. */
static pma_status check_motions(size_t count, const pma_motion *motions, size_t p)
{
    for (size_t i = 0; i < count; i++) {
        const pma_motion *motion = &motions[i];
        if (motion->load.n > p)
            return PMA_BAD_SIZE;
        for (size_t k = 0; k < motion->load.n; k++) {
            if (motion->rows[k] < 0 || (size_t)motion->rows[k] >= p)
                return PMA_BAD_INDEX;
        }
    }
    return PMA_OK;
}

/* ---- making --------------------------------------------------------------------------------- */

/* The coupler with its arrays. What mean coupling ends with is one, of which others are parts. */
static pma_coupler *allocate(const pma_coupler_parts *parts)
{
    const size_t p = parts->p;
    const pma_array arrays[] = {PMA_ARRAY(pma_coupler, coupled, parts->count + 1),
                                PMA_ARRAY(pma_coupler, motions, parts->motion_count),
                                PMA_ARRAY(pma_coupler, present.lam, p),
                                PMA_ARRAY(pma_coupler, present.g, p),
                                PMA_ARRAY(pma_coupler, present.moved, p),
                                PMA_ARRAY(pma_coupler, reached.lam, p),
                                PMA_ARRAY(pma_coupler, reached.g, p),
                                PMA_ARRAY(pma_coupler, reached.moved, p),
                                PMA_ARRAY(pma_coupler, working.lam, p),
                                PMA_ARRAY(pma_coupler, working.g, p),
                                PMA_ARRAY(pma_coupler, working.moved, p),
                                PMA_ARRAY(pma_coupler, scratch, p),
                                PMA_ARRAY(pma_coupler, dlam, p),
                                PMA_ARRAY(pma_coupler, lam_end, 2 * p + 2),
                                PMA_ARRAY(pma_coupler, sums, p),
                                {0}};
    pma_coupler *c = pma_object_create(sizeof *c, arrays);
    if (c) {
        c->lam_before = c->lam_end + p;
        c->lengths = c->lam_before + p;
    }
    return c;
}

static void take_parts(pma_coupler *c, const pma_coupler_parts *parts)
{
    c->parts = *parts;
    c->fine = parts->schedule->instants(parts);
    c->staged = pma_parts_are_staged(parts);
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        const size_t ratio = pma_most(c->fine / member->substeps, 1);
        c->coupled[i] = (pma_coupled){
            .member = *member,
            .ratio = ratio,
            .in_stages = c->staged,
            .first_double = pma_clock_first_double(member->doubling, member->substeps)};
        c->evaluates = c->evaluates || member->forces != PMA_NO_FORCES;
        c->entries += (member->entries + ratio - 1) / ratio;
    }
    for (size_t i = 0; i < parts->motion_count; i++)
        c->motions[i] = parts->motions[i];
    c->parts.motions = c->motions;
    c->parts.members = NULL; /* c->coupled has them */
    c->own = c->coupled;
    c->end_of_own = c->coupled + parts->count;
}

/* Can every member go on before the macro step is committed? Only then can one be left beside the
 * fine steps. */
static bool all_look_ahead(const pma_coupler *c)
{
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        if (!m->member.table->is_known)
            return false;
    }
    return true;
}

/* Which worker has what. */
static pma_status make_roster(pma_coupler *c)
{
    const bool ahead = all_look_ahead(c);
    const size_t workers = pma_most(pma_least(c->parts.threads, PMA_MOST_WORKERS), 1);
    const size_t count = (size_t)(c->end_of_own - c->own);
    pma_duty *duties = pma_memory_allocate(count + 1, sizeof *duties);
    if (!duties)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < count; i++) {
        duties[i] = c->parts.schedule->duty(&c->own[i].member);
        duties[i].parallel = duties[i].parallel && ahead;
    }
    const pma_status status =
        pma_roster_create(count, duties, workers, c->parts.worthwhile, &c->roster);
    pma_memory_release(duties);
    PMA_TRY(status);
    for (size_t w = 0; w < c->roster.workers; w++) {
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++)
            pma_member_of(c, i)->worker = w;
    }
    if (c->roster.split != PMA_NO_SPLIT) {
        c->split = &c->own[c->roster.split];
        c->workers = pma_teamwork_workers(c);
        c->split->workers = &c->workers;
    }
    return PMA_OK;
}

/* Room for two macro steps, where the next one begins before the last one is committed. */
static pma_status prepare_members(pma_coupler *c)
{
    const bool ahead = pma_look_ahead_is_used(c);
    for (pma_coupled *m = c->own; m < c->end_of_own; m++) {
        m->ahead = ahead;
        if (ahead)
            PMA_TRY(m->member.table->prepare(m->member.self));
    }
    return PMA_OK;
}

static pma_status create_team(pma_coupler *c)
{
    PMA_TRY(make_roster(c));
    if (pma_look_ahead_is_used(c))
        PMA_TRY(pma_look_ahead_create(c));
    PMA_TRY(prepare_members(c));
    c->has_executors = c->exchange || pma_look_ahead_is_used(c);
    return c->roster.workers > 1 ? pma_team_create(c->roster.workers, &c->team) : PMA_OK;
}

/* What schedule, exchange and contact need is then theirs. */
static pma_status prepare(pma_coupler *c, const pma_coupler_parts *parts)
{
    if (parts->schedule->prepare)
        PMA_TRY(parts->schedule->prepare(c, parts->iteration));
    c->parts.iteration = NULL;
    c->parts.contact = NULL;
    PMA_TRY(pma_exchange_create(c, parts->exchange));
    return create_team(c);
}

pma_status pma_coupler_create(const pma_coupler_parts *parts, pma_coupler **out)
{
    *out = NULL;
    if (parts->H_start.p != parts->p || parts->H.p != parts->p)
        return PMA_BAD_SIZE;
    PMA_TRY(check_members(parts));
    PMA_TRY(check_motions(parts->motion_count, parts->motions, parts->p));
    pma_coupler *c = allocate(parts);
    if (!c)
        return PMA_NO_MEMORY;
    take_parts(c, parts);
    const pma_status status = prepare(c, parts);
    if (status == PMA_OK)
        *out = c;
    else
        pma_coupler_destroy(c);
    return status;
}

void pma_coupler_destroy(pma_coupler *c)
{
    if (!c)
        return;
    pma_team_destroy(c->team);
    pma_roster_destroy(&c->roster);
    pma_iteration_destroy(c->iteration);
    pma_exchange_destroy(c->exchange);
    pma_contact_destroy(c->contact);
    pma_memory_release(c->lam_deferred);
    pma_memory_release(c);
}

/* ---- what it knows -------------------------------------------------------------------------- */

void pma_coupler_set_motion(pma_coupler *c, size_t i, pma_load load)
{
    assert(i < c->parts.motion_count && load.n == c->motions[i].load.n);
    c->motions[i].load = load;
}

void pma_coupler_set_origin(pma_coupler *c, int64_t number, double t)
{
    c->origin = (pma_origin){.number = number, .t = t};
}

void pma_coupler_set_pace(pma_coupler *c, pma_pace *pace)
{
    c->pace = pace;
}

void pma_coupler_start(pma_coupler *c, int64_t step_count, const double *lam, const double *g)
{
    assert(step_count >= c->origin.number);
    memcpy(c->present.lam, lam, c->parts.p * sizeof(double));
    memcpy(c->present.g, g, c->parts.p * sizeof(double));
    memset(c->working.g, 0, c->parts.p * sizeof(double)); /* of rows that nothing prescribes */
    memset(c->present.moved, 0, c->parts.p * sizeof(double));
    c->present.number = c->reached.number = step_count - c->origin.number;
    c->k = 0;
    for (int64_t i = 0; i < 2; i++)
        c->lengths[i] = c->present.number > i ? c->parts.dt : 0.0;
    c->started = true;
    if (c->iteration)
        pma_iteration_start(c->iteration);
}

size_t pma_coupler_instants(const pma_coupler *c)
{
    return c->fine;
}

int64_t pma_coupler_step_count(const pma_coupler *c)
{
    return c->origin.number + c->present.number;
}

int64_t pma_coupler_origin(const pma_coupler *c)
{
    return c->origin.number;
}

int64_t pma_coupler_most_steps(const pma_coupler *c)
{
    size_t most = c->fine;
    for (size_t i = 0; i < c->parts.count; i++) {
        const size_t substeps = c->coupled[i].member.substeps;
        most = substeps > most ? substeps : most;
    }
    return PMA_MOST_STEPS / (int64_t)most;
}

/* Does the team have to prove itself? Not where the user has said how many, where steps begin at
 * times of a clock, or where other processes are waited for. */
static bool is_tried(const pma_coupler *c)
{
    return c->team && c->parts.worthwhile && !c->pace && !c->exchange;
}

size_t pma_coupler_threads(const pma_coupler *c)
{
    return is_tried(c) && c->trial.chosen ? 1 : c->roster.workers;
}

size_t pma_coupler_worker(const pma_coupler *c, size_t i)
{
    return c->split == &c->coupled[i] ? PMA_ALL_WORKERS : c->coupled[i].worker;
}

const double *pma_coupler_multipliers(const pma_coupler *c)
{
    return c->present.lam;
}

const double *pma_coupler_prescribed(const pma_coupler *c)
{
    return c->present.g;
}

size_t pma_coupler_failed(const pma_coupler *c)
{
    return c->failed;
}

/* An array without counts. */
static pma_state_array real_array(const char *name, size_t count, double *values)
{
    return (pma_state_array){.name = name, .count = count, .values = values};
}

size_t pma_coupler_arrays(pma_coupler *c, pma_state_array out[PMA_COUPLER_ARRAYS])
{
    const size_t p = c->parts.p;
    size_t count = 0;
    out[count++] = real_array("multipliers", p, c->present.lam);
    out[count++] = real_array("prescribed", p, c->present.g);
    if (c->parts.motion_count > 0)
        out[count++] = real_array("moved", p, c->present.moved);
    out[count++] = real_array("end_multipliers", 2 * p + 2, c->lam_end);
    if (c->iteration && c->iteration->size > 0)
        out[count++] = pma_iteration_array(c->iteration);
    if (c->contact)
        out[count++] = pma_contact_array(c);
    return count;
}

const pma_coupler_parts *pma_coupler_get_parts(const pma_coupler *c)
{
    return &c->parts;
}

/* ---- macro steps ---------------------------------------------------------------------------- */

/* All members have arrived at the end of a macro step. It is committed, or waits for the members
 * that are closed beside the fine steps. */
static void reach(pma_coupler *c)
{
    assert(!pma_is_pending(c));
    pma_macro_level_swap(&c->reached, &c->working);
    c->reached.number = c->present.number + 1;
    if (!pma_look_ahead_is_used(c) || !pma_look_ahead_is_busy(c))
        pma_coupler_commit(c);
}

/* Back to the present, with nothing open, after what ended the macro step at hand. */
static void abandon(pma_coupler *c)
{
    for (pma_coupled *m = c->own; m < c->end_of_own; m++) {
        m->assigned = (pma_assignment){.closes = false};
        m->member.table->discard(m->member.self);
    }
    c->reached.number = c->present.number;
    c->k = 0;
}

static bool is_observed(const pma_coupled *m)
{
    return pma_member_is_observed(&m->member);
}

static void begin(pma_coupler *c, int64_t steps, const pma_record *record, const pma_poll *poll)
{
    c->record = record && pma_recorder_begin(c, record) ? record : NULL;
    c->poll = poll;
    c->end = c->present.number + steps;
    c->observed = pma_coupler_has(c, is_observed);
    atomic_store(&c->stopped, false);
}

pma_status pma_coupler_meet(pma_coupler *c, pma_status status)
{
    return pma_exchange_present(c, status == PMA_OK && !c->started ? PMA_NOT_READY : status);
}

static void end_piece(pma_coupler *c)
{
    assert(c->team);
    pma_trial_end_piece(&c->trial, pma_timer_now());
    pma_team_let_alone(c->team, c->trial.alone);
}

/* A macro step, up to where all have arrived at its end. */
static pma_status take_step(pma_coupler *c)
{
    if (!c->exchange)
        return c->parts.schedule->step(c);
    pma_exchange_begin(c);
    const pma_status status = c->parts.schedule->step(c);
    /* what failed beside the fine steps is known before the processes meet again */
    return pma_exchange_agree(c, status == PMA_OK ? status : pma_look_ahead_end(c, status));
}

static pma_status advance(pma_coupler *c, int64_t steps, const pma_record *record,
                          const pma_poll *poll)
{
    pma_status status = c->started ? PMA_OK : PMA_NOT_READY;
    if (c->team && steps > 0 && status == PMA_OK)
        status = pma_team_gather(c->team);
    begin(c, steps, record, poll);
    const bool tried = is_tried(c);
    if (tried)
        pma_trial_begin(&c->trial, pma_timer_now());
    if (c->team)
        pma_team_let_alone(c->team, tried && c->trial.alone);
    if (c->exchange && steps > 0)
        status = pma_exchange_present(c, status);
    for (int64_t step = 0; step < steps && status == PMA_OK; step++) {
        if (record && record->ring)
            pma_record_begin(record, c->origin.number + c->reached.number);
        status = take_step(c);
        if (status == PMA_OK) {
            reach(c);
            if (tried)
                end_piece(c);
        } else {
            status = c->exchange ? status : pma_look_ahead_end(c, status);
            abandon(c);
        }
    }
    /* whatever else went wrong; the poll of the last wait may have said stop when all was done */
    return atomic_load(&c->stopped) ? PMA_STOPPED : status;
}

pma_status pma_coupler_advance(pma_coupler *c, int64_t steps, const pma_record *record,
                               const pma_poll *poll)
{
    assert(steps >= 0);
    const pma_denormals before = pma_denormals_flush();
    const pma_status status = advance(c, steps, record, poll);
    pma_denormals_restore(before);
    return status;
}

/* ---- a loop outside ------------------------------------------------------------------------- */

static pma_status take(pma_coupler *c)
{
    if (!c->parts.schedule->fine_step)
        return advance(c, 1, NULL, NULL);
    if (!c->started)
        return PMA_NOT_READY;
    if (c->k == 0)
        begin(c, 1, NULL, NULL);
    const pma_status status = pma_fine_take(c);
    if (status != PMA_OK)
        abandon(c);
    else if (c->k == c->fine)
        reach(c);
    return status;
}

pma_status pma_coupler_take(pma_coupler *c)
{
    assert(!c->team && !c->exchange && !pma_look_ahead_is_used(c));
    const pma_denormals before = pma_denormals_flush();
    const pma_status status = take(c);
    pma_denormals_restore(before);
    return status;
}

void pma_coupler_discard(pma_coupler *c)
{
    abandon(c);
}

size_t pma_coupler_fine_done(const pma_coupler *c)
{
    return c->k;
}

double pma_coupler_time(const pma_coupler *c)
{
    return pma_clock_stage_time(c->origin.t, c->parts.dt, c->present.number, c->k, c->fine,
                                c->staged);
}

bool pma_coupler_coming(const pma_coupler *c, size_t i, pma_substep *out)
{
    const pma_coupled *m = &c->coupled[i];
    const pma_moment next = pma_clock_moment(c->k + 1, m->ratio);
    *out = pma_substep_of(c, m, next.j);
    return next.phase == 1;
}
