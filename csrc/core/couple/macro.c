/* macro.c - one interface problem in a macro step, of any numbers of substeps, with two ties.
 *
 * Every subdomain makes its substeps twice: as far as they are known (free macro run), and from
 * rest under what is added to its multipliers (link response). To be read with section 13 of
 * docs/method.md, where these grow linearly from zero to dLam and velocities are tied, and section
 * 15 (mean coupling), where they are constant and displacements are: the acceleration that they
 * give is no part of w, so that the work at the interface is the multipliers times the
 * displacements there, which are equal: no energy is made, and nothing drifts. */
#include <assert.h>
#include <string.h>

#include "couple/inside.h"
#include "memory.h"

/* ---- which substeps, and what there is to do ------------------------------------------------ */

static const pma_tie *tie_of(const pma_coupler *c)
{
    assert(c->parts.schedule->tie);
    return c->parts.schedule->tie;
}

/* Any numbers of substeps; with several of them a link response and no double steps. Members that
 * cannot do what this schedule needs are refused; those with internal forces need another one. */
pma_status pma_macro_check(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        const bool has_responses = member->elsewhere || member->table->advance_response;
        if (member->has_internal)
            continue;
        if (member->substeps > 1 && (member->doubling != PMA_SINGLE || !has_responses))
            return PMA_BAD_SIZE;
    }
    return PMA_OK;
}

size_t pma_macro_instants(const pma_coupler_parts *parts)
{
    (void)parts;
    return 1;
}

/* A subdomain does all its substeps at once, and twice where its link response is not stored, or
 * where it has internal forces: about as often as it runs. */
pma_duty pma_macro_duty(const pma_member *member)
{
    const bool repeats = member->has_internal ||
                         (member->substeps > 1 && member->table->repeats(member->self, false) > 0);
    return (pma_duty){.entries = member->entries * member->substeps * (repeats ? 2 : 1),
                      .substeps = 1,
                      .by_caller = member->forces == PMA_BY_CALLER};
}

/* Worker 0 polls, the others see what came of it. */
bool pma_macro_is_stopped(pma_coupler *c, const pma_coupled *m)
{
    if (m->worker > 0 && !pma_team_is_alone(c->team))
        return atomic_load(&c->stopped);
    const bool stopped = pma_coupler_is_stopped(c);
    c->unpolled += m->member.entries;
    return stopped;
}

bool pma_macro_stops(void *context)
{
    const pma_stop_context *at = context;
    return pma_macro_is_stopped(at->c, at->m);
}

/* What is recorded of the inner time levels of a macro step, or NULL. */
static const pma_selection *inner_selection(const pma_coupler *c, const pma_coupled *m)
{
    if (!c->record || c->record->every > 0)
        return NULL;
    const pma_selection *selection = &c->record->selections[m - c->coupled];
    return pma_selection_is_empty(selection) ? NULL : selection;
}

pma_status pma_macro_run(pma_coupler *c, pma_coupled *m,
                         pma_status (*take)(pma_coupler *c, pma_coupled *m, size_t j))
{
    const pma_member *member = &m->member;
    const pma_selection *inner = inner_selection(c, m);
    for (size_t j = 0; j < member->substeps; j++) {
        if (pma_macro_is_stopped(c, m))
            return PMA_STOPPED;
        PMA_TRY(take(c, m, j));
        if (inner && j + 1 < member->substeps)
            member->table->record(member->self, PMA_MOTION, j + 1, NULL, inner,
                                  pma_recorder_row(c, j + 1, member->substeps));
    }
    return PMA_OK;
}

/* ---- free macro run (M2) (K2) --------------------------------------------------------------- */

/* A substep as far as it is known: with the multipliers of the beginning held, or constant ones of
 * zero; a single one is closed when all is known (M6) (K7) */
static pma_status free_substep(pma_coupler *c, pma_coupled *m, size_t j)
{
    const pma_member *member = &m->member;
    const bool ramps = tie_of(c)->ramps;
    const double *lam = ramps ? c->present.lam : m->lam;
    const bool deferred = ramps ? member->substeps == 1 : member->deferred;
    pma_substep step = pma_substep_of(c, m, j);
    step.is_free_run = true;
    PMA_TRY(member->table->advance(member->self, NULL, &step, lam, NULL));
    return deferred ? PMA_OK : member->table->advance(member->self, &step, NULL, lam, NULL);
}

/* What has internal forces shoots. */
static pma_status free_run(pma_coupler *c, pma_coupled *m)
{
    if (m->member.has_internal)
        return PMA_OK;
    if (!tie_of(c)->ramps)
        memset(m->lam, 0, c->parts.p * sizeof(double));
    return pma_macro_run(c, m, free_substep);
}

/* ---- interface (M4) (K4) -------------------------------------------------------------------- */

/* (M1), or constant ones: those that were found, without an increment in the macro step */
void pma_macro_take(pma_coupler *c, const double *found)
{
    const bool ramps = tie_of(c)->ramps;
    for (size_t row = 0; row < c->parts.p; row++) {
        const double x = found[row];
        c->dlam[row] = ramps ? x : 0.0;
        c->working.lam[row] = ramps ? c->present.lam[row] + x : x;
    }
}

static pma_status solve_interface(pma_coupler *c)
{
    tie_of(c)->right_side(c, c->working.lam);
    const pma_status status = pma_coupler_solve(c);
    pma_macro_take(c, c->working.lam);
    return status;
}

/* ---- link response -------------------------------------------------------------------------- */

/* The substeps of a link response under the multipliers lam (p), as many as have to be repeated,
 * each recorded by `record` too, unless NULL. */
static pma_status respond(pma_coupler *c, pma_coupled *m, const double *lam,
                          void (*record)(const pma_coupler *c, const pma_coupled *m, size_t j,
                                         const pma_selection *inner))
{
    const pma_member *member = &m->member;
    const pma_selection *inner = inner_selection(c, m);
    const size_t repeats = member->table->repeats(member->self, inner != NULL);
    for (size_t j = 1; j <= repeats; j++) {
        if (pma_macro_is_stopped(c, m))
            return PMA_STOPPED;
        member->table->advance_response(member->self, j, lam, c->dlam);
        if (!inner || j == member->substeps)
            continue;
        member->table->record(member->self, PMA_RESPONSE, j, NULL, inner,
                              pma_recorder_row(c, j, member->substeps));
        if (record)
            record(c, m, j, inner);
    }
    return PMA_OK;
}

/* ---- a macro step ---------------------------------------------------------------------------- */

void pma_macro_move_to(pma_coupler *c, size_t k)
{
    c->k = k;
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_coupled *m = &c->coupled[i];
        m->now = (pma_moment){.j = m->member.substeps - 1, .phase = 1};
        m->step = pma_substep_of(c, m, m->now.j);
    }
}

pma_status pma_macro_step(pma_coupler *c, pma_status (*solve)(pma_coupler *c))
{
    const pma_tie *tie = tie_of(c);
    pma_macro_move_to(c, 1);
    pma_status status = pma_share(c, free_run, pma_is_any);
    if (status == PMA_OK && c->exchange)
        status = pma_exchange_interface(c);
    if (status == PMA_OK)
        status = solve(c);
    if (status == PMA_OK)
        status = pma_share(c, tie->link_response, pma_is_any);
    if (status == PMA_OK && c->exchange)
        status = pma_exchange_jumps(c);
    if (atomic_load(&c->stopped))
        status = PMA_STOPPED; /* whatever else went wrong */
    if (c->exchange)
        status = pma_exchange_agree(c, status); /* what follows belongs to the state */
    if (status == PMA_OK && c->record)
        pma_recorder_write(c);
    if (status == PMA_OK && tie->end)
        tie->end(c);
    return status;
}

static pma_status macro_step(pma_coupler *c)
{
    return pma_macro_step(c, solve_interface);
}

/* ---- velocities, by multipliers that ramp: section 13 ---------------------------------------- */

/* g - sum_i L_i v_i(free run)                                                        (M4) (G1) */
static void velocity_right_side(pma_coupler *c, double *right)
{
    const size_t p = c->parts.p;
    if (c->parts.motion_count > 0)
        pma_coupler_prescribe(c);
    for (size_t row = 0; row < p; row++)
        right[row] = -c->working.g[row];
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *member = &c->coupled[i].member;
        const bool closed = member->substeps > 1;
        if (!member->has_internal)
            pma_member_gather(member, closed ? PMA_VELOCITY : PMA_FREE_VELOCITY, member->substeps,
                              1.0, right);
    }
    for (size_t row = 0; row < p; row++)
        right[row] = -right[row];
}

/* (M3), added (M5) */
static pma_status respond_to_increment(pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    if (member->has_internal)
        return PMA_OK;
    if (member->substeps == 1)
        return member->table->advance(member->self, &m->step, NULL, c->working.lam, NULL);
    PMA_TRY(respond(c, m, c->present.lam, NULL));
    return member->table->add_response(member->self, c->dlam);
}

const pma_tie pma_velocity_tie = {.kind = PMA_VELOCITY,
                                  .ramps = true,
                                  .right_side = velocity_right_side,
                                  .link_response = respond_to_increment};

/* The velocity at the end of the free run; the ends of runs that shoot are other messages. */
size_t pma_macro_pieces(const pma_coupler *c, const pma_coupled *m, size_t round, pma_piece *pieces)
{
    const size_t substeps = m->member.substeps;
    (void)c, (void)round;
    if (m->member.has_internal)
        return 0;
    pieces[0] = (pma_piece){.kind = substeps > 1 ? PMA_VELOCITY : PMA_FREE_VELOCITY, .j = substeps};
    return 1;
}

const pma_schedule pma_macro_schedule = {.tie = &pma_velocity_tie,
                                         .check = pma_macro_check,
                                         .instants = pma_macro_instants,
                                         .duty = pma_macro_duty,
                                         .step = macro_step,
                                         .interface_pieces = pma_macro_pieces,
                                         .move_to = pma_macro_move_to};

/* ---- displacements, by constant multipliers: section 15 -------------------------------------- */

pma_status pma_mean_check(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        const pma_member_table *table = member->table;
        const bool has_responses =
            (table->advance_response || member->has_internal) && table->hold_energy;
        if (!(has_responses || member->elsewhere) ||
            (member->substeps > 1 && member->doubling != PMA_SINGLE))
            return PMA_BAD_SIZE;
    }
    return parts->doubled.n == parts->p ? PMA_OK : PMA_BAD_SIZE;
}

/* Of mean coupling: there was none before. */
static bool is_first(const pma_coupler *c)
{
    return c->lengths[0] == 0.0;
}

/* (K5)  The multipliers of a macro step belong to its middle, and alternate about the force at the
 * interface with an impulse of constant size; the mean of two neighbours weighted by their lengths,
 * at the middle of both, does not. At the part `share` of the macro step: on the line through the
 * last two means; in the first macro steps those of the start, lam_before or lam_end, take the
 * place of the second. Lengths in macro steps of the present one. */
static void multipliers_at(const pma_coupler *c, double share, double *lam)
{
    const double *now = c->working.lam, *last = c->present.lam;
    const double h1 = c->lengths[0] / c->parts.dt;
    const double h0 = c->lengths[1] > 0.0 ? c->lengths[1] / c->parts.dt : h1;
    const double slope = (share - 0.5 * (1.0 - h1)) / (0.5 * (1.0 + h0));
    for (size_t row = 0; row < c->parts.p; row++) {
        const double mean = 1.0 / (1.0 + h1) * now[row] + h1 / (1.0 + h1) * last[row];
        const double before = c->lengths[1] > 0.0
                                  ? h1 / (h0 + h1) * last[row] + h0 / (h0 + h1) * c->lam_before[row]
                                  : c->lam_before[row];
        if (is_first(c))
            lam[row] = now[row] + (2.0 * share - 1.0) * (now[row] - c->lam_end[row]);
        else
            lam[row] = mean + slope * (mean - before);
    }
}

/* target (p) := sum L u at the end: 0, and where a velocity is prescribed what that moves */
static void find_target(pma_coupler *c, double *target)
{
    const size_t p = c->parts.p;
    memset(target, 0, p * sizeof(double));
    if (c->parts.motion_count == 0)
        return;
    pma_coupler_prescribe(c);
    memset(c->sums, 0, p * sizeof(double));
    pma_coupler_gather(c, PMA_DISPLACEMENT, 0, c->sums);
    for (size_t k = 0; k < c->parts.motion_count; k++) {
        for (size_t i = 0; i < c->motions[k].load.n; i++) {
            const int64_t row = c->motions[k].rows[i];
            target[row] =
                c->sums[row] + 0.5 * c->parts.dt * (c->present.g[row] + c->working.g[row]);
        }
    }
}

/* What sum L u has to be at the end, minus that of the free runs, and of the multipliers of the
 * last macro step, which a double step feels too                                          (K4) */
static void displacement_right_side(pma_coupler *c, double *right)
{
    const size_t p = c->parts.p;
    find_target(c, right);
    memset(c->sums, 0, p * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *member = &c->coupled[i].member;
        if (!member->has_internal)
            pma_member_gather(member, PMA_DISPLACEMENT, member->substeps, 1.0, c->sums);
    }
    for (size_t row = 0; row < p; row++)
        right[row] -= c->sums[row];
    if (!is_first(c))
        pma_matrix_subtract(&c->parts.doubled, c->present.lam, right);
}

/* m->lam := of the multipliers of both macro steps of a double step, twice their mean weighted by
 * the lengths, less `less` of the new ones */
static const double *both_multipliers(const pma_coupler *c, pma_coupled *m, double less)
{
    assert(m->step.twice && c->lengths[0] > 0.0);
    const double h1 = c->lengths[0] / c->parts.dt, weight = 2.0 / (1.0 + h1) - less;
    for (size_t row = 0; row < c->parts.p; row++)
        m->lam[row] = h1 * 2.0 / (1.0 + h1) * c->present.lam[row] + weight * c->working.lam[row];
    return m->lam;
}

/* What a member responds to: in a double step the multipliers of both macro steps. */
static const double *multipliers_of(const pma_coupler *c, pma_coupled *m)
{
    return m->step.twice ? both_multipliers(c, m, 0.0) : c->working.lam;
}

/* What the works of a member begin with: with the new multipliers the same mean. */
static const double *held_multipliers(const pma_coupler *c, pma_coupled *m)
{
    return m->step.twice ? both_multipliers(c, m, 1.0) : c->working.lam;
}

/* (K7)  The multipliers of a double step are the mean of those of both macro steps. */
static pma_status close_waiting(const pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    const double *lam = multipliers_of(c, m);
    for (size_t row = 0; m->step.twice && row < c->parts.p; row++)
        m->lam[row] *= 0.5;
    member->table->hold_energy(member->self, m->step.twice, lam);
    return member->table->advance(member->self, &m->step, NULL, lam, NULL);
}

/* Adds the acceleration at an inner time level to its row. */
static void accelerate_inner(const pma_coupler *c, const pma_coupled *m, size_t j,
                             const pma_selection *inner)
{
    const pma_member *member = &m->member;
    const size_t row = pma_recorder_row(c, j, member->substeps);
    multipliers_at(c, (double)j / (double)member->substeps, m->lam);
    member->table->record(member->self, PMA_ACCELERATION, j, m->lam, inner, row);
}

static pma_status accelerate_run(pma_coupler *c, pma_coupled *m)
{
    const pma_selection *inner = inner_selection(c, m);
    for (size_t j = 1; inner && j < m->member.substeps; j++)
        accelerate_inner(c, m, j, inner);
    return PMA_OK;
}

/* (K3), added. At the end what no state has, of members that have shot. */
static pma_status respond_to_all(pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    if (member->has_internal)
        return accelerate_run(c, m);
    if (member->deferred)
        return close_waiting(c, m);
    member->table->begin_response(member->self, m->step.twice, multipliers_of(c, m));
    member->table->hold_energy(member->self, m->step.twice, held_multipliers(c, m));
    PMA_TRY(respond(c, m, c->working.lam, accelerate_inner));
    return member->table->add_response(member->self, multipliers_of(c, m));
}

/* The accelerations of the end of the macro step, after everything else of it was recorded. */
static void record_end(pma_coupler *c)
{
    multipliers_at(c, 1.0, c->sums);
    for (const pma_coupled *m = c->own; m < c->end_of_own && c->record; m++) {
        const pma_selection *selection = &c->record->selections[m - c->coupled];
        const size_t row = pma_recorder_row(c, m->member.substeps, m->member.substeps);
        if (!pma_selection_is_empty(selection) && row != PMA_NO_ROW)
            m->member.table->record(m->member.self, PMA_ACCELERATION, 0, c->sums, selection, row);
    }
    const double *before = is_first(c) ? c->lam_end : c->present.lam;
    memcpy(c->lam_before, before, c->parts.p * sizeof(double));
    memcpy(c->lam_end, c->sums, c->parts.p * sizeof(double));
    c->lengths[1] = c->lengths[0];
    c->lengths[0] = c->parts.dt;
}

const pma_tie pma_displacement_tie = {.kind = PMA_DISPLACEMENT,
                                      .right_side = displacement_right_side,
                                      .link_response = respond_to_all,
                                      .end = record_end};

/* The displacement at the end of the free run, and where a velocity is prescribed the present
 * one */
size_t pma_mean_pieces(const pma_coupler *c, const pma_coupled *m, size_t round, pma_piece *pieces)
{
    size_t count = 0;
    (void)round;
    if (!m->member.has_internal)
        pieces[count++] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = m->member.substeps};
    if (c->parts.motion_count > 0)
        pieces[count++] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = 0};
    return count;
}

static pma_status prepare(pma_coupler *c, const pma_iteration_parts *parts)
{
    const size_t p = c->parts.p;
    if (parts)
        return PMA_BAD_SIZE;
    c->lam_deferred = pma_memory_allocate(c->parts.count * p + 1, sizeof(double));
    if (!c->lam_deferred)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < c->parts.count; i++)
        c->coupled[i].lam = c->lam_deferred + i * p;
    return PMA_OK;
}

void pma_mean_record_present(const pma_coupler *c, const pma_record *record)
{
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_selection *selection = &record->selections[m - c->coupled];
        if (!pma_selection_is_empty(selection))
            m->member.table->record(m->member.self, PMA_ACCELERATION, 0, c->lam_end, selection, 0);
    }
}

const pma_schedule pma_mean_schedule = {.tie = &pma_displacement_tie,
                                        .check = pma_mean_check,
                                        .instants = pma_macro_instants,
                                        .duty = pma_macro_duty,
                                        .step = macro_step,
                                        .prepare = prepare,
                                        .interface_pieces = pma_mean_pieces,
                                        .move_to = pma_macro_move_to,
                                        .record_present = pma_mean_record_present};
