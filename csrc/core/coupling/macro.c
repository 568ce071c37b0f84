/* macro.c - macro coupling: multipliers linear over the macro step, one interface problem in it.
 *
 * Every subdomain makes its own steps for itself, twice: with the loads and the multipliers of the
 * beginning held, and under the ramp by which the multipliers turn out to go on. */
#include <string.h>

#include "coupling/schedule.h"

/* Before an own step. Worker 0 asks, the others hear of it. */
static bool asked_to_stop(const pma_coupler *c, const pma_place *at)
{
    pma_run *run = c->run;
    if (at->mine && run->poll && run->unpolled >= run->poll->entries) {
        run->unpolled = 0;
        if (run->poll->stop(run->poll->ctx))
            atomic_store(&run->stopped, true);
    }
    if (at->mine)
        run->unpolled += at->entries;
    return atomic_load(&run->stopped);
}

/* ---- the record: known values are left in it, responses added ------------------------------ */

/* What is kept of the own nodes in mid macro step, or NULL. */
static const pma_record_nodes *inner_nodes(const pma_coupler *c, const pma_place *at)
{
    const pma_record *record = c->run->record;
    const pma_record_nodes *nodes = record ? &record->nodes[at - c->places] : NULL;
    return nodes && record->every == 0 && nodes->count + nodes->springs > 0 ? nodes : NULL;
}

static size_t row_of(const pma_coupler *c, const pma_place *at, size_t j)
{
    return pma_record_row(c->run->record, c->step_count, j, at->substeps);
}

/* ---- known run (M2) -------------------------------------------------------------------------- */

/* The step to own node j+1 as far as it is known: with the multipliers of the beginning held */
static pma_status known_step(const pma_coupler *c, const pma_place *at, size_t j)
{
    const bool twice = pma_is_double(c, at);
    const double t1 = pma_instant(c, j + 1, at->substeps);
    const int64_t step = c->step_count * (int64_t)at->substeps + (int64_t)j;
    const pma_status status = pma_subdomain_open(at->subdomain, j, twice, t1, step);
    if (status != PMA_OK)
        return status;
    if (at->substeps > 1)
        return pma_subdomain_close(at->subdomain, j + 1, false, c->lam);
    pma_subdomain_hold(at->subdomain, twice, c->lam); /* (M6): closed when all is known */
    return PMA_OK;
}

static pma_status know(const pma_coupler *c, pma_place *at)
{
    const pma_record_nodes *inner = inner_nodes(c, at);
    for (size_t j = 0; j < at->substeps; j++) {
        if (asked_to_stop(c, at))
            return PMA_STOPPED;
        const pma_status status = known_step(c, at, j);
        if (status != PMA_OK)
            return status;
        if (inner && j + 1 < at->substeps)
            pma_record_state(inner, pma_subdomain_at(at->subdomain, j + 1), row_of(c, at, j + 1));
    }
    return PMA_OK;
}

/* ---- interface (M4) ------------------------------------------------------------------------ */

/* H dLam = g - sum_i L_i v_i(known)                                                 (M4) (G1) */
static pma_status solve_interface(pma_coupler *c)
{
    const size_t p = c->parts.p;
    for (size_t row = 0; row < p; row++)
        c->lam_work[row] = -c->g_work[row];
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_place *at = &c->places[i];
        if (at->substeps > 1)
            pma_subdomain_total_velocity(at->subdomain, at->substeps, c->lam_work);
        else
            pma_subdomain_free_velocity(at->subdomain, 0, 1.0, 1.0, c->lam_work);
    }
    for (size_t row = 0; row < p; row++)
        c->lam_work[row] = -c->lam_work[row];
    const pma_status status = pma_coupler_solve(c);

    /* (M1)  Lam_{n+1} = Lam_n + dLam */
    memcpy(c->dlam, c->lam_work, p * sizeof(double));
    for (size_t row = 0; row < p; row++)
        c->lam_work[row] = c->lam[row] + c->dlam[row];
    return status;
}

/* ---- response (M3), added (M5) ------------------------------------------------------------- */

/* The substeps up to `last` once more, from rest under the ramp of dLam */
static pma_status repeat(const pma_coupler *c, const pma_place *at, size_t last)
{
    const pma_record_nodes *inner = inner_nodes(c, at);
    for (size_t j = 1; j <= last; j++) {
        if (asked_to_stop(c, at))
            return PMA_STOPPED;
        pma_subdomain_respond(at->subdomain, j, c->dlam);
        if (pma_subdomain_has_energy(at->subdomain))
            pma_subdomain_add_works(at->subdomain, j, c->lam, c->dlam);
        if (inner && j < at->substeps)
            pma_record_add(inner, pma_subdomain_response(at->subdomain), row_of(c, at, j));
    }
    return PMA_OK;
}

/* Where the response is stored, the substeps are repeated for the record and the energy alone, and
 * the state at the end is the same to the last bit, asked for them or not. */
static pma_status respond(const pma_coupler *c, pma_place *at)
{
    const bool energy = pma_subdomain_has_energy(at->subdomain);
    const bool reached = pma_subdomain_parts(at->subdomain)->nb > 0; /* by any condition */
    pma_status status = PMA_OK;
    if (at->substeps == 1)
        return pma_subdomain_close(at->subdomain, 1, pma_is_double(c, at), c->lam_work);
    if (energy || (reached && !pma_subdomain_is_stored(at->subdomain)))
        status = repeat(c, at, at->substeps);
    else if (reached && inner_nodes(c, at))
        status = repeat(c, at, at->substeps - 1);
    if (status != PMA_OK || !reached)
        return status;
    return pma_subdomain_add_response(at->subdomain, c->dlam);
}

/* ---- the schedule ---------------------------------------------------------------------------- */

static bool everybody(const pma_place *at)
{
    return at->phase == 0;
}

static pma_status known_and_response(pma_coupler *c)
{
    pma_status status = pma_coupler_share(c, know, everybody);
    if (status != PMA_OK)
        return status;
    pma_coupler_prescribe(c, 1);
    status = solve_interface(c);
    if (status != PMA_OK)
        return status;
    return pma_coupler_share(c, respond, everybody);
}

pma_status pma_macro_step(pma_coupler *c, const pma_record *record, const pma_poll *poll)
{
    c->k = 1;
    pma_run run = {.record = record, .poll = poll, .unpolled = c->unpolled};
    atomic_init(&run.stopped, false);
    c->run = &run;
    c->unpolled = 0;
    pma_status status = known_and_response(c);
    c->unpolled += run.unpolled;
    c->run = NULL;
    if (atomic_load(&run.stopped))
        return PMA_STOPPED; /* whatever else went wrong */
    for (size_t i = 0; i < c->parts.count; i++)
        c->places[i].j = c->places[i].substeps;
    if (status == PMA_OK && record)
        pma_coupler_record(c, record);
    return status;
}
