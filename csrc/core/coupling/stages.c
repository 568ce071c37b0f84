/* stages.c - what the schedules share: where members are, the interface problem, the commit. */

#include "coupling/schedule.h"

void pma_coupler_move_to(pma_coupler *c, size_t k)
{
    c->k = k;
    for (size_t i = 0; i < c->parts.count; i++) {
        pma_coupled *m = &c->coupled[i];
        m->now = pma_clock_moment(k, m->ratio);
        if (m->now.phase == 1 || m->step.j != m->now.j)
            m->step = pma_substep_of(c, m, m->now.j);
    }
}

void pma_coupler_prescribe(pma_coupler *c)
{
    const int64_t number = c->present.number * (int64_t)c->fine + (int64_t)c->k - 1;
    const double t = pma_clock_time(c->origin.t, c->parts.dt, c->present.number, c->k, c->fine);
    pma_motion_prescribe(c->parts.motion_count, c->motions, t, number, c->scratch, c->working.g);
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
    H->table->solve(H->self, c->working.lam);
    c->unpolled += H->entries;
    if (pma_is_finite(c->parts.p, c->working.lam))
        return PMA_OK;
    c->failed = find_unstable(c);
    return PMA_NOT_FINITE;
}

bool pma_coupler_poll(pma_coupler *c)
{
    c->unpolled = 0;
    if (c->poll->stop(c->poll->ctx))
        atomic_store(&c->stopped, true);
    return atomic_load(&c->stopped);
}

void pma_coupler_commit(pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++)
        c->coupled[i].member.table->commit(c->coupled[i].member.self);
    pma_macro_level_swap(&c->present, &c->reached);
    c->reached.number = c->present.number;
    c->k -= c->fine;
    if (c->record && c->record->ring)
        pma_record_end(c->record, c->origin.number + c->present.number);
}
