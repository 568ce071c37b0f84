/* iterated_fine.c - "pm" and "gc" with internal forces: Newton's method on the coupled fine step.
 *
 * To be read with section 14 of docs/method.md. A member without internal forces, or an explicit
 * one, makes its free and its link problem once, as in fine.c. An iterated one contributes an
 * affine law of its interface velocity, L v = o + G Lam, at its iterate: where its substep ends
 * with the fine step all such members are iterated together with the interface, so that the
 * velocities agree after every iteration and only equilibrium is left; in the middle of a longer
 * substep the law is that of its free solution, iterated alone when the substep was begun. */
#include <math.h>
#include <string.h>

#include "couple/inside.h"

/* A change of interface forces up to this multiple of the rounding of their rows is
 * rounding.                                                                               (N8) */
#define OF_PULL 100.0

static const pma_iterated_table *table_of(const pma_coupled *m)
{
    return m->member.iterated.table;
}

static pma_iteration_member *member_in(const pma_coupler *c, const pma_coupled *m)
{
    return &c->iteration->members[m - c->coupled];
}

/* ---- the beginning of a substep ------------------------------------------------------------- */

static bool begins(const pma_coupled *m)
{
    return m->now.phase == 1;
}

static void take_block(pma_coupler *c, pma_coupled *m)
{
    pma_iteration_member *own = member_in(c, m);
    table_of(m)->block(m->member.self, own->block);
    own->known = own->changed = true;
}

/* A substep that ends later than this fine step: its free solution, and the law of it until then,
 * with a fresh tangent, since nothing corrects it afterwards.                            (N13) */
static pma_status open_long(pma_coupler *c, pma_coupled *m)
{
    const pma_iterated_table *table = table_of(m);
    const pma_newton *newton = &c->iteration->parts.newton;
    const double *lam = c->iteration->lam_begin;
    void *self = m->member.self;
    pma_measure measure;
    bool changed;
    pma_stop_context at = {.c = c, .m = m};
    PMA_TRY(table->converge(self, newton, lam, pma_macro_stops, &at));
    PMA_TRY(table->evaluate(self, true, &measure));
    PMA_TRY(table->linearize(self, true, lam, &changed));
    table->rebase(self, m->now.j, lam);
    take_block(c, m);
    return PMA_OK;
}

static pma_status open(pma_coupler *c, pma_coupled *m)
{
    if (!table_of(m))
        return pma_fine_open(c, m);
    PMA_TRY(table_of(m)->begin(m->member.self, &m->step, c->iteration->lam_begin));
    return m->ratio > 1 ? open_long(c, m) : PMA_OK;
}

static pma_status open_substeps(pma_coupler *c)
{
    const double *lam = c->k == 1 ? c->present.lam : c->working.lam;
    memcpy(c->iteration->lam_begin, lam, c->parts.p * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_coupled *m = &c->coupled[i];
        const bool opens_long = begins(m) && table_of(m) && m->ratio > 1;
        c->iteration->members[i].changed = opens_long; /* in other processes too */
        c->iteration->stale = c->iteration->stale || opens_long;
        if (begins(m))
            c->unpolled += m->member.entries;
    }
    return pma_share(c, open, begins);
}

/* ---- the interface, with the laws as they are ----------------------------------------------- */

/* (sum G) Lam = g - sum o                                                                (N12) */
static pma_status solve_interface(pma_coupler *c)
{
    PMA_TRY(pma_iteration_factor(c));
    pma_fine_right_side(c);
    return pma_coupler_solve(c);
}

/* ---- Newton's method on what ends here ------------------------------------------------------ */

static bool is_iterated(const pma_coupled *m)
{
    return table_of(m) && pma_is_ending(m);
}

static pma_status evaluate_one(pma_coupler *c, pma_coupled *m)
{
    pma_measure *measure = &member_in(c, m)->measure;
    return table_of(m)->evaluate(m->member.self, c->iteration->tangent, measure);
}

static pma_status linearize_one(pma_coupler *c, pma_coupled *m)
{
    pma_iteration_member *own = member_in(c, m);
    const pma_iteration *it = c->iteration;
    PMA_TRY(table_of(m)->linearize(m->member.self, it->fresh, it->lam_star, &own->changed));
    if (own->changed || !own->known)
        take_block(c, m);
    return PMA_OK;
}

static pma_status correct_one(pma_coupler *c, pma_coupled *m)
{
    table_of(m)->correct(m->member.self, c->working.lam, &member_in(c, m)->measure);
    return PMA_OK;
}

static pma_status move_one(pma_coupler *c, pma_coupled *m)
{
    table_of(m)->move(m->member.self, c->iteration->by);
    return PMA_OK;
}

static pma_status restart_one(pma_coupler *c, pma_coupled *m)
{
    table_of(m)->restart(m->member.self, c->iteration->lam_begin);
    return PMA_OK;
}

static void sum_measures(const pma_coupler *c, pma_measure *sum)
{
    *sum = (pma_measure){0};
    for (size_t i = 0; i < c->parts.count; i++) {
        if (is_iterated(&c->coupled[i]))
            pma_measure_add(sum, &c->iteration->members[i].measure);
    }
}

static pma_status evaluate(void *ctx, bool tangent, pma_measure *measure)
{
    pma_coupler *c = ctx;
    c->iteration->tangent = tangent;
    pma_status status = PMA_STOPPED;
    if (!pma_coupler_is_stopped(c))
        status = pma_share(c, evaluate_one, is_iterated);
    if (c->exchange)
        status = pma_messages_residuals(c, status);
    sum_measures(c, measure);
    if (c->iteration->parted)
        measure->residual = INFINITY; /* in no balance with the others */
    for (size_t i = 0; i < c->parts.count; i++)
        c->unpolled += is_iterated(&c->coupled[i]) ? c->coupled[i].member.entries : 0;
    return status;
}

static bool is_any_unknown(const pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        if (is_iterated(&c->coupled[i]) && !c->iteration->members[i].known)
            return true;
    }
    return false;
}

static pma_status correct(void *ctx, bool fresh, pma_measure *measure)
{
    pma_coupler *c = ctx;
    pma_iteration *it = c->iteration;
    it->fresh = fresh;
    it->stale = it->stale || fresh || is_any_unknown(c);
    pma_status status = pma_share(c, linearize_one, is_iterated);
    if (c->exchange)
        status = pma_messages_laws(c, status);
    PMA_TRY(status);
    PMA_TRY(solve_interface(c));
    pma_share(c, correct_one, is_iterated);
    if (c->exchange)
        status = pma_messages_measures(c);
    memcpy(it->lam_star, c->working.lam, c->parts.p * sizeof(double));
    sum_measures(c, measure);
    it->pulls = measure->pull > OF_PULL;
    it->parted = false;
    return status;
}

static bool is_fixed(const pma_coupled *m)
{
    return !is_iterated(m) && m->member.link->nb > 0;
}

/* A member that is not iterated has the velocities of the whole correction, to its multipliers:
 * with one, constraints hold at the end of a correction only, if it changes multipliers.    (N8) */
static void move(void *ctx, double by)
{
    pma_coupler *c = ctx;
    c->iteration->by = by;
    c->iteration->parted = c->iteration->pulls && pma_coupler_has(c, is_fixed);
    pma_share(c, move_one, is_iterated);
}

static void restart(void *ctx)
{
    pma_coupler *c = ctx;
    memcpy(c->iteration->lam_star, c->iteration->lam_begin, c->parts.p * sizeof(double));
    pma_share(c, restart_one, is_iterated);
}

static void remember_rounding(void *ctx)
{
    pma_coupler *c = ctx;
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        if (is_iterated(m))
            table_of(m)->remember_rounding(m->member.self);
    }
}

/* The member whose last correction was the largest. */
static size_t find_slowest(const pma_coupler *c)
{
    size_t slowest = PMA_INTERFACE;
    double largest = -1.0;
    for (size_t i = 0; i < c->parts.count; i++) {
        const double e = c->iteration->members[i].measure.correction;
        if (is_iterated(&c->coupled[i]) && !(e <= largest)) {
            largest = e;
            slowest = i;
        }
    }
    return slowest;
}

static pma_status find_factors(pma_coupler *c, bool *all)
{
    pma_status status = PMA_OK;
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        if (is_iterated(m))
            member_in(c, m)->factored = table_of(m)->has_factor(m->member.self);
    }
    if (c->exchange)
        status = pma_messages_factors(c);
    *all = true;
    for (size_t i = 0; i < c->parts.count; i++)
        *all = *all && (!is_iterated(&c->coupled[i]) || c->iteration->members[i].factored);
    return status;
}

static pma_status iterate(pma_coupler *c)
{
    static const pma_equations EQUATIONS = {.evaluate = evaluate,
                                            .correct = correct,
                                            .move = move,
                                            .restart = restart,
                                            .remember_rounding = remember_rounding};
    pma_iteration *it = c->iteration;
    bool have_factors;
    pma_status status = find_factors(c, &have_factors);
    memcpy(it->lam_star, it->lam_begin, c->parts.p * sizeof(double));
    it->parted = false;
    if (status == PMA_OK)
        status = pma_newton_solve(&it->parts.newton, &EQUATIONS, c, have_factors);
    if (c->exchange && pma_exchange_is_ended(c))
        return status;
    if (status == PMA_NOT_CONVERGED)
        c->failed = find_slowest(c);
    return status != PMA_OK && c->exchange ? pma_exchange_fail(c, status) : status;
}

/* ---- the end of a substep ------------------------------------------------------------------- */

static pma_status close(pma_coupler *c, pma_coupled *m)
{
    if (!table_of(m))
        return pma_fine_close(c, m);
    return table_of(m)->finish(m->member.self, c->working.lam);
}

/* ---- the schedule --------------------------------------------------------------------------- */

static pma_status fine_step(pma_coupler *c)
{
    PMA_TRY(open_substeps(c));
    if (c->exchange)
        PMA_TRY(pma_messages_begin(c));
    if (c->parts.motion_count > 0)
        pma_coupler_prescribe(c);
    PMA_TRY(pma_coupler_has(c, is_iterated) ? iterate(c) : solve_interface(c));
    PMA_TRY(pma_share(c, close, pma_is_ending));
    return c->exchange ? pma_exchange_jumps(c) : PMA_OK;
}

static pma_status macro_step(pma_coupler *c)
{
    return pma_iteration_step(c, pma_fine_steps);
}

const pma_schedule pma_iterated_schedule = {.check = pma_fine_check,
                                            .instants = pma_fine_instants,
                                            .duty = pma_fine_duty,
                                            .step = macro_step,
                                            .fine_step = fine_step,
                                            .begin = pma_iteration_begin,
                                            .end = pma_iteration_end,
                                            .prepare = pma_iteration_create_fine,
                                            .interface_pieces = pma_messages_pieces,
                                            .move_to = pma_coupler_move_to,
                                            .rebases = true,
                                            .iterates = true,
                                            .internal = true};
