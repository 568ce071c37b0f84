/* split.c - one large explicit subdomain by all workers of the fine steps, a range of rows each.
 *
 * With a diagonal Mbar no row waits for another, but K ut wants all of ut: two stages to open a
 * step, one to close it, and what concerns the interface is worker 0's. The ranges are fixed, so
 * that rows stay in the caches of one core. */
#include "coupling/schedule.h"

typedef struct {
    size_t begin, end;
} range;

static range range_of(const pma_coupler *c, const pma_place *at, size_t worker)
{
    const size_t n = pma_subdomain_parts(at->subdomain)->n, each = n / c->roster.fine;
    return (range){worker * each, worker + 1 < c->roster.fine ? (worker + 1) * each : n};
}

static void predict(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    const pma_place *at = &c->places[c->roster.split];
    const range rows = range_of(c, at, worker);
    pma_subdomain_predict_rows(at->subdomain, at->j, rows.begin, rows.end);
}

static void add_forces(void *ctx, size_t worker)
{
    const pma_coupler *c = ctx;
    const pma_place *at = &c->places[c->roster.split];
    const range rows = range_of(c, at, worker);
    const double t1 = pma_instant(c, at->j + 1, at->substeps);
    pma_subdomain_force_rows(at->subdomain, at->j, t1, pma_own_step(c, at), rows.begin, rows.end);
}

static void correct(void *ctx, size_t worker)
{
    pma_coupler *c = ctx;
    const pma_place *at = &c->places[c->roster.split];
    const range rows = range_of(c, at, worker);
    if (!pma_subdomain_correct_rows(at->subdomain, at->j + 1, rows.begin, rows.end))
        atomic_store(&c->not_finite, true);
}

/* Everybody with its range; all wait for the last. */
static void do_together(pma_coupler *c, pma_work stage)
{
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_team_post(c->team, w, stage, c);
    stage(c, 0);
    for (size_t w = 1; w < c->roster.fine; w++)
        pma_team_await(c->team, w);
}

pma_status pma_split_open(pma_coupler *c, pma_place *at)
{
    const double t1 = pma_instant(c, at->j + 1, at->substeps);
    const pma_status status = pma_subdomain_ask(at->subdomain, t1, pma_own_step(c, at));
    if (status != PMA_OK)
        return status;
    do_together(c, predict);
    do_together(c, add_forces);
    pma_subdomain_open_interface(at->subdomain, at->j);
    at->opened = at->j + 1;
    return PMA_OK;
}

pma_status pma_split_close(pma_coupler *c, pma_place *at)
{
    pma_subdomain_close_interface(at->subdomain, at->j + 1, c->lam_work);
    atomic_store(&c->not_finite, false);
    do_together(c, correct);
    if (atomic_load(&c->not_finite))
        return PMA_NOT_FINITE;
    pma_subdomain_close_energy(at->subdomain, at->j + 1, false, c->lam_work);
    return PMA_OK;
}
