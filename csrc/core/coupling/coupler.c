#include "coupling/coupler.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coupling/schedule.h"
#include "workers/thread.h"

/* ---- checks --------------------------------------------------------------------------------- */

/* h substeps = dt > 0, but for the rounding of dt / substeps and of the product */
static bool has_step(const pma_member *member, double dt)
{
    return dt > 0.0 && fabs(member->h * (double)member->substeps - dt) <= 4.0 * DBL_EPSILON * dt;
}

static pma_status check_members(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->count; i++) {
        if (parts->members[i].link->p != parts->p)
            return PMA_BAD_SIZE;
    }
    const pma_status status = parts->schedule->check(parts);
    for (size_t i = 0; i < parts->count && status == PMA_OK; i++) {
        if (!has_step(&parts->members[i], parts->dt))
            return PMA_BAD_STEP;
    }
    return status;
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

static void lay_out(pma_coupler *c, const pma_coupler_parts *parts)
{
    const size_t p = c->parts.p;
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        const size_t ratio = c->fine / member->substeps;
        c->coupled[i] = (pma_coupled){
            .member = *member,
            .ratio = ratio > 0 ? ratio : 1,
            .first_double = pma_clock_first_double(member->doubling, member->substeps)};
        c->evaluates = c->evaluates || member->forces != PMA_NO_FORCES;
        c->entries += (member->entries + c->coupled[i].ratio - 1) / c->coupled[i].ratio;
    }
    double *next = c->block;
    pma_macro_level *const levels[3] = {&c->present, &c->reached, &c->working};
    for (size_t i = 0; i < 3; i++, next += 3 * p)
        *levels[i] = (pma_macro_level){.lam = next, .g = next + p, .d = next + 2 * p};
    c->scratch = next;
    c->dlam = next + p;
    c->lam_end = next + 2 * p;
    c->lam_before = next + 3 * p;
    c->lengths = next + 4 * p;
    c->sums = next + 4 * p + 2;
}

static pma_status allocate(pma_coupler *c, const pma_coupler_parts *parts)
{
    c->coupled = calloc(parts->count + 1, sizeof *c->coupled);
    c->motions = calloc(parts->motion_count + 1, sizeof *c->motions);
    c->block = calloc(14 * parts->p + 3, sizeof(double));
    if (!c->coupled || !c->motions || !c->block)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < parts->motion_count; i++)
        c->motions[i] = parts->motions[i];
    c->parts.motions = c->motions;
    c->parts.members = NULL; /* c->coupled has them */
    c->own = c->coupled;
    c->end_of_own = c->coupled + parts->count;
    return PMA_OK;
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
    const size_t most = c->parts.threads < PMA_MOST_WORKERS ? c->parts.threads : PMA_MOST_WORKERS;
    const size_t count = (size_t)(c->end_of_own - c->own);
    pma_duty *duties = calloc(count + 1, sizeof *duties);
    if (!duties)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < count; i++) {
        duties[i] = c->parts.schedule->duty(&c->own[i].member);
        duties[i].parallel = duties[i].parallel && ahead;
    }
    const pma_status status =
        pma_roster_create(count, duties, most > 0 ? most : 1, c->parts.worthwhile, &c->roster);
    free(duties);
    for (size_t w = 0; status == PMA_OK && w < c->roster.workers; w++) {
        for (size_t i = c->roster.begin[w]; i < c->roster.begin[w + 1]; i++)
            pma_member_of(c, i)->worker = w;
    }
    if (status == PMA_OK && c->roster.split != PMA_NO_SPLIT) {
        c->split = &c->own[c->roster.split];
        c->workers = pma_teamwork_workers(c);
        c->split->workers = &c->workers;
    }
    return status;
}

/* Room for what the schedule and the roster do with every member. */
static pma_status prepare_members(pma_coupler *c)
{
    const bool ahead = pma_look_ahead_is_used(c);
    pma_status status = PMA_OK;
    for (pma_coupled *m = c->own; m < c->end_of_own && status == PMA_OK; m++) {
        m->ahead = ahead;
        if (ahead || m->workers)
            status =
                m->member.table->prepare(m->member.self, ahead, m->workers ? m->workers->count : 1);
    }
    return status;
}

static pma_status create_team(pma_coupler *c)
{
    pma_status status = make_roster(c);
    if (status == PMA_OK && pma_look_ahead_is_used(c))
        status = pma_look_ahead_create(c);
    if (status == PMA_OK)
        status = prepare_members(c);
    if (status != PMA_OK || c->roster.workers == 1)
        return status;
    return pma_team_create(c->roster.workers, &c->team);
}

static pma_status prepare(pma_coupler *c, const pma_coupler_parts *parts)
{
    c->parts.iteration = NULL; /* c->iteration has it */
    const pma_status status =
        parts->schedule->prepare ? parts->schedule->prepare(c, parts->iteration) : PMA_OK;
    c->parts.contact = NULL; /* c->contact has it */
    return status;
}

pma_status pma_coupler_create(const pma_coupler_parts *parts, pma_coupler **out)
{
    *out = NULL;
    if (parts->H_start.p != parts->p || parts->H.p != parts->p)
        return PMA_BAD_SIZE;
    pma_status status = check_members(parts);
    if (status == PMA_OK)
        status = check_motions(parts->motion_count, parts->motions, parts->p);
    if (status != PMA_OK)
        return status;

    pma_coupler *c = calloc(1, sizeof *c);
    if (!c)
        return PMA_NO_MEMORY;
    c->parts = *parts;
    c->fine = parts->schedule->instants(parts);
    status = allocate(c, parts);
    if (status == PMA_OK) {
        lay_out(c, parts);
        status = prepare(c, parts);
    }
    if (status == PMA_OK)
        status = pma_exchange_create(c, parts->exchange);
    if (status == PMA_OK)
        status = create_team(c);
    if (status != PMA_OK) {
        pma_coupler_destroy(c);
        return status;
    }
    *out = c;
    return PMA_OK;
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
    free(c->lam_deferred);
    free(c->coupled);
    free(c->motions);
    free(c->block);
    free(c);
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
    memset(c->present.d, 0, c->parts.p * sizeof(double));
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

double *pma_coupler_displacement_jump(pma_coupler *c, size_t *size)
{
    *size = c->parts.p;
    return c->present.d;
}

double *pma_coupler_end_multipliers(pma_coupler *c, size_t *size)
{
    *size = 2 * c->parts.p + 2;
    return c->lam_end;
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

static bool is_any_observed(const pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        if (pma_member_is_observed(&c->coupled[i].member))
            return true;
    }
    return false;
}

static void begin(pma_coupler *c, int64_t steps, const pma_record *record, const pma_poll *poll)
{
    c->record = record;
    c->poll = poll;
    c->end = c->present.number + steps;
    c->observed = is_any_observed(c);
    atomic_store(&c->stopped, false);
}

pma_status pma_coupler_meet(pma_coupler *c, pma_status status)
{
    return pma_exchange_present(c, status == PMA_OK && !c->started ? PMA_NOT_READY : status);
}

static void end_piece(pma_coupler *c)
{
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

pma_status pma_coupler_advance(pma_coupler *c, int64_t steps, const pma_record *record,
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
