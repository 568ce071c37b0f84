/* tied.c - the schedule "gc" with displacements tied, too, at macro time levels.
 *
 * To be read with section 5 of docs/method.md, (V1) to (V5). All fine steps are those of fine.c but
 * the last one of a macro step: there the predictors of the substeps that end are shifted so that
 * displacements and velocities of all sides agree. */
#include <string.h>

#include "coupling/schedule.h"

static pma_status check(const pma_coupler_parts *parts)
{
    for (size_t i = 0; i < parts->count; i++) {
        const pma_member *member = &parts->members[i];
        if (!(member->elsewhere || member->table->shift) || member->doubling != PMA_SINGLE)
            return PMA_BAD_SIZE;
    }
    return parts->S_mu.p == parts->p ? pma_fine_check(parts) : PMA_BAD_SIZE;
}

/* (V5)  from the fine step before to this one; prescribed velocities in both */
static void move_jump(pma_coupler *c, const double *g_before)
{
    const double half = 0.5 * c->parts.dt / (double)c->fine;
    for (size_t i = 0; i < c->parts.motion_count; i++) {
        for (size_t k = 0; k < c->motions[i].load.n; k++) {
            const int64_t row = c->motions[i].rows[k];
            c->working.d[row] += half * (g_before[row] + c->working.g[row]);
        }
    }
}

static pma_status shift(pma_coupler *c, pma_coupled *m)
{
    m->member.table->shift(m->member.self, &m->step, c->dlam);
    return PMA_OK;
}

/* S_mu mu = d - sum L u, the displacements under working.lam                                (V4) */
static void find_shift(pma_coupler *c)
{
    double *mu = c->dlam;
    memset(c->sums, 0, c->parts.p * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_coupled *m = &c->coupled[i];
        const double *u = m->member.table->values(m->member.self, PMA_EXPECTED_DISPLACEMENT,
                                                  m->step.j + 1, m->step.twice, c->working.lam);
        pma_link_gather(m->member.link, 1.0, u, c->sums);
    }
    for (size_t row = 0; row < c->parts.p; row++)
        mu[row] = c->working.d[row] - c->sums[row];
    pma_interface_solve(&c->parts.S_mu, mu);
    c->unpolled += c->parts.S_mu.entries;
}

static pma_status solve(pma_coupler *c)
{
    if (c->exchange)
        PMA_TRY(pma_exchange_interface(c));
    return pma_fine_solve(c);
}

/* (V1), (V2), (V4), and the interface problem once more */
static pma_status shift_all(pma_coupler *c)
{
    if (c->exchange)
        PMA_TRY(pma_exchange_interface(c));
    find_shift(c);
    PMA_TRY(pma_share(c, shift, pma_is_any));
    return solve(c);
}

static pma_status fine_step(pma_coupler *c)
{
    if (c->k == 1)
        memcpy(c->working.d, c->present.d, c->parts.p * sizeof(double));
    memcpy(c->sums, c->k == 1 ? c->present.g : c->working.g, c->parts.p * sizeof(double));
    PMA_TRY(pma_fine_begin(c));
    PMA_TRY(solve(c));
    move_jump(c, c->sums);
    if (c->k == c->fine)
        PMA_TRY(shift_all(c));
    PMA_TRY(pma_fine_end(c));
    return c->exchange ? pma_exchange_jumps(c) : PMA_OK;
}

/* In the last fine step also the displacements that are expected, and the free velocities once they
 * are shifted. */
static size_t interface_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                               pma_piece *pieces)
{
    if (round <= c->fine)
        return pma_fine_pieces(m, pieces);
    const bool shifted = round > c->fine + 1;
    pieces[0] = (pma_piece){.kind = shifted ? PMA_FREE_VELOCITY : PMA_EXPECTED_DISPLACEMENT,
                            .j = m->now.j + 1};
    return 1;
}

static void move_to(pma_coupler *c, size_t k)
{
    pma_coupler_move_to(c, k < c->fine ? k : c->fine);
}

const pma_schedule pma_tied_schedule = {.check = check,
                                        .instants = pma_fine_instants,
                                        .duty = pma_fine_duty,
                                        .step = pma_fine_steps,
                                        .fine_step = fine_step,
                                        .interface_pieces = interface_pieces,
                                        .move_to = move_to,
                                        .more_rounds = 2,
                                        .shoots = true};
