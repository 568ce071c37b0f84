/* fine.c - a macro step of PM and GC, whole: an interface problem in every fine step.
 *
 * To be read with section 5 of docs/method.md. A macro step is as many fine steps as the finest
 * subdomain has substeps, a fine step the stages of the array STAGES below. A coarser subdomain
 * begins or ends a substep in some fine steps alone; in between its free velocity is interpolated.
 * "pm" and "gc" differ in nothing here: under "pm" the substeps of some subdomains are double, from
 * the time level before (clock.h). Who does the work is known to the executors (executors.c). */
#include <assert.h>
#include <string.h>

#include "couple/inside.h"

/* ---- which numbers of substeps, and what there is to do ------------------------------------- */

size_t pma_fine_instants(const pma_coupler_parts *parts)
{
    size_t most = 1;
    for (size_t i = 0; i < parts->count; i++)
        most = parts->members[i].substeps > most ? parts->members[i].substeps : most;
    return most;
}

/* Stages are not of one length: they are fine steps, and the substeps of all other members whole
 * steps of two of them. */
static bool fits_stages(const pma_member *member, size_t most)
{
    return member->staged ? member->substeps == most : most / member->substeps % 2 == 0;
}

pma_status pma_fine_check(const pma_coupler_parts *parts)
{
    const size_t most = pma_fine_instants(parts);
    const bool staged = pma_parts_are_staged(parts);
    for (size_t i = 0; i < parts->count; i++) {
        if (most % parts->members[i].substeps != 0)
            return PMA_BAD_SIZE;
        if (staged && !fits_stages(&parts->members[i], most))
            return PMA_BAD_SIZE;
    }
    return PMA_OK;
}

pma_duty pma_fine_duty(const pma_member *member)
{
    return (pma_duty){.entries = member->entries,
                      .substeps = member->substeps,
                      .by_caller = member->forces == PMA_BY_CALLER,
                      .divides = member->divides};
}

static pma_duty duty_in_parallel(const pma_member *member)
{
    pma_duty duty = pma_fine_duty(member);
    duty.parallel = member->doubling != PMA_SINGLE && member->forces == PMA_NO_FORCES;
    return duty;
}

/* ---- where all subdomains are ---------------------------------------------------------------- */

/* To the end of the next fine step, from where move_to left it. */
static inline void move_on(pma_coupler *c)
{
    c->k++;
    pma_coupled *const end = c->coupled + c->parts.count;
    for (pma_coupled *m = c->coupled; m < end; m++) {
        if (m->now.phase < m->ratio) {
            m->now.phase++;
            continue;
        }
        m->now = (pma_moment){.j = m->now.j + 1, .phase = 1};
        m->step = pma_substep_of(c, m, m->now.j);
    }
}

/* ---- what is done for all subdomains --------------------------------------------------------- */

/* In a loop of the caller's where it is alone, which is short in a small system. */
static inline pma_status share(pma_coupler *c, pma_task task, pma_due due)
{
    assert(task && due && (c->team || c->roster.workers <= 1));
    if (c->team)
        return pma_teamwork_do(c, task, due);
    for (pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_status status = due(m) ? task(c, m) : PMA_OK;
        if (status != PMA_OK) {
            c->failed = (size_t)(m - c->coupled);
            return status;
        }
    }
    return PMA_OK;
}

pma_status pma_share(pma_coupler *c, pma_task task, pma_due due)
{
    return share(c, task, due);
}

/* ---- free problems (13) --------------------------------------------------------------------- */

static bool begins(const pma_coupled *m)
{
    return m->now.phase == 1 && !(m->ahead && pma_look_ahead_has_open(m, m->now.j));
}

pma_status pma_fine_open(pma_coupler *c, pma_coupled *m)
{
    (void)c;
    assert(m->now.phase == 1);
    return m->member.table->advance(m->member.self, NULL, &m->step, NULL, m->workers);
}

/* The substeps that begin with this fine step, as far as they are not open yet. */
pma_status pma_fine_begin(pma_coupler *c)
{
    c->unpolled += c->entries;
    return share(c, pma_fine_open, begins);
}

/* ---- interface problem (18) ----------------------------------------------------------------- */

void pma_coupler_prescribe(pma_coupler *c)
{
    assert(c->k >= 1 && c->parts.motion_count > 0);
    const int64_t number = c->present.number * (int64_t)c->fine + (int64_t)c->k - 1;
    const double t =
        pma_clock_stage_time(c->origin.t, c->parts.dt, c->present.number, c->k, c->fine, c->staged);
    const bool is_first = (c->k - 1) % c->fine == 0;
    const pma_macro_level *begin = pma_is_pending(c) ? &c->reached : &c->present;
    const pma_macro_level *before = is_first ? begin : &c->working;
    const double length = pma_clock_length(c->k, c->staged);
    const double half = 0.5 * c->parts.dt / (double)(int64_t)c->fine * length;
    for (size_t i = 0; i < c->parts.motion_count; i++) {
        const pma_motion *motion = &c->motions[i];
        memset(c->scratch, 0, motion->load.n * sizeof(double));
        pma_load_add(&motion->load, t, number, c->scratch);
        for (size_t k = 0; k < motion->load.n; k++) {
            const int64_t row = motion->rows[k];
            c->working.moved[row] =
                before->moved[row] + half * (before->g[row] + c->scratch[k]); /* (G2) */
            c->working.g[row] = c->scratch[k];
        }
    }
}

void pma_fine_right_side(pma_coupler *c)
{
    memcpy(c->working.lam, c->working.g, c->parts.p * sizeof(double));
    const pma_coupled *const end = c->coupled + c->parts.count;
    for (const pma_coupled *m = c->coupled; m < end; m++)
        pma_add_free_velocity(m, -1.0, c->working.lam);
}

/* The member whose free velocity made the multipliers infinite. */
static size_t find_unstable(const pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_member *m = &c->coupled[i].member;
        const size_t j = c->coupled[i].now.j + 1;
        if (!pma_is_finite(m->link->nb,
                           m->table->values(m->self, PMA_FREE_VELOCITY, j, false, NULL)))
            return i;
    }
    return PMA_INTERFACE;
}

pma_status pma_coupler_solve(pma_coupler *c)
{
    const pma_interface *H = c->present.number > 0 ? &c->parts.H : &c->parts.H_start;
    pma_interface_solve(H, c->working.lam);
    c->unpolled += H->entries;
    if (pma_is_finite(c->parts.p, c->working.lam))
        return PMA_OK;
    c->failed = find_unstable(c);
    return PMA_NOT_FINITE;
}

/* H Lam = g - sum_i L_i vf_i, vf_i interpolated in mid-step                     (15) (18) (G1) */
pma_status pma_fine_solve(pma_coupler *c)
{
    assert(c->k >= 1 && c->k <= 2 * c->fine);
    if (c->parts.p == 0)
        return PMA_OK;
    if (c->parts.motion_count > 0)
        pma_coupler_prescribe(c);
    pma_fine_right_side(c);
    return pma_coupler_solve(c);
}

/* ---- link problems (14) --------------------------------------------------------------------- */

static bool ends(const pma_coupled *m)
{
    return pma_is_ending(m) && !m->assigned.closes;
}

pma_status pma_fine_close(pma_coupler *c, pma_coupled *m)
{
    assert(pma_is_ending(m));
    return m->member.table->advance(m->member.self, &m->step, NULL, c->working.lam, m->workers);
}

/* The substeps that end with this fine step, but for those that an executor closes. */
static pma_status end_substeps(pma_coupler *c)
{
    return share(c, pma_fine_close, ends);
}

/* ---- the stages of a fine step --------------------------------------------------------------- */

/* What executors do in between: double steps in parallel, sums of several processes. */
static pma_status begun(pma_coupler *c)
{
    return c->has_executors ? pma_executors_begun(c) : PMA_OK;
}

static pma_status solved(pma_coupler *c)
{
    return c->has_executors ? pma_executors_solved(c) : PMA_OK;
}

static pma_status ended(pma_coupler *c)
{
    return c->has_executors ? pma_executors_ended(c) : PMA_OK;
}

static pma_status (*const STAGES[])(pma_coupler *c) = {
    pma_fine_begin, begun,  /* (5) (6) (13)   free problems that begin here, of all subdomains */
    pma_fine_solve, solved, /* (15) (18)      interface problem at the end of this fine step */
    end_substeps,   ended,  /* (14) (8) (9)   link problems that end here, added */
};

static pma_status fine_step(pma_coupler *c)
{
#pragma GCC unroll 6
    for (size_t i = 0; i < sizeof STAGES / sizeof *STAGES; i++)
        PMA_TRY(STAGES[i](c));
    return PMA_OK;
}

/* ---- the macro step -------------------------------------------------------------------------- */

/* (S3)  After the first macro step, for the members that take double steps from now on */
static void rebase(pma_coupler *c)
{
    assert(c->present.number == 0);
    for (const pma_coupled *m = c->own; m < c->end_of_own; m++) {
        const pma_member *member = &m->member;
        if (member->doubling != PMA_SINGLE && member->table->rebase)
            member->table->rebase(member->self, member->substeps, c->working.lam);
    }
}

static inline void move(pma_coupler *c, bool is_first)
{
    if (is_first)
        pma_coupler_move_to(c, c->k + 1);
    else
        move_on(c);
}

static inline void finish(pma_coupler *c)
{
    if (c->present.number == 0 && c->parts.rebased)
        rebase(c);
}

pma_status pma_fine_steps(pma_coupler *c)
{
    for (size_t i = 0; i < c->fine; i++) {
        move(c, i == 0);
        if (pma_coupler_is_stopped(c))
            return PMA_STOPPED;
        PMA_TRY(c->pace ? pma_coupler_take_paced(c) : c->parts.schedule->fine_step(c));
        if (c->record)
            pma_recorder_write(c);
    }
    finish(c);
    return PMA_OK;
}

pma_status pma_fine_take(pma_coupler *c)
{
    assert(!c->team && c->k < c->fine);
    const pma_schedule *schedule = c->parts.schedule;
    if (c->k == 0 && schedule->begin)
        schedule->begin(c);
    move(c, c->k == 0);
    PMA_TRY(schedule->fine_step(c));
    if (c->k < c->fine)
        return PMA_OK;
    finish(c);
    if (schedule->end)
        schedule->end(c);
    return PMA_OK;
}

/* The free velocity at the end of every substep that has begun. */
static size_t interface_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                               pma_piece *pieces)
{
    (void)c, (void)round;
    pieces[0] = (pma_piece){.kind = PMA_FREE_VELOCITY, .j = m->now.j + 1};
    return m->now.phase == 1 ? 1 : 0;
}

const pma_schedule pma_fine_schedule = {.check = pma_fine_check,
                                        .instants = pma_fine_instants,
                                        .duty = duty_in_parallel,
                                        .step = pma_fine_steps,
                                        .fine_step = fine_step,
                                        .interface_pieces = interface_pieces,
                                        .move_to = pma_coupler_move_to,
                                        .rebases = true,
                                        .internal = true};
