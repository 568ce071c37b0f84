/* recorder.c - what is recorded of a run, fine step by fine step. */
#include <assert.h>
#include <string.h>

#include "couple/inside.h"
#include "observe/energy.h"
#include "workers/denormals.h"

/* How many recorded macro steps came before this one, or -1 where it is not recorded. */
static inline int64_t count_before(const pma_record *record, int64_t macro)
{
    if (record->every == 0)
        return macro - record->begin;
    if ((macro + 1) % record->every != 0)
        return -1;
    return (macro + 1) / record->every - record->begin / record->every - 1;
}

static inline size_t row_of(const pma_record *record, int64_t macro, size_t j, size_t levels)
{
    const pma_ring *ring = record->ring;
    if (record->every > 0 && j != levels)
        return PMA_NO_ROW;
    int64_t before = count_before(record, macro);
    if (before < 0)
        return PMA_NO_ROW;
    if (ring && ring->steps[before % ring->size] != before)
        return PMA_NO_ROW;
    before = ring ? before % ring->size : before;
    return record->every == 0 ? (size_t)before * levels + j : (size_t)before + 1;
}

size_t pma_record_row(const pma_record *record, int64_t macro, size_t j, size_t levels)
{
    return row_of(record, macro, j, levels);
}

void pma_record_begin(const pma_record *record, int64_t macro)
{
    pma_ring *ring = record->ring;
    const int64_t before = count_before(record, macro);
    if (before < 0)
        return;
    if (before - pma_count_get(&ring->read) < ring->size)
        ring->steps[before % ring->size] = before;
    else
        pma_count_set(&ring->lost, pma_count_get(&ring->lost) + 1);
}

void pma_record_end(const pma_record *record, int64_t macro)
{
    pma_count_set(&record->ring->written, macro);
}

static inline size_t row_at(const pma_coupler *c, size_t j, size_t levels)
{
    const int64_t macro = c->origin.number + c->present.number + (j > levels);
    return row_of(c->record, macro, j > levels ? j - levels : j, levels);
}

size_t pma_recorder_row(const pma_coupler *c, size_t j, size_t levels)
{
    assert(c->record);
    return row_at(c, j, levels);
}

bool pma_recorder_begin(pma_coupler *c, const pma_record *record)
{
    const int64_t every = record->every, present = c->origin.number + c->present.number;
    c->recorded = every > 0 ? (present / every + 1) * every : 0;
    bool has_rows = c->parts.p > 0 || record->ring || record->energy || record->contact_gap;
    for (const pma_coupled *m = c->own; m < c->end_of_own && !has_rows; m++)
        has_rows = !pma_selection_is_empty(&record->selections[m - c->coupled]);
    return has_rows;
}

/* ---- jumps ---------------------------------------------------------------------------------- */

/* jump (p) := sum_i L_i u_i - int g dt at macro time level `macro`                        (G2) */
static void displacement_jump(const pma_coupler *c, size_t macro, const double *moved, double *jump)
{
    for (size_t k = 0; k < c->parts.p; k++)
        jump[k] = -moved[k];
    pma_coupler_gather(c, PMA_DISPLACEMENT, macro, jump);
}

/* sum_i L_i v_i - g and that at a macro time level, into a row of each */
static void macro_jumps(const pma_coupler *c, const pma_record *to, size_t macro,
                        const pma_macro_level *level, size_t row, size_t macro_row)
{
    const size_t p = c->parts.p;
    if (!to->velocity_jump)
        return;
    double *velocity = to->velocity_jump + row * p;
    for (size_t k = 0; k < p; k++)
        velocity[k] = -level->g[k];
    pma_coupler_gather(c, PMA_VELOCITY, macro, velocity);
    displacement_jump(c, macro, level->moved, to->displacement_jump + macro_row * p);
}

/* sum_i L_i v_i - g at the end of the fine step at hand, from total velocities; in mid-step from
 * interpolated free plus link velocity */
static void velocity_jump(const pma_coupler *c, double *jump)
{
    for (size_t row = 0; row < c->parts.p; row++)
        jump[row] = -c->working.g[row];
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_coupled *m = &c->coupled[i];
        if (pma_is_ending(m)) {
            pma_member_gather(&m->member, PMA_VELOCITY, m->now.j + 1, 1.0, jump);
        } else {
            pma_add_free_velocity(m, 1.0, jump);
            pma_member_compliance(&m->member, m->step.twice, c->working.lam, jump);
        }
    }
}

/* ---- what is wanted of the end of a fine step ----------------------------------------------- */

static void write_members(const pma_coupler *c)
{
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_selection *selection = &c->record->selections[m - c->coupled];
        if (!pma_is_ending(m) || pma_look_ahead_is_deferred(m) || pma_selection_is_empty(selection))
            continue;
        const size_t row = row_at(c, m->now.j + 1, m->member.substeps);
        m->member.table->record(m->member.self, PMA_MOTION, m->now.j + 1, NULL, selection, row);
    }
}

static void write_interface(const pma_coupler *c, bool deferred)
{
    const size_t p = c->parts.p, row = row_at(c, c->k, c->fine);
    memcpy(c->record->multipliers + row * p, c->working.lam, p * sizeof(double));
    if (!deferred)
        velocity_jump(c, c->record->velocity_jump + row * p);
}

/* Of macro time level `macro`: the present or the end of the macro step at hand. */
static void write_energy(const pma_coupler *c, const pma_record *record, size_t macro, size_t row)
{
    size_t observed = 0;
    for (size_t i = 0; i < c->parts.count; i++)
        observed += pma_member_is_observed(&c->coupled[i].member);
    double *out = record->energy + row * observed * PMA_ENERGIES;
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *member = &c->coupled[i].member;
        if (!pma_member_is_observed(member))
            continue;
        (void)member->table->energy(member->self, macro * member->substeps, out);
        out += PMA_ENERGIES;
    }
}

static void write_macro_level(const pma_coupler *c, bool deferred)
{
    const size_t macro = c->k == c->fine ? 1 : 2, row = row_at(c, macro, 1);
    if (c->record->energy)
        write_energy(c, c->record, macro, row);
    if (c->parts.p == 0 || deferred)
        return;
    displacement_jump(c, macro, c->working.moved, c->record->displacement_jump + row * c->parts.p);
}

/* Does the fine step at hand end where all arrays have a row? */
static bool has_row(pma_coupler *c)
{
    const int64_t every = c->record->every;
    if (c->record->ring)
        return row_at(c, c->k, c->fine) != PMA_NO_ROW;
    if (every == 0)
        return true;
    if (c->k != c->fine && c->k != 2 * c->fine)
        return false;
    const int64_t end = c->origin.number + c->present.number + (c->k == c->fine ? 1 : 2);
    if (end > c->recorded)
        c->recorded += every;
    return end == c->recorded;
}

void pma_recorder_write(pma_coupler *c)
{
    assert(c->record);
    if (!has_row(c))
        return;
    const bool deferred =
        pma_look_ahead_is_used(c) && pma_coupler_has(c, pma_look_ahead_is_deferred);
    write_members(c);
    if (c->parts.p > 0)
        write_interface(c, deferred);
    if (c->k == c->fine || c->k == 2 * c->fine)
        write_macro_level(c, deferred);
}

void pma_recorder_complete(const pma_coupler *c)
{
    if (!c->record || c->parts.p == 0)
        return;
    const size_t row = pma_recorder_row(c, c->fine, c->fine), macro = pma_recorder_row(c, 1, 1);
    if (row == PMA_NO_ROW)
        return;
    macro_jumps(c, c->record, 1, &c->reached, row, macro);
}

/* ---- the present ---------------------------------------------------------------------------- */

static void record_present(const pma_coupler *c, const pma_record *record)
{
    const size_t p = c->parts.p;
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++)
        m->member.table->record(m->member.self, PMA_MOTION, 0, NULL,
                                &record->selections[m - c->coupled], 0);
    if (c->parts.schedule->record_present)
        c->parts.schedule->record_present(c, record);
    if (record->energy)
        write_energy(c, record, 0, 0);
    if (p == 0)
        return;
    memcpy(record->multipliers, c->present.lam, p * sizeof(double));
    macro_jumps(c, record, 0, &c->present, 0, 0);
}

void pma_coupler_record_present(const pma_coupler *c, const pma_record *record)
{
    const pma_denormals before = pma_denormals_flush();
    record_present(c, record);
    pma_denormals_restore(before);
}

/* Of a fine step inside a macro step. */
static void record_inside(const pma_coupler *c, const pma_record *record)
{
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_selection *selection = &record->selections[m - c->coupled];
        if (pma_is_ending(m) && !pma_selection_is_empty(selection))
            m->member.table->record(m->member.self, PMA_MOTION, m->now.j + 1, NULL, selection, 0);
    }
    memcpy(record->multipliers, c->working.lam, c->parts.p * sizeof(double));
}

void pma_coupler_record_taken(const pma_coupler *c, const pma_record *record)
{
    if (c->k == 0) {
        pma_coupler_record_present(c, record);
        return;
    }
    const pma_denormals before = pma_denormals_flush();
    record_inside(c, record);
    pma_denormals_restore(before);
}
