/* shooting.c - macro coupling with internal forces: the increment of the multipliers by shooting.
 *
 * To be read with section 14 of docs/method.md. A member with internal forces runs its substeps
 * from the present under Lam_n + (j / substeps) dLam, each iterated alone, as often as dLam is
 * corrected; the state at the end is always that of a run, so that equilibrium holds and only the
 * tie is left. A member without them makes its free macro run and its link response once, as in
 * macro.c. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "couple/inside.h"

/* Motions that are rounding magnify that of the substeps by less than this.              (N16) */
#define FOUND 100.0

/* The parts of the tolerance of a substep that are enough in the first run and in later
 * ones.                                                                                   (N16) */
#define FIRST_PASS 0.1
#define LATER_PASSES 10.0

/* Residuals are exact up to this many units in the last place of their terms. */
#define ROUNDING (100.0 * DBL_EPSILON)

static bool has_internal(const pma_coupled *m)
{
    return m->member.has_internal;
}

/* ---- a run ---------------------------------------------------------------------------------- */

static const pma_tie *tie_of(const pma_coupler *c)
{
    return c->parts.schedule->tie;
}

/* lam (p) := Lam_n + (j / substeps) dLam; or constant ones, of which dLam is then all */
static const double *multipliers_at(const pma_coupler *c, pma_coupled *m, size_t j)
{
    const double share = (double)j / (double)m->member.substeps;
    if (!tie_of(c)->ramps)
        return m->lam;
    for (size_t row = 0; row < c->parts.p; row++)
        m->lam[row] = c->present.lam[row] + share * c->iteration->dlam[row];
    return m->lam;
}

/* The corrections of a substep are those of all passes of the macro step. */
static void count_corrections(const pma_coupler *c, pma_coupled *m, size_t j)
{
    double *last = m->member.iterated.table->corrections(m->member.self, j + 1);
    double *all = &c->iteration->members[m - c->coupled].corrections[j];
    *all += *last;
    *last = *all;
}

static void forget_corrections(const pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_coupled *m = &c->coupled[i];
        if (m->member.iterated.table)
            memset(c->iteration->members[i].corrections, 0, m->member.substeps * sizeof(double));
    }
}

/* A substep under the multipliers at its end: iterated alone, or explicit. */
static pma_status run_substep(pma_coupler *c, pma_coupled *m, size_t j)
{
    const pma_member *member = &m->member;
    const pma_iterated_table *iterated = member->iterated.table;
    const pma_substep step = pma_substep_of(c, m, j);
    const double *lam = multipliers_at(c, m, j + 1);
    if (!iterated) {
        PMA_TRY(member->table->advance(member->self, NULL, &step, lam, NULL));
        return member->table->advance(member->self, &step, NULL, lam, NULL);
    }
    pma_stop_context at = {.c = c, .m = m};
    const pma_newton *newton = &c->iteration->parts.newton;
    PMA_TRY(iterated->begin(member->self, &step, lam));
    PMA_TRY(iterated->converge(member->self, newton, lam, pma_macro_stops, &at));
    PMA_TRY(iterated->finish(member->self, lam));
    count_corrections(c, m, j);
    return PMA_OK;
}

/* (K2)  The multipliers that push a member, in a double step the mean of two macro
 * steps, weighted by their lengths */
static void begin_push(const pma_coupler *c, pma_coupled *m)
{
    const pma_member *member = &m->member;
    const bool twice = pma_substep_of(c, m, 0).twice;
    const double old = twice ? c->lengths[0] / (c->lengths[0] + c->parts.dt) : 0.0;
    for (size_t row = 0; row < c->parts.p; row++)
        m->lam[row] = old * c->present.lam[row] + (1.0 - old) * c->iteration->dlam[row];
    member->table->push(member->self, m->lam);
    member->table->hold_energy(member->self, twice, m->lam);
}

static pma_status run(pma_coupler *c, pma_coupled *m)
{
    if (!tie_of(c)->ramps)
        begin_push(c, m);
    return pma_macro_run(c, m, run_substep);
}

/* ---- the residual of the tie ---------------------------------------------------------------- */

/* known (p) := minus the right side of the interface problem without the members that shoot */
static void known_part(pma_coupler *c, double *known)
{
    tie_of(c)->right_side(c, known);
    for (size_t row = 0; row < c->parts.p; row++)
        known[row] = -known[row];
}

/* terms := |H| |Lam| + |known|: what the multipliers moved rounds, too, where nothing moves in sum;
 * their work |Lam| . |H| |Lam| */
static void begin_terms(const pma_coupler *c, const double *known)
{
    pma_iteration *it = c->iteration;
    const size_t p = c->parts.p;
    const bool ramps = tie_of(c)->ramps;
    double *lam = it->scratch;
    for (size_t row = 0; row < p; row++) {
        lam[row] = -fabs((ramps ? c->present.lam[row] : 0.0) + it->dlam[row]);
        it->terms[row] = 0.0;
    }
    pma_matrix_subtract(&it->parts.H_size, lam, it->terms);
    it->moved = 0.0;
    for (size_t row = 0; row < p; row++) {
        it->moved -= lam[row] * it->terms[row];
        it->terms[row] += fabs(known[row]);
    }
}

/* r(dLam) = sum L v - g at the end of the runs, and the size of its terms           (N14) (K6) */
static void residual(const pma_coupler *c, const double *known, double *r)
{
    const pma_iteration *it = c->iteration;
    const pma_matrix *response =
        c->present.number > 0 ? &it->parts.response : &it->parts.response_start;
    const size_t p = c->parts.p;
    double *own = it->scratch;
    begin_terms(c, known);
    for (size_t row = 0; row < p; row++)
        r[row] = -known[row];
    pma_matrix_subtract(response, it->dlam, r);
    for (size_t row = 0; row < p; row++)
        r[row] = -r[row];
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *member = &c->coupled[i].member;
        if (!member->has_internal)
            continue;
        memset(own, 0, p * sizeof(double));
        pma_member_gather(member, tie_of(c)->kind, member->substeps, 1.0, own);
        for (size_t row = 0; row < p; row++) {
            r[row] += own[row];
            it->terms[row] += fabs(own[row]);
        }
    }
}

/* v . M v of the members that shoot, at the present and at the end of a run, and the scale of what
 * was iterated in it; of those in other processes they are received. */
static void measure(const pma_coupler *c, bool first)
{
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_member *member = &m->member;
        pma_iteration_member *own = &c->iteration->members[m - c->coupled];
        if (!member->has_internal)
            continue;
        if (first)
            own->kinetic_before = member->table->kinetic(member->self, 0);
        own->kinetic = member->table->kinetic(member->self, member->substeps);
        if (member->iterated.table)
            own->scale = member->iterated.table->scale(member->self);
    }
}

/* The largest energy so far. */
static double scale_of_energies(const pma_coupler *c)
{
    double before = 0.0, now = 0.0;
    for (size_t i = 0; i < c->parts.count; i++) {
        before += c->iteration->members[i].kinetic_before;
        now += c->iteration->members[i].kinetic;
    }
    return fmax(fmax(c->iteration->working[0], before), now);
}

/* The substeps are not more accurate than their own scales allow, which are less than zero where
 * they are rounding (N9). */
static double accuracy(const pma_coupler *c, double energies)
{
    const double tolerance = c->iteration->parts.newton.tolerance;
    double rounding = 0.0;
    for (size_t i = 0; i < c->parts.count; i++) {
        const double scale = c->iteration->members[i].scale;
        energies += fmax(0.0, scale);
        rounding += fmax(0.0, -scale);
    }
    return fmax(tolerance * sqrt(energies), FOUND * sqrt(rounding));
}

/* ---- shooting (N14) ------------------------------------------------------------------------- */

static bool is_rounding(const pma_iteration *it, size_t p)
{
    for (size_t row = 0; row < p; row++) {
        if (!(fabs(it->residual[row]) <= ROUNDING * it->terms[row]))
            return false;
    }
    return true;
}

/* (N16)  The work that the next correction would do, sqrt(|correction . r| dt), is small enough;
 * with a residual of displacements it is sqrt(|correction . r|). Or the residual is rounding, of
 * the work of all multipliers or in every row. */
static bool is_accepted(const pma_coupler *c, bool first, double accurate)
{
    const pma_iteration *it = c->iteration;
    double work = 0.0;
    for (size_t row = 0; row < c->parts.p; row++)
        work += it->correction[row] * it->residual[row];
    const double time = tie_of(c)->kind == PMA_VELOCITY ? c->parts.dt : 1.0;
    const double e = sqrt(fabs(work) * time), part = first ? FIRST_PASS : LATER_PASSES;
    return e <= part * accurate || e <= ROUNDING * sqrt(time * it->moved) ||
           is_rounding(it, c->parts.p);
}

/* dLam += -B r, after B has learned from the last correction */
static void correct(pma_coupler *c, bool first)
{
    pma_iteration *it = c->iteration;
    const size_t p = c->parts.p;
    if (!first) {
        for (size_t row = 0; row < p; row++)
            it->residual_before[row] = it->residual[row] - it->residual_before[row];
        pma_broyden_learn(&it->broyden, it->correction, it->residual_before, it->scratch);
    }
    memcpy(it->residual_before, it->residual, p * sizeof(double));
    pma_broyden_apply(&it->broyden, it->residual, it->correction);
    for (size_t row = 0; row < p; row++)
        it->correction[row] = -it->correction[row];
}

/* The runs of all members under the multipliers as they are. */
static pma_status run_members(pma_coupler *c, bool first)
{
    pma_status status = pma_share(c, run, has_internal);
    if (atomic_load(&c->stopped))
        status = PMA_STOPPED;
    if (status == PMA_OK)
        measure(c, first);
    return c->exchange ? pma_messages_runs(c, status) : status;
}

static pma_status shoot(pma_coupler *c, const double *known)
{
    pma_iteration *it = c->iteration;
    forget_corrections(c);
    for (size_t pass = 0; pass < it->parts.newton.iterations; pass++) {
        PMA_TRY(run_members(c, pass == 0));
        residual(c, known, it->residual);
        const double scale = scale_of_energies(c);
        correct(c, pass == 0);
        if (is_accepted(c, pass == 0, accuracy(c, scale))) {
            it->working[0] = scale;
            return PMA_OK;
        }
        for (size_t row = 0; row < c->parts.p; row++)
            it->dlam[row] += it->correction[row];
    }
    c->failed = PMA_INTERFACE;
    return PMA_NOT_CONVERGED;
}

/* B starts as the inverse of H with the tangents at t = 0, and again after the first macro step,
 * where H changes with double steps. */
static void begin_broyden(pma_coupler *c)
{
    pma_iteration *it = c->iteration;
    it->broyden.start = c->present.number > 0 ? &c->parts.H : &c->parts.H_start;
    if (c->present.number == 0 || (c->present.number == 1 && pma_coupler_has(c, pma_is_doubled)))
        pma_broyden_begin(&it->broyden, it->scratch);
}

/* ---- the schedule --------------------------------------------------------------------------- */

static pma_status solve(pma_coupler *c)
{
    double *known = c->iteration->lam_begin;
    begin_broyden(c);
    known_part(c, known);
    const pma_status status = shoot(c, known);
    pma_macro_take(c, c->iteration->dlam);
    return status;
}

static pma_status run_all(pma_coupler *c)
{
    return pma_macro_step(c, solve);
}

static pma_status macro_step(pma_coupler *c)
{
    return pma_iteration_step(c, run_all);
}

const pma_schedule pma_shooting_schedule = {.tie = &pma_velocity_tie,
                                            .check = pma_macro_check,
                                            .instants = pma_macro_instants,
                                            .duty = pma_macro_duty,
                                            .step = macro_step,
                                            .prepare = pma_iteration_create_macro,
                                            .interface_pieces = pma_macro_pieces,
                                            .move_to = pma_macro_move_to,
                                            .iterates = true,
                                            .internal = true};

const pma_schedule pma_mean_shooting_schedule = {.tie = &pma_displacement_tie,
                                                 .check = pma_mean_check,
                                                 .instants = pma_macro_instants,
                                                 .duty = pma_macro_duty,
                                                 .step = macro_step,
                                                 .prepare = pma_iteration_create_macro,
                                                 .interface_pieces = pma_mean_pieces,
                                                 .move_to = pma_macro_move_to,
                                                 .record_present = pma_mean_record_present,
                                                 .iterates = true,
                                                 .internal = true};
