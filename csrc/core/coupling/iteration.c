#include "coupling/iteration.h"

#include <stdlib.h>
#include <string.h>

#include "coupling/schedule.h"

/* ---- making --------------------------------------------------------------------------------- */

void pma_iteration_destroy(pma_iteration *it)
{
    if (!it)
        return;
    pma_interface_destroy(&it->interface);
    pma_numeric_destroy(&it->H);
    free(it->members);
    free(it->positions);
    free(it->block);
    free(it);
}

/* What both kinds need: p multipliers, `own` numbers of the members with `entries` positions, and
 * `extra` numbers that belong to the present. */
static pma_status create(pma_coupler *c, const pma_iteration_parts *parts, size_t own,
                         size_t entries, size_t extra)
{
    const size_t p = c->parts.p;
    pma_iteration *it = calloc(1, sizeof *it);
    if (!it)
        return PMA_NO_MEMORY;
    c->iteration = it;
    it->parts = *parts;
    it->size = extra;
    it->members = calloc(c->parts.count + 1, sizeof *it->members);
    it->positions = calloc(entries + 1, sizeof *it->positions);
    it->block = calloc(own + 9 * p + 2 * it->size, sizeof *it->block);
    if (!it->members || !it->positions || !it->block)
        return PMA_NO_MEMORY;
    double *next = it->block + own;
    it->lam_begin = next;
    it->lam_star = next + p;
    it->residual = next + 2 * p;
    it->residual_before = next + 3 * p;
    it->correction = next + 4 * p;
    it->scratch = next + 5 * p;
    it->terms = next + 8 * p;
    it->present = next + 9 * p;
    it->working = it->present + it->size;
    return PMA_OK;
}

static size_t block_size(const pma_coupled *m)
{
    return m->member.iterated.table ? m->member.iterated.count * m->member.iterated.count : 0;
}

/* Where the blocks of a member are in H; PMA_BAD_INDEX where H has no such entry. */
static pma_status place_block(const pma_iteration *it, const pma_iterated *member, int64_t *where)
{
    for (size_t i = 0; i < member->count; i++) {
        for (size_t k = 0; k < member->count; k++) {
            const size_t row = (size_t)member->rows[i], column = (size_t)member->rows[k];
            const size_t entry = pma_numeric_entry(&it->parts.H, row, column);
            if (entry == SIZE_MAX)
                return PMA_BAD_INDEX;
            where[i * member->count + k] = (int64_t)entry;
        }
    }
    return PMA_OK;
}

static pma_status place_blocks(pma_coupler *c)
{
    pma_iteration *it = c->iteration;
    size_t at = 0;
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_coupled *m = &c->coupled[i];
        if (!m->member.iterated.table)
            continue;
        it->members[i] =
            (pma_iteration_member){.where = it->positions + at, .block = it->block + at};
        const pma_status status = place_block(it, &m->member.iterated, it->members[i].where);
        if (status != PMA_OK)
            return status;
        at += block_size(m);
    }
    return PMA_OK;
}

pma_status pma_iteration_create_fine(pma_coupler *c, const pma_iteration_parts *parts)
{
    size_t blocks = 0;
    if (!parts || parts->H.n != c->parts.p || parts->H.nb != c->parts.p)
        return PMA_BAD_SIZE;
    for (size_t i = 0; i < c->parts.count; i++)
        blocks += block_size(&c->coupled[i]);
    pma_status status = create(c, parts, blocks, blocks, 0);
    if (status == PMA_OK)
        status = pma_numeric_create(&parts->H, &c->iteration->H);
    if (status == PMA_OK)
        status = pma_interface_create(&c->iteration->H.factor, &c->iteration->interface);
    if (status != PMA_OK)
        return status;
    c->parts.H = c->parts.H_start = c->iteration->interface;
    return place_blocks(c);
}

pma_status pma_iteration_create_macro(pma_coupler *c, const pma_iteration_parts *parts)
{
    const size_t p = c->parts.p;
    if (!parts || parts->response.n != p || parts->response_start.n != p)
        return PMA_BAD_SIZE;
    size_t own = c->parts.count * p;
    for (size_t i = 0; i < c->parts.count; i++)
        own += c->coupled[i].member.substeps;
    const pma_status status = create(c, parts, own, 0, 1 + p + pma_broyden_size(p));
    if (status != PMA_OK)
        return status;
    double *next = c->iteration->block + c->parts.count * p;
    c->iteration->dlam = c->iteration->working + 1;
    c->iteration->broyden = (pma_broyden){.p = p, .state = c->iteration->dlam + p};
    for (size_t i = 0; i < c->parts.count; i++) {
        c->coupled[i].lam = c->iteration->block + i * p;
        c->iteration->members[i].corrections = next;
        next += c->coupled[i].member.substeps;
    }
    return PMA_OK;
}

/* ---- what belongs to the present ------------------------------------------------------------ */

double *pma_coupler_iteration(pma_coupler *c, size_t *size)
{
    *size = c->iteration ? c->iteration->size : 0;
    return c->iteration ? c->iteration->present : NULL;
}

void pma_iteration_start(pma_iteration *it)
{
    memset(it->present, 0, it->size * sizeof(double));
    it->following = -1;
}

static void forget_blocks(pma_coupler *c)
{
    for (size_t i = 0; i < c->parts.count; i++)
        c->iteration->members[i].known = false;
}

static void begin(pma_coupler *c)
{
    pma_iteration *it = c->iteration;
    memcpy(it->working, it->present, it->size * sizeof(double));
    it->stale = true; /* the constant part may be another one */
    if (it->following != c->present.number)
        forget_blocks(c);
}

static void end(pma_coupler *c, pma_status status)
{
    pma_iteration *it = c->iteration;
    it->following = status == PMA_OK ? c->present.number + 1 : -1;
    if (status == PMA_OK)
        memcpy(it->present, it->working, it->size * sizeof(double));
}

pma_status pma_iteration_step(pma_coupler *c, pma_status (*step)(pma_coupler *c))
{
    begin(c);
    const pma_status status = step(c);
    end(c, status);
    return status;
}

/* ---- H -------------------------------------------------------------------------------------- */

pma_status pma_iteration_factor(pma_coupler *c)
{
    pma_iteration *it = c->iteration;
    const size_t entries = (size_t)it->parts.H.ptr[c->parts.p];
    const double *constant = c->present.number > 0 ? it->parts.later : it->parts.start;
    if (!it->stale)
        return PMA_OK;
    memcpy(it->H.values, constant, entries * sizeof(double));
    for (size_t i = 0; i < c->parts.count; i++) {
        const pma_iteration_member *own = &it->members[i];
        for (size_t k = 0; k < block_size(&c->coupled[i]); k++)
            it->H.values[own->where[k]] += own->block[k];
    }
    size_t column;
    const pma_status status = pma_numeric_factor(&it->H, &column);
    it->stale = status != PMA_OK;
    if (status != PMA_NOT_DEFINITE)
        return status;
    c->failed = PMA_INTERFACE;
    return PMA_SINGULAR;
}
