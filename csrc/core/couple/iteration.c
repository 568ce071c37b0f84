#include "couple/iteration.h"

#include <assert.h>
#include <string.h>

#include "couple/inside.h"
#include "memory.h"
#include "object.h"

/* ---- making --------------------------------------------------------------------------------- */

void pma_iteration_destroy(pma_iteration *it)
{
    if (!it)
        return;
    pma_interface_destroy(&it->interface);
    pma_numeric_destroy(&it->H);
    pma_memory_release(it);
}

/* What both kinds need: p multipliers, `own` numbers of the members with `entries` positions, and
 * `extra` numbers that belong to the present. */
static pma_status create(pma_coupler *c, const pma_iteration_parts *parts, size_t own,
                         size_t entries, size_t extra)
{
    const size_t p = c->parts.p;
    const pma_array arrays[] = {PMA_ARRAY(pma_iteration, members, c->parts.count),
                                PMA_ARRAY(pma_iteration, positions, entries),
                                PMA_ARRAY(pma_iteration, own, own),
                                PMA_ARRAY(pma_iteration, lam_begin, p),
                                PMA_ARRAY(pma_iteration, lam_star, p),
                                PMA_ARRAY(pma_iteration, residual, p),
                                PMA_ARRAY(pma_iteration, residual_before, p),
                                PMA_ARRAY(pma_iteration, correction, p),
                                PMA_ARRAY(pma_iteration, scratch, 3 * p),
                                PMA_ARRAY(pma_iteration, terms, p),
                                PMA_ARRAY(pma_iteration, present, extra),
                                PMA_ARRAY(pma_iteration, working, extra),
                                {0}};
    c->iteration = pma_object_create(sizeof *c->iteration, arrays);
    if (!c->iteration)
        return PMA_NO_MEMORY;
    c->iteration->parts = *parts;
    c->iteration->size = extra;
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
        it->members[i] = (pma_iteration_member){.where = it->positions + at, .block = it->own + at};
        PMA_TRY(place_block(it, &m->member.iterated, it->members[i].where));
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
    PMA_TRY(create(c, parts, blocks, blocks, 0));
    PMA_TRY(pma_numeric_create(&parts->H, &c->iteration->H));
    PMA_TRY(pma_interface_create(&c->iteration->H.factor, &c->iteration->interface));
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
    PMA_TRY(create(c, parts, own, 0, 1 + p + pma_broyden_size(p)));
    double *next = c->iteration->own + c->parts.count * p;
    c->iteration->dlam = c->iteration->working + 1;
    c->iteration->broyden = (pma_broyden){.p = p, .state = c->iteration->dlam + p};
    c->iteration->counts = (pma_state_counts){1 + p, pma_broyden_counts(p), PMA_MOST_COUNTED};
    for (size_t i = 0; i < c->parts.count; i++) {
        c->coupled[i].lam = c->iteration->own + i * p;
        c->iteration->members[i].corrections = next;
        next += c->coupled[i].member.substeps;
    }
    return PMA_OK;
}

/* ---- what belongs to the present ------------------------------------------------------------ */

pma_state_array pma_iteration_array(pma_iteration *it)
{
    return (pma_state_array){.name = "shooting",
                             .count = it->size,
                             .values = it->present,
                             .tables = 1,
                             .counts = &it->counts};
}

void pma_iteration_start(pma_iteration *it)
{
    memset(it->present, 0, it->size * sizeof(double));
    it->following = -1;
}

void pma_iteration_begin(pma_coupler *c)
{
    assert(c->iteration);
    pma_iteration *it = c->iteration;
    memcpy(it->working, it->present, it->size * sizeof(double));
    it->stale = true; /* the constant part may be another one */
    const bool follows = it->following == c->present.number;
    for (size_t i = 0; i < c->parts.count; i++)
        it->members[i].known = it->members[i].known && follows;
    it->following = -1;
}

void pma_iteration_end(pma_coupler *c)
{
    pma_iteration *it = c->iteration;
    it->following = c->present.number + 1;
    memcpy(it->present, it->working, it->size * sizeof(double));
}

pma_status pma_iteration_step(pma_coupler *c, pma_status (*step)(pma_coupler *c))
{
    pma_iteration_begin(c);
    PMA_TRY(step(c));
    pma_iteration_end(c);
    return PMA_OK;
}

/* ---- H -------------------------------------------------------------------------------------- */

pma_status pma_iteration_factor(pma_coupler *c)
{
    assert(c->iteration);
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
