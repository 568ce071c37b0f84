/* macro.c - macro coupling: multipliers linear over the macro step, one interface problem in it.
 *
 * Every subdomain makes its substeps twice: with the loads and the multipliers of the beginning
 * held (free macro run), and from rest under multipliers that grow linearly from zero to dLam
 * (link response). To be read with section 13 of docs/method.md. */
#include <string.h>

#include "couple/inside.h"

/* ---- which substeps, and what there is to do ------------------------------------------------ */

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

const pma_selection *pma_macro_selection(const pma_coupler *c, const pma_coupled *m)
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
    const pma_selection *inner = pma_macro_selection(c, m);
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

/* ---- free macro run (M2) -------------------------------------------------------------------- */

/* A substep as far as it is known: with the multipliers of the beginning held, under mean coupling
 * those of the member, which are zero; a single one is closed when all is known (M6) (K7) */
static pma_status free_substep(pma_coupler *c, pma_coupled *m, size_t j)
{
    const pma_member *member = &m->member;
    const bool is_mean = c->parts.schedule->ties_displacements;
    const double *lam = is_mean ? m->lam : c->present.lam;
    const bool deferred = is_mean ? member->deferred : member->substeps == 1;
    pma_substep step = pma_substep_of(c, m, j);
    step.is_free_run = true;
    PMA_TRY(member->table->advance(member->self, NULL, &step, lam, NULL));
    return deferred ? PMA_OK : member->table->advance(member->self, &step, NULL, lam, NULL);
}

pma_status pma_macro_free_run(pma_coupler *c, pma_coupled *m)
{
    return pma_macro_run(c, m, free_substep);
}

/* ---- interface (M4) ------------------------------------------------------------------------- */

void pma_macro_free_velocity(const pma_coupled *m, double *sum)
{
    const pma_member *member = &m->member;
    if (member->substeps > 1)
        pma_member_gather(member, PMA_VELOCITY, member->substeps, 1.0, sum);
    else
        pma_member_gather(member, PMA_FREE_VELOCITY, 1, 1.0, sum);
}

/* H dLam = g - sum_i L_i v_i(free run)                                              (M4) (G1) */
static pma_status solve_interface(pma_coupler *c)
{
    const size_t p = c->parts.p;
    double *lam = c->working.lam;
    if (c->parts.motion_count > 0)
        pma_coupler_prescribe(c);
    for (size_t row = 0; row < p; row++)
        lam[row] = -c->working.g[row];
    for (size_t i = 0; i < c->parts.count; i++)
        pma_macro_free_velocity(&c->coupled[i], lam);
    for (size_t row = 0; row < p; row++)
        lam[row] = -lam[row];
    const pma_status status = pma_coupler_solve(c);

    /* (M1)  Lam_{n+1} = Lam_n + dLam */
    memcpy(c->dlam, lam, p * sizeof(double));
    for (size_t row = 0; row < p; row++)
        lam[row] = c->present.lam[row] + c->dlam[row];
    return status;
}

/* ---- link response (M3), added (M5) --------------------------------------------------------- */

pma_status pma_macro_respond(pma_coupler *c, pma_coupled *m, const double *lam,
                             void (*record)(const pma_coupler *c, const pma_coupled *m, size_t j,
                                            const pma_selection *inner))
{
    const pma_member *member = &m->member;
    const pma_selection *inner = pma_macro_selection(c, m);
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

pma_status pma_macro_link_response(pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    if (member->substeps == 1)
        return member->table->advance(member->self, &m->step, NULL, c->working.lam, NULL);
    PMA_TRY(pma_macro_respond(c, m, c->present.lam, NULL));
    return member->table->add_response(member->self, c->dlam);
}

/* ---- the schedule --------------------------------------------------------------------------- */

void pma_macro_move_to(pma_coupler *c, size_t k)
{
    c->k = k;
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_coupled *m = &c->coupled[i];
        m->now = (pma_moment){.j = m->member.substeps - 1, .phase = 1};
        m->step = pma_substep_of(c, m, m->now.j);
    }
}

/* The velocity at the end of the free run */
size_t pma_macro_pieces(const pma_coupler *c, const pma_coupled *m, size_t round, pma_piece *pieces)
{
    const size_t substeps = m->member.substeps;
    (void)c, (void)round;
    pieces[0] = (pma_piece){.kind = substeps > 1 ? PMA_VELOCITY : PMA_FREE_VELOCITY, .j = substeps};
    return 1;
}

pma_status pma_macro_step(pma_coupler *c, const pma_macro_stages *stages)
{
    pma_macro_move_to(c, 1);
    pma_status status = pma_share(c, stages->free_run, pma_is_any);
    if (status == PMA_OK && c->exchange)
        status = pma_exchange_interface(c);
    if (status == PMA_OK)
        status = stages->solve(c);
    if (status == PMA_OK)
        status = pma_share(c, stages->link_response, pma_is_any);
    if (status == PMA_OK && c->exchange)
        status = pma_exchange_jumps(c);
    if (atomic_load(&c->stopped))
        status = PMA_STOPPED; /* whatever else went wrong */
    if (c->exchange)
        status = pma_exchange_agree(c, status); /* what follows belongs to the state */
    if (status == PMA_OK && c->record)
        pma_recorder_write(c);
    return status;
}

static pma_status macro_step(pma_coupler *c)
{
    static const pma_macro_stages STAGES = {.free_run = pma_macro_free_run,
                                            .solve = solve_interface,
                                            .link_response = pma_macro_link_response};
    return pma_macro_step(c, &STAGES);
}

const pma_schedule pma_macro_schedule = {.check = pma_macro_check,
                                         .instants = pma_macro_instants,
                                         .duty = pma_macro_duty,
                                         .step = macro_step,
                                         .interface_pieces = pma_macro_pieces,
                                         .move_to = pma_macro_move_to};
