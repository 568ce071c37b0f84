#include "coupling/schedule.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- making ----------------------------------------------------------------------------- */

static pma_status check_subdomains(const pma_coupler_parts *parts, size_t fine)
{
    for (size_t i = 0; i < parts->count; i++) {
        const pma_parts *s = pma_subdomain_parts(parts->subdomains[i]);
        if (fine % s->substeps != 0 && !parts->macro)
            return PMA_BAD_SIZE;
        if (parts->macro && s->substeps > 1 && (s->doubled || !s->ramped))
            return PMA_BAD_SIZE;
        if (s->link.p != parts->p)
            return PMA_BAD_SIZE;
    }
    return PMA_OK;
}

static pma_status check_interface(const pma_coupler_parts *parts, const pma_factor *H)
{
    if (H->n != parts->p || H->nb != parts->p)
        return PMA_BAD_SIZE;
    return pma_factor_check(H);
}

static size_t most_substeps(const pma_coupler_parts *parts)
{
    size_t most = 1;
    for (size_t i = 0; i < parts->count; i++) {
        const size_t substeps = pma_subdomain_parts(parts->subdomains[i])->substeps;
        most = substeps > most ? substeps : most;
    }
    return most;
}

static pma_status check_motions(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->motion_count; i++) {
        const pma_motion *motion = &parts->motions[i];
        if (motion->load.n > parts->p)
            return PMA_BAD_SIZE;
        for (size_t k = 0; k < motion->load.n; k++) {
            if (motion->rows[k] < 0 || (size_t)motion->rows[k] >= parts->p)
                return PMA_BAD_INDEX;
        }
    }
    return PMA_OK;
}

static void lay_out(pma_coupler *c, pma_subdomain *const *subdomains, const pma_motion *motions)
{
    const size_t p = c->parts.p;
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_parts *s = pma_subdomain_parts(subdomains[i]);
        c->places[i] = (pma_place){.subdomain = subdomains[i],
                                   .substeps = s->substeps,
                                   .ratio = c->fine / s->substeps,
                                   .entries = pma_subdomain_entries(subdomains[i]),
                                   .doubled = s->doubled};
        c->restored = c->restored || s->restoring.function;
    }
    for (size_t i = 0; i < c->parts.motion_count; i++)
        c->parts.motions[i] = motions[i];
    c->lam = c->block;
    c->lam_work = c->block + p;
    c->g = c->block + 2 * p;
    c->g_work = c->block + 3 * p;
    c->motion = c->block + 4 * p;
    c->dlam = c->block + 5 * p;
    c->lam_reached = c->block + 6 * p;
    c->g_reached = c->block + 7 * p;
}

/* Under macro coupling a subdomain does all its own steps at once, and twice. */
static pma_duty duty_of(const pma_coupler *c, const pma_place *at)
{
    const pma_restoring *restoring = &pma_subdomain_parts(at->subdomain)->restoring;
    pma_duty duty = {.entries = at->entries,
                     .substeps = at->substeps,
                     .by_caller = restoring->function && restoring->by_caller,
                     .aside = at->doubled && !restoring->function,
                     .divides = pma_subdomain_divides(at->subdomain)};
    if (c->parts.macro) {
        const bool repeats = at->substeps > 1 && !pma_subdomain_is_stored(at->subdomain);
        duty.entries *= at->substeps * (repeats ? 2 : 1);
        duty.substeps = 1;
        duty.aside = false;
        duty.divides = false;
    }
    return duty;
}

/* Room for going on before a macro step is committed, and multipliers to do it with. */
static pma_status look_ahead(pma_coupler *c)
{
    const size_t first = c->roster.begin[c->roster.fine], p = c->parts.p;
    c->lam_late = calloc((c->parts.count - first) * p + 1, sizeof(double));
    if (!c->lam_late)
        return PMA_NO_MEMORY;
    for (size_t i = first; i < c->parts.count; i++)
        c->places[c->roster.order[i]].lam = c->lam_late + (i - first) * p;
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_status status = pma_subdomain_look_ahead(c->places[i].subdomain);
        if (status != PMA_OK)
            return status;
    }
    return PMA_OK;
}

/* Who does what, and a team of so many. */
static pma_status hire(pma_coupler *c)
{
    const size_t most = c->parts.threads < PMA_MOST_WORKERS ? c->parts.threads : PMA_MOST_WORKERS;
    pma_duty *duties = calloc(c->parts.count + 1, sizeof *duties);
    if (!duties)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < c->parts.count; i++)
        duties[i] = duty_of(c, &c->places[i]);
    pma_status status = pma_roster_create(c->parts.count, duties, most > 0 ? most : 1,
                                          c->parts.worthwhile, &c->roster);
    free(duties);
    for (size_t i = 0; status == PMA_OK && i < c->roster.begin[1]; i++)
        c->places[c->roster.order[i]].mine = true;
    if (status == PMA_OK && c->roster.split != PMA_NO_SPLIT)
        c->places[c->roster.split].split = true;
    if (status == PMA_OK && c->roster.fine < c->roster.workers)
        status = look_ahead(c);
    if (status != PMA_OK || c->roster.workers == 1)
        return status;
    return pma_team_create(c->roster.workers, &c->team);
}

pma_status pma_coupler_create(const pma_coupler_parts *parts, pma_coupler **out)
{
    *out = NULL;
    const size_t fine = most_substeps(parts);
    pma_status status = check_subdomains(parts, fine);
    if (status || (status = check_interface(parts, &parts->H_start)) ||
        (status = check_interface(parts, &parts->H)) || (status = check_motions(parts)))
        return status;

    pma_coupler *c = calloc(1, sizeof *c);
    if (!c)
        return PMA_NO_MEMORY;
    c->parts = *parts;
    c->fine = parts->macro ? 1 : fine;
    c->parts.subdomains = NULL; /* places keep them */
    c->interface_entries = 2 * pma_factor_entries(&parts->H);
    c->places = calloc(parts->count + 1, sizeof *c->places);
    c->parts.motions = calloc(parts->motion_count + 1, sizeof *c->parts.motions);
    c->block = calloc(8 * parts->p + 1, sizeof(double));
    if (!c->places || !c->parts.motions || !c->block) {
        pma_coupler_destroy(c);
        return PMA_NO_MEMORY;
    }
    lay_out(c, parts->subdomains, parts->motions);
    status = hire(c);
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
    free(c->lam_late);
    free(c->places);
    free(c->parts.motions);
    free(c->block);
    free(c);
}

void pma_coupler_set_motion(pma_coupler *c, size_t i, pma_load load)
{
    assert(i < c->parts.motion_count && load.n == c->parts.motions[i].load.n);
    c->parts.motions[i].load = load;
}

void pma_coupler_start(pma_coupler *c, int64_t step_count, const double *lam, const double *g)
{
    memcpy(c->lam, lam, c->parts.p * sizeof(double));
    memcpy(c->g, g, c->parts.p * sizeof(double));
    c->step_count = step_count;
    c->started = true;
}

size_t pma_coupler_instants(const pma_coupler *c)
{
    return c->fine;
}

int64_t pma_coupler_step_count(const pma_coupler *c)
{
    return c->step_count;
}

int64_t pma_coupler_most_steps(const pma_coupler *c)
{
    size_t most = c->fine;
    for (size_t i = 0; i < c->parts.count; i++)
        most = c->places[i].substeps > most ? c->places[i].substeps : most;
    return PMA_MOST_STEPS / (int64_t)most;
}

size_t pma_coupler_threads(const pma_coupler *c)
{
    return c->roster.workers;
}

const double *pma_coupler_multipliers(const pma_coupler *c)
{
    return c->lam;
}

const double *pma_coupler_prescribed(const pma_coupler *c)
{
    return c->g;
}

size_t pma_coupler_failed(const pma_coupler *c)
{
    return c->failed;
}

const pma_coupler_parts *pma_coupler_get_parts(const pma_coupler *c)
{
    return &c->parts;
}

/* ---- sharing the work ------------------------------------------------------------------------ */

/* The first that goes wrong ends a worker's share. Shares are in ascending order, so that what went
 * wrong first of all is found whoever has it. */
static void work_through(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        pma_place *at = &c->places[c->roster.order[i]];
        const pma_status status = c->due(at) && !at->split ? c->task(c, at) : PMA_OK;
        if (status != PMA_OK) {
            at->status = status;
            return;
        }
    }
}

static bool has_work(const pma_coupler *c, size_t worker)
{
    for (size_t i = c->roster.begin[worker]; i < c->roster.begin[worker + 1]; i++) {
        const pma_place *at = &c->places[c->roster.order[i]];
        if (c->due(at) && !at->split)
            return true;
    }
    return false;
}

/* What went wrong first in the order of the subdomains, and nothing any more. */
static pma_status take_status(pma_coupler *c)
{
    pma_status first = PMA_OK;
    for (size_t i = c->parts.count; i-- > 0;) {
        if (c->places[i].status == PMA_OK)
            continue;
        first = c->places[i].status;
        c->places[i].status = PMA_OK;
        c->failed = i;
    }
    return first;
}

pma_status pma_coupler_share(pma_coupler *c, pma_task task, bool (*due)(const pma_place *))
{
    c->task = task;
    c->due = due;
    for (size_t w = 1; w < c->roster.workers; w++) {
        if (has_work(c, w))
            pma_team_post(c->team, w, work_through, c);
    }
    work_through(c, 0);
    for (size_t w = 1; w < c->roster.workers; w++)
        pma_team_await_if(c->team, w, work_through);
    return take_status(c);
}

/* ---- the stages of a fine step -------------------------------------------------------------- */

static bool begins(const pma_place *at)
{
    return at->phase == 0 && at->opened <= at->j;
}

static bool ends(const pma_place *at)
{
    return at->phase == at->ratio && !at->late;
}

/* Free problem (13) of a subdomain that stands at a node of its own. */
static pma_status open_step(const pma_coupler *c, pma_place *at)
{
    const double t1 = pma_instant(c, at->j + 1, at->substeps);
    const pma_status status =
        pma_subdomain_open(at->subdomain, at->j, pma_is_double(c, at), t1, pma_own_step(c, at));
    if (status == PMA_OK)
        at->opened = at->j + 1;
    return status;
}

/* The one that is split if it is due, by all, then the others, each by its worker. */
static pma_status share_all(pma_coupler *c, pma_task task, bool (*due)(const pma_place *),
                            pma_status (*together)(pma_coupler *, pma_place *))
{
    pma_place *split = c->roster.split == PMA_NO_SPLIT ? NULL : &c->places[c->roster.split];
    if (split && due(split))
        split->status = together(c, split);
    return pma_coupler_share(c, task, due);
}

/* One fine step later: everybody stands in or at the end of an own step. */
static void move_on(pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_place *at = &c->places[i];
        if (at->phase == 0)
            c->unpolled += at->entries;
        at->phase++;
        at->late = false;
    }
}

void pma_coupler_prescribe(pma_coupler *c, size_t k)
{
    const int64_t step = c->step_count * (int64_t)c->fine + (int64_t)k - 1;
    for (size_t i = 0; i < c->parts.motion_count; i++) {
        const pma_motion *motion = &c->parts.motions[i];
        memset(c->motion, 0, motion->load.n * sizeof(double));
        pma_load_add(&motion->load, pma_instant(c, k, c->fine), step, c->motion);
        for (size_t row = 0; row < motion->load.n; row++)
            c->g_work[motion->rows[row]] = c->motion[row];
    }
}

/* The subdomain whose free velocity made the multipliers infinite. */
static size_t find_unstable(const pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        if (!pma_subdomain_free_is_finite(c->places[i].subdomain, c->places[i].j + 1))
            return i;
    }
    return PMA_INTERFACE;
}

pma_status pma_coupler_solve(pma_coupler *c)
{
    pma_factor_interface(c->step_count > 0 ? &c->parts.H : &c->parts.H_start, c->lam_work);
    c->unpolled += c->interface_entries;
    for (size_t row = 0; row < c->parts.p; row++) {
        if (!isfinite(c->lam_work[row])) {
            c->failed = find_unstable(c);
            return PMA_NOT_FINITE;
        }
    }
    return PMA_OK;
}

/* H Lam = g - sum_i L_i vf_i, vf_i interpolated in mid-step                     (15) (18) (G1) */
static pma_status solve_interface(pma_coupler *c)
{
    memcpy(c->lam_work, c->g_work, c->parts.p * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_place *at = &c->places[i];
        const double theta = (double)at->phase / (double)at->ratio;
        pma_subdomain_free_velocity(at->subdomain, at->j, theta, -1.0, c->lam_work);
    }
    return pma_coupler_solve(c);
}

/* Link problem (14) of a subdomain at the end of its own step, added to the free one. */
static pma_status close_step(const pma_coupler *c, pma_place *at)
{
    return pma_subdomain_close(at->subdomain, at->j + 1, pma_is_double(c, at), c->lam_work);
}

/* Those that reached a node stand at it. */
static void arrive(pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_place *at = &c->places[i];
        if (at->phase == at->ratio) {
            at->phase = 0;
            at->j++;
        }
    }
}

/* ---- recording, when everybody has arrived --------------------------------------------------- */

/* sum_i L_i v_i - g from total velocities; in mid-step from interpolated free plus link velocity */
static void velocity_jump(const pma_coupler *c, const double *lam, const double *g, double *jump)
{
    for (size_t row = 0; row < c->parts.p; row++)
        jump[row] = -g[row];
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_place *at = &c->places[i];
        if (at->phase == 0) {
            pma_subdomain_total_velocity(at->subdomain, at->j, jump);
        } else {
            const double theta = (double)at->phase / (double)at->ratio;
            pma_subdomain_free_velocity(at->subdomain, at->j, theta, 1.0, jump);
            pma_subdomain_compliance(at->subdomain, pma_is_double(c, at), lam, jump);
        }
    }
}

/* sum_i L_i u_i at own node `macro` times the substeps: 0 is the present, 1 the end of a step */
static void displacement_jump(const pma_coupler *c, size_t macro, double *jump)
{
    memset(jump, 0, c->parts.p * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_place *at = &c->places[i];
        pma_subdomain_total_displacement(at->subdomain, macro * at->substeps, jump);
    }
}

static void record_subdomains(const pma_coupler *c, const pma_record *record)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_place *at = &c->places[i];
        const size_t kept = record->nodes[i].count + record->nodes[i].springs;
        if (at->phase != 0 || at->late || kept == 0)
            continue;
        const size_t row = pma_row(c, at->j, at->substeps);
        if (row != PMA_NO_ROW)
            pma_record_state(&record->nodes[i], pma_subdomain_at(at->subdomain, at->j), row);
    }
}

/* Of the macro node at which everybody stands. */
static void record_energy(const pma_coupler *c, const pma_record *record, size_t row)
{
    double *out = record->energy + row * c->parts.count * PMA_ENERGIES;
    for (size_t i = 0; i < c->parts.count; i++)
        pma_subdomain_tell_energy(c->places[i].subdomain, c->places[i].j, out + i * PMA_ENERGIES);
}

static void record_macro_node(const pma_coupler *c, const pma_record *record)
{
    const size_t row = pma_row(c, c->k > c->fine ? 2 : 1, 1);
    if (row == PMA_NO_ROW)
        return;
    if (record->energy)
        record_energy(c, record, row);
    if (c->parts.p > 0 && !pma_ahead_is_late(c))
        displacement_jump(c, c->k / c->fine, record->displacement_jump + row * c->parts.p);
}

static void record_interface(const pma_coupler *c, const pma_record *record)
{
    const size_t p = c->parts.p;
    const size_t row = pma_row(c, c->k, c->fine);
    if (p == 0 || row == PMA_NO_ROW)
        return;
    memcpy(record->multipliers + row * p, c->lam_work, p * sizeof(double));
    if (!pma_ahead_is_late(c))
        velocity_jump(c, c->lam_work, c->g_work, record->velocity_jump + row * p);
}

/* What had to wait for those that are closed now: the jumps at the end of the macro step. */
static void record_pending(const pma_coupler *c)
{
    const pma_record *record = c->record;
    const size_t p = c->parts.p, row = pma_row(c, c->fine, c->fine), macro = pma_row(c, 1, 1);
    if (p == 0 || row == PMA_NO_ROW)
        return;
    double *jump = record->velocity_jump + row * p;
    for (size_t i = 0; i < p; i++)
        jump[i] = -c->g_reached[i];
    for (size_t i = 0; i < c->parts.count; i++)
        pma_subdomain_total_velocity(c->places[i].subdomain, c->places[i].substeps, jump);
    displacement_jump(c, 1, record->displacement_jump + macro * p);
}

void pma_coupler_record(const pma_coupler *c, const pma_record *record)
{
    record_subdomains(c, record);
    record_interface(c, record);
    if (c->k % c->fine == 0)
        record_macro_node(c, record);
}

void pma_coupler_record_present(const pma_coupler *c, const pma_record *record)
{
    const size_t p = c->parts.p;
    for (size_t i = 0; i < c->parts.count; i++)
        pma_record_state(&record->nodes[i], pma_subdomain_at(c->places[i].subdomain, 0), 0);
    if (record->energy)
        record_energy(c, record, 0);
    if (p == 0)
        return;
    memcpy(record->multipliers, c->lam, p * sizeof(double));
    velocity_jump(c, c->lam, c->g, record->velocity_jump);
    displacement_jump(c, 0, record->displacement_jump);
}

/* ---- the schedule ---------------------------------------------------------------------------- */

static pma_status fine_step(pma_coupler *c)
{
    /* free problems that begin here */
    pma_status status = share_all(c, open_step, begins, pma_split_open);
    if (status != PMA_OK)
        return status;
    pma_ahead_open(c);
    move_on(c);

    /* interface problem at the end of this fine step */
    pma_coupler_prescribe(c, c->k);
    status = solve_interface(c);
    if (status != PMA_OK)
        return status;

    /* link problems that end here, added */
    status = pma_ahead_close(c);
    if (status != PMA_OK)
        return status;
    status = share_all(c, close_step, ends, pma_split_close);
    arrive(c);
    return status;
}

/* Everybody stands at the present again, with nothing opened, after what ended the macro step. */
static void go_to_present(pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_place *at = &c->places[i];
        at->j = at->phase = at->opened = 0;
        at->late = false;
        at->job = (pma_job){0};
        pma_subdomain_discard(at->subdomain);
    }
}

static void swap(double **a, double **b)
{
    double *kept = *a;
    *a = *b;
    *b = kept;
}

void pma_coupler_commit(pma_coupler *c)
{
    if (c->pending && c->record)
        record_pending(c);
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_place *at = &c->places[i];
        if (c->step_count == 0 && at->doubled && c->parts.rebased && !c->parts.macro)
            pma_subdomain_rebase(at->subdomain, at->substeps, c->lam_work);
        pma_subdomain_commit(at->subdomain);
        at->j -= at->substeps;
        at->opened = pma_subdomain_opened(at->subdomain);
    }
    swap(&c->lam, c->pending ? &c->lam_reached : &c->lam_work);
    swap(&c->g, c->pending ? &c->g_reached : &c->g_work);
    c->pending = false;
    c->k -= c->fine;
    c->step_count++;
}

/* All have arrived at the end of a macro step: it becomes the present, or waits for that. */
static void complete(pma_coupler *c)
{
    if (!pma_ahead_is_late(c)) {
        pma_coupler_commit(c);
        return;
    }
    c->pending = true;
    swap(&c->lam_reached, &c->lam_work);
    swap(&c->g_reached, &c->g_work);
}

bool pma_coupler_asked_to_stop(pma_coupler *c, const pma_poll *poll)
{
    if (!poll || c->unpolled < poll->entries)
        return false;
    c->unpolled = 0;
    return poll->stop(poll->ctx);
}

static pma_status fine_steps(pma_coupler *c, const pma_record *record, const pma_poll *poll)
{
    for (size_t k = 1; k <= c->fine; k++) {
        c->k = c->pending ? c->fine + k : k;
        if (pma_coupler_asked_to_stop(c, poll))
            return PMA_STOPPED;
        const pma_status status = fine_step(c);
        if (status != PMA_OK)
            return status;
        if (record)
            pma_coupler_record(c, record);
    }
    return PMA_OK;
}

static void begin(pma_coupler *c, int64_t steps, const pma_record *record)
{
    c->record = record;
    c->end = c->step_count + steps;
    for (size_t i = 0; i < c->parts.count; i++)
        c->places[i].opened = pma_subdomain_opened(c->places[i].subdomain);
}

pma_status pma_coupler_advance(pma_coupler *c, int64_t steps, const pma_record *record,
                               const pma_poll *poll)
{
    pma_status status = c->started ? PMA_OK : PMA_NOT_READY;
    if (c->team && steps > 0 && status == PMA_OK)
        status = pma_team_gather(c->team);
    begin(c, steps, record);
    for (int64_t step = 0; step < steps && status == PMA_OK; step++) {
        status = (c->parts.macro ? pma_macro_step : fine_steps)(c, record, poll);
        if (status == PMA_OK) {
            complete(c);
        } else {
            status = pma_ahead_settle(c, status);
            go_to_present(c);
        }
    }
    return status;
}
