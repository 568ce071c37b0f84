/* messages.c - what processes exchange in an iterated fine step, and in a pass of shooting.
 *
 * To be read with iterated.c and shooting.c: after each of their stages all have the numbers of all
 * members, so that every process goes on with the same sums. */
#include <string.h>

#include "coupling/schedule.h"
#include "member/remote.h"

static pma_iteration_member *member_in(const pma_coupler *c, const pma_coupled *m)
{
    return &c->iteration->members[m - c->coupled];
}

static bool is_iterated(const pma_coupled *m)
{
    return m->member.iterated.table && pma_is_ending(m);
}

/* ---- the beginning of substeps -------------------------------------------------------------- */

/* The free velocity at the end of what has begun; of a long iterated substep also at its beginning,
 * which follows the tangent. That of the others is part of their law. */
size_t pma_messages_pieces(const pma_coupler *c, const pma_coupled *m, size_t round,
                           pma_piece *pieces)
{
    (void)c, (void)round;
    if (m->now.phase != 1 || is_iterated(m))
        return 0;
    pieces[0] = (pma_piece){.kind = PMA_FREE_VELOCITY, .j = m->now.j + 1};
    pieces[1] = (pma_piece){.kind = PMA_BEGINNING_VELOCITY, .j = m->now.j};
    return m->member.iterated.table ? 2 : 1;
}

/* ---- blocks of H ---------------------------------------------------------------------------- */

static size_t block_size(const pma_coupler *c, const pma_coupled *m)
{
    const size_t count = m->member.iterated.count;
    return member_in(c, m)->changed ? count * count : 0;
}

static void write_block(const pma_coupler *c, const pma_coupled *m, double *to)
{
    memcpy(to, member_in(c, m)->block, block_size(c, m) * sizeof(double));
}

static void read_block(pma_coupler *c, const pma_coupled *m, const double *from)
{
    memcpy(member_in(c, m)->block, from, block_size(c, m) * sizeof(double));
}

/* Those that were made since the last interface problem, if any; all know which. */
static pma_status send_blocks(pma_coupler *c)
{
    static const pma_message BLOCKS = {block_size, write_block, read_block};
    for (size_t i = 0; i < c->parts.count; i++) {
        if (block_size(c, &c->coupled[i]) > 0)
            return pma_exchange_message(c, &BLOCKS, PMA_OK);
    }
    return PMA_OK;
}

pma_status pma_messages_begin(pma_coupler *c)
{
    const pma_status status = pma_exchange_interface(c);
    return status == PMA_OK ? send_blocks(c) : status;
}

/* ---- factors -------------------------------------------------------------------------------- */

static size_t one(const pma_coupler *c, const pma_coupled *m)
{
    (void)c;
    return is_iterated(m) ? 1 : 0;
}

static void write_factored(const pma_coupler *c, const pma_coupled *m, double *to)
{
    if (is_iterated(m))
        *to = member_in(c, m)->factored;
}

static void read_factored(pma_coupler *c, const pma_coupled *m, const double *from)
{
    if (is_iterated(m))
        member_in(c, m)->factored = *from != 0.0;
}

pma_status pma_messages_factors(pma_coupler *c)
{
    static const pma_message FACTORS = {one, write_factored, read_factored};
    return pma_exchange_message(c, &FACTORS, PMA_OK);
}

/* ---- measures of residuals and corrections -------------------------------------------------- */

static size_t measure_size(const pma_coupler *c, const pma_coupled *m)
{
    return PMA_MEASURES * one(c, m);
}

static void write_measure(const pma_coupler *c, const pma_coupled *m, double *to)
{
    const pma_measure *own = &member_in(c, m)->measure;
    const double numbers[PMA_MEASURES] = {own->correction, own->motion, own->slope, own->residual};
    memcpy(to, numbers, measure_size(c, m) * sizeof(double));
}

static void read_measure(pma_coupler *c, const pma_coupled *m, const double *from)
{
    if (is_iterated(m))
        member_in(c, m)->measure = (pma_measure){
            .correction = from[0], .motion = from[1], .slope = from[2], .residual = from[3]};
}

pma_status pma_messages_measures(pma_coupler *c)
{
    static const pma_message MEASURES = {measure_size, write_measure, read_measure};
    return pma_exchange_message(c, &MEASURES, PMA_OK);
}

/* the same, and whether the residual of this member was the first that is not finite */
static size_t residual_size(const pma_coupler *c, const pma_coupled *m)
{
    return measure_size(c, m) + one(c, m);
}

static void write_residual(const pma_coupler *c, const pma_coupled *m, double *to)
{
    write_measure(c, m, to);
    if (is_iterated(m))
        to[PMA_MEASURES] = c->iteration->not_finite && c->failed == (size_t)(m - c->coupled);
}

static void read_residual(pma_coupler *c, const pma_coupled *m, const double *from)
{
    const size_t i = (size_t)(m - c->coupled);
    read_measure(c, m, from);
    if (!is_iterated(m) || from[PMA_MEASURES] == 0.0)
        return;
    c->failed = c->iteration->not_finite && c->failed < i ? c->failed : i;
    c->iteration->not_finite = true;
}

/* A residual that is not finite can be answered by a shorter correction, and ends nothing. */
pma_status pma_messages_residuals(pma_coupler *c, pma_status status)
{
    static const pma_message RESIDUALS = {residual_size, write_residual, read_residual};
    c->iteration->not_finite = status == PMA_NOT_FINITE;
    status = pma_exchange_message(c, &RESIDUALS, status == PMA_NOT_FINITE ? PMA_OK : status);
    return status == PMA_OK && c->iteration->not_finite ? PMA_NOT_FINITE : status;
}

/* ---- laws (N11) ----------------------------------------------------------------------------- */

/* o of a law, and whether a block of H follows */
static size_t law_size(const pma_coupler *c, const pma_coupled *m)
{
    (void)c;
    return is_iterated(m) ? 1 + m->member.link->nb : 0;
}

static void write_law(const pma_coupler *c, const pma_coupled *m, double *to)
{
    if (!is_iterated(m))
        return;
    const pma_member_table *table = m->member.table;
    void *self = m->member.self;
    const double *o = table->values(self, PMA_FREE_VELOCITY, m->now.j + 1, false, NULL);
    to[0] = member_in(c, m)->changed;
    memcpy(to + 1, o, m->member.link->nb * sizeof(double));
}

static void read_law(pma_coupler *c, const pma_coupled *m, const double *from)
{
    if (!is_iterated(m))
        return;
    member_in(c, m)->changed = from[0] != 0.0;
    pma_remote_receive(m->member.self, PMA_FREE_VELOCITY, m->now.j + 1, false, from + 1);
}

pma_status pma_messages_laws(pma_coupler *c, pma_status status)
{
    static const pma_message LAWS = {law_size, write_law, read_law};
    status = pma_exchange_message(c, &LAWS, status);
    return status == PMA_OK ? send_blocks(c) : status;
}

/* ---- runs (N14) ----------------------------------------------------------------------------- */

/* Of the end of a run, what is tied there. */
static pma_interface_kind tied_kind(const pma_coupler *c)
{
    const bool is_mean = c->parts.schedule->ties_displacements;
    return is_mean ? PMA_DISPLACEMENT : PMA_VELOCITY;
}

static size_t run_size(const pma_coupler *c, const pma_coupled *m)
{
    (void)c;
    return m->member.shoots ? 3 + m->member.link->nb : 0;
}

static void write_run(const pma_coupler *c, const pma_coupled *m, double *to)
{
    const pma_member *member = &m->member;
    const pma_iteration_member *own = member_in(c, m);
    if (!member->shoots)
        return;
    const double *end =
        member->table->values(member->self, tied_kind(c), member->substeps, false, NULL);
    *to++ = own->kinetic_before;
    *to++ = own->kinetic;
    *to++ = own->scale;
    memcpy(to, end, member->link->nb * sizeof(double));
}

static void read_run(pma_coupler *c, const pma_coupled *m, const double *from)
{
    pma_iteration_member *theirs = member_in(c, m);
    if (!m->member.shoots)
        return;
    theirs->kinetic_before = *from++;
    theirs->kinetic = *from++;
    theirs->scale = *from++;
    pma_remote_receive(m->member.self, tied_kind(c), m->member.substeps, false, from);
}

pma_status pma_messages_runs(pma_coupler *c, pma_status status)
{
    static const pma_message RUNS = {run_size, write_run, read_run};
    return pma_exchange_message(c, &RUNS, status);
}
