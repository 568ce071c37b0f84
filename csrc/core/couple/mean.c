/* mean.c - mean coupling: multipliers constant over the macro step, displacements tied at its end.
 *
 * To be read with section 15 of docs/method.md. Every subdomain makes its substeps as if it were
 * free (free macro run), and from rest under the constant acceleration that the multipliers give
 * its interface (link response); a single implicit step is closed instead. This acceleration is no
 * part of w, so that the work at the interface is the multipliers times the displacements there,
 * which are equal: no energy is made, and nothing drifts. */
#include <string.h>

#include "couple/inside.h"
#include "memory.h"

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

/* ---- accelerations (K5) --------------------------------------------------------------------- */

static bool is_first(const pma_coupler *c)
{
    return c->lengths[0] == 0.0;
}

/* The multipliers of a macro step belong to its middle, and alternate about the force at the
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

/* ---- free macro run, under no multipliers --------------------------------------------------- */

pma_status pma_mean_free_run(pma_coupler *c, pma_coupled *m)
{
    memset(m->lam, 0, c->parts.p * sizeof(double));
    return pma_macro_free_run(c, m);
}

/* ---- interface (K4) ------------------------------------------------------------------------- */

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

void pma_mean_right_side(pma_coupler *c, double *right)
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

/* (K4), for constant multipliers */
static pma_status solve_interface(pma_coupler *c)
{
    memset(c->dlam, 0, c->parts.p * sizeof(double));
    pma_mean_right_side(c, c->working.lam);
    return pma_coupler_solve(c);
}

/* ---- link response (K3), added -------------------------------------------------------------- */

/* m->lam := of the multipliers of both macro steps of a double step, twice their mean weighted by
 * the lengths, less `less` of the new ones */
static const double *both_multipliers(const pma_coupler *c, pma_coupled *m, double less)
{
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

pma_status pma_mean_link_response(pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    if (member->deferred)
        return close_waiting(c, m);
    member->table->begin_response(member->self, m->step.twice, multipliers_of(c, m));
    member->table->hold_energy(member->self, m->step.twice, held_multipliers(c, m));
    PMA_TRY(pma_macro_respond(c, m, c->working.lam, accelerate_inner));
    return member->table->add_response(member->self, multipliers_of(c, m));
}

pma_status pma_mean_accelerate(pma_coupler *c, pma_coupled *m)
{
    const pma_selection *inner = pma_macro_selection(c, m);
    for (size_t j = 1; inner && j < m->member.substeps; j++)
        accelerate_inner(c, m, j, inner);
    return PMA_OK;
}

/* ---- the schedule --------------------------------------------------------------------------- */

/* The accelerations of the end of the macro step, after everything else of it was recorded. */
void pma_mean_record(pma_coupler *c)
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

/* The displacement at the end of the free run, and where a velocity is prescribed the present
 * one */
size_t pma_mean_pieces(const pma_coupler *c, const pma_coupled *m, size_t round, pma_piece *pieces)
{
    (void)round;
    pieces[0] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = m->member.substeps};
    pieces[1] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = 0};
    return c->parts.motion_count > 0 ? 2 : 1;
}

static pma_status macro_step(pma_coupler *c)
{
    static const pma_macro_stages STAGES = {.free_run = pma_mean_free_run,
                                            .solve = solve_interface,
                                            .link_response = pma_mean_link_response};
    PMA_TRY(pma_macro_step(c, &STAGES));
    pma_mean_record(c);
    return PMA_OK;
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

const pma_schedule pma_mean_schedule = {.check = pma_mean_check,
                                        .instants = pma_macro_instants,
                                        .duty = pma_macro_duty,
                                        .step = macro_step,
                                        .prepare = prepare,
                                        .interface_pieces = pma_mean_pieces,
                                        .move_to = pma_macro_move_to,
                                        .record_present = pma_mean_record_present,
                                        .ties_displacements = true};
