#include "couple/exchange.h"

#include <assert.h>
#include <string.h>

#include "couple/inside.h"
#include "memory.h"
#include "subdomain/remote.h"

/* The rounds of a macro step, in their order: one for each interface problem, and where a time
 * level is recorded one for the jumps there; one after (S3); at
 * last all agree to commit. PRESENT is that before the first macro step of a call. */
typedef enum { PRESENT, INTERFACE, JUMP, REBASED, AGREEMENT } round;

/* What every member sends in a round of another kind: its numbers, as many in all processes. */
typedef struct {
    size_t (*size)(const pma_coupler *c, const pma_coupled *m);
    void (*write)(const pma_coupler *c, const pma_coupled *m, double *to);
    void (*read)(pma_coupler *c, const pma_coupled *m, const double *from);
} pma_message;

struct pma_exchange {
    pma_exchange_parts parts;
    size_t solved;        /* rounds INTERFACE in this macro step */
    bool jumped, rebased; /* is the round after the last of them done? */
    round now;            /* the one at hand */
    bool ended;           /* all know that something failed, or that nothing did */
    size_t failed;        /* the first rank in which it did */
};

size_t pma_exchange_size(size_t ranks, size_t count, const pma_member *members)
{
    size_t size = ranks;
    for (size_t i = 0; i < count; i++) {
        const pma_iterated *iterated = &members[i].iterated;
        const size_t values = PMA_MOST_PIECES * members[i].link->nb + PMA_MEASURES + 1;
        const size_t block = iterated->table ? iterated->count * iterated->count : 0;
        size += block > values ? block : values;
    }
    return size;
}

pma_status pma_exchange_create(pma_coupler *c, const pma_exchange_parts *parts)
{
    c->parts.exchange = NULL; /* c->exchange has it */
    if (!parts)
        return PMA_OK;
    c->exchange = pma_memory_allocate(1, sizeof *c->exchange);
    if (!c->exchange)
        return PMA_NO_MEMORY;
    c->exchange->parts = *parts;
    if (parts->first[parts->ranks] != (int64_t)c->parts.count)
        return PMA_BAD_SIZE;
    c->own = c->coupled + parts->first[parts->rank];
    c->end_of_own = c->coupled + parts->first[parts->rank + 1];
    return PMA_OK;
}

void pma_exchange_destroy(pma_exchange *x)
{
    pma_memory_release(x);
}

size_t pma_coupler_failed_rank(const pma_coupler *c)
{
    return c->exchange->failed;
}

/* ---- which round is next, and what is sent in it -------------------------------------------- */

/* Is the fine step of the last interface problem solved, and its end recorded? */
static bool is_recorded(const pma_coupler *c)
{
    const size_t solved = c->exchange->solved, fine = c->fine;
    if (!c->record || c->parts.p == 0 || solved == 0)
        return false;
    return pma_recorder_row(c, solved < fine ? solved : fine, fine) != PMA_NO_ROW;
}

static bool changes_over(const pma_coupler *c)
{
    return c->parts.schedule->rebases && c->parts.rebased && c->present.number == 0;
}

static round next_round(const pma_coupler *c)
{
    const pma_exchange *x = c->exchange;
    if (!x->jumped && is_recorded(c))
        return JUMP;
    if (x->solved < c->fine)
        return INTERFACE;
    return changes_over(c) && !x->rebased ? REBASED : AGREEMENT;
}

static size_t jump_pieces(const pma_coupler *c, const pma_coupled *m, pma_piece *pieces)
{
    const bool ends = pma_is_ending(m);
    pieces[0] = (pma_piece){.kind = ends ? PMA_VELOCITY : PMA_LINK_VELOCITY, .j = m->now.j + 1};
    pieces[1] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = m->member.substeps};
    return c->k % c->fine == 0 ? 2 : 1;
}

static size_t pieces_of(const pma_coupler *c, const pma_coupled *m, round now, pma_piece *pieces)
{
    switch (now) {
    case PRESENT:
        pieces[0] = (pma_piece){.kind = PMA_FREE_VELOCITY, .j = 0};
        pieces[1] = (pma_piece){.kind = PMA_VELOCITY, .j = 0};
        pieces[2] = (pma_piece){.kind = PMA_DISPLACEMENT, .j = 0};
        return 3;
    case INTERFACE:
        return c->parts.schedule->interface_pieces(c, m, c->exchange->solved + 1, pieces);
    case JUMP:
        return jump_pieces(c, m, pieces);
    case REBASED:
        pieces[0] = (pma_piece){.kind = PMA_FREE_VELOCITY, .j = m->member.substeps};
        return m->member.doubling != PMA_SINGLE;
    case AGREEMENT:
        break;
    }
    return 0;
}

static size_t piece_numbers(const pma_coupler *c, const pma_coupled *m)
{
    pma_piece pieces[PMA_MOST_PIECES];
    return pieces_of(c, m, c->exchange->now, pieces) * m->member.link->nb;
}

static void write_pieces(const pma_coupler *c, const pma_coupled *m, double *to)
{
    pma_piece pieces[PMA_MOST_PIECES];
    const size_t count = pieces_of(c, m, c->exchange->now, pieces), nb = m->member.link->nb;
    for (size_t k = 0; k < count; k++, to += nb) {
        const double *values = m->member.table->values(m->member.self, pieces[k].kind, pieces[k].j,
                                                       m->step.twice, c->working.lam);
        memcpy(to, values, nb * sizeof(double));
    }
}

static void read_pieces(pma_coupler *c, const pma_coupled *m, const double *from)
{
    const round now = c->exchange->now;
    const bool moves = now == INTERFACE && c->exchange->solved < c->fine;
    pma_piece pieces[PMA_MOST_PIECES];
    const size_t count = pieces_of(c, m, now, pieces), nb = m->member.link->nb;
    for (size_t k = 0; k < count; k++, from += nb)
        pma_remote_receive(m->member.self, pieces[k].kind, pieces[k].j, moves, from);
}

static const pma_message PIECES = {piece_numbers, write_pieces, read_pieces};

/* ---- a round -------------------------------------------------------------------------------- */

/* Sizes and places of what each rank sends: a status, and the numbers of its members. */
static void lay_out(const pma_coupler *c, const pma_message *message)
{
    const pma_exchange_parts *x = &c->exchange->parts;
    int start = 0;
    for (size_t r = 0; r < x->ranks; r++) {
        size_t count = 1;
        for (int64_t i = x->first[r]; i < x->first[r + 1]; i++)
            count += message->size(c, &c->coupled[i]);
        x->starts[r] = start;
        x->counts[r] = (int)count;
        start += (int)count;
    }
}

static void send(const pma_coupler *c, const pma_message *message, pma_status status)
{
    const pma_exchange_parts *x = &c->exchange->parts;
    double *next = x->all + x->starts[x->rank];
    *next++ = (double)status;
    if (status != PMA_OK) {
        memset(next, 0, (size_t)(x->counts[x->rank] - 1) * sizeof(double));
        return;
    }
    for (int64_t i = x->first[x->rank]; i < x->first[x->rank + 1]; i++) {
        const size_t size = message->size(c, &c->coupled[i]);
        message->write(c, &c->coupled[i], next);
        next += size;
    }
}

static void receive(pma_coupler *c, const pma_message *message, size_t rank)
{
    const pma_exchange_parts *x = &c->exchange->parts;
    const double *next = x->all + x->starts[rank] + 1;
    for (int64_t i = x->first[rank]; i < x->first[rank + 1]; i++) {
        const size_t size = message->size(c, &c->coupled[i]);
        message->read(c, &c->coupled[i], next);
        next += size;
    }
}

/* The first rank that has failed, or `ranks`. */
static size_t find_failed(const pma_exchange_parts *x)
{
    size_t r = 0;
    while (r < x->ranks && x->all[x->starts[r]] == (double)PMA_OK)
        r++;
    return r;
}

static pma_status meet(pma_coupler *c, const pma_message *message, pma_status status)
{
    assert(c->exchange);
    pma_exchange *x = c->exchange;
    const pma_exchange_parts *parts = &x->parts;
    lay_out(c, message);
    send(c, message, status);
    if (!parts->gather(parts->ctx, parts->all, parts->counts, parts->starts)) {
        x->ended = true;
        x->failed = parts->rank;
        return PMA_ELSEWHERE;
    }
    x->failed = find_failed(parts);
    x->ended = x->failed < parts->ranks;
    if (x->ended)
        return status == PMA_OK ? PMA_ELSEWHERE : status;
    for (size_t r = 0; r < parts->ranks; r++) {
        if (r != parts->rank)
            receive(c, message, r);
    }
    return PMA_OK;
}

pma_status pma_exchange_present(pma_coupler *c, pma_status status)
{
    c->exchange->ended = false;
    c->exchange->now = PRESENT;
    return meet(c, &PIECES, status);
}

void pma_exchange_begin(pma_coupler *c)
{
    c->exchange->solved = 0;
    c->exchange->ended = false;
    c->exchange->jumped = c->exchange->rebased = false;
}

/* The next round, whichever it is. */
static pma_status meet_next(pma_coupler *c, pma_status status)
{
    pma_exchange *x = c->exchange;
    const round now = x->now = next_round(c);
    if (now == INTERFACE && status != PMA_OK)
        c->parts.schedule->move_to(c, x->solved + 1); /* where the others are */
    status = meet(c, &PIECES, status);
    if (now == INTERFACE) {
        x->solved++;
        x->jumped = false;
    }
    x->jumped = x->jumped || now == JUMP;
    x->rebased = x->rebased || now == REBASED;
    return status;
}

pma_status pma_exchange_interface(pma_coupler *c)
{
    return meet_next(c, PMA_OK);
}

pma_status pma_exchange_jumps(pma_coupler *c)
{
    return next_round(c) == JUMP ? meet_next(c, PMA_OK) : PMA_OK;
}

pma_status pma_exchange_fail(pma_coupler *c, pma_status status)
{
    const pma_exchange_parts *x = &c->exchange->parts;
    if (c->exchange->ended || c->failed == PMA_INTERFACE)
        return status;
    size_t r = 0;
    while ((int64_t)c->failed >= x->first[r + 1])
        r++;
    c->exchange->ended = true;
    c->exchange->failed = r;
    return r == x->rank ? status : PMA_ELSEWHERE;
}

bool pma_exchange_is_ended(const pma_coupler *c)
{
    return c->exchange && c->exchange->ended;
}

pma_status pma_exchange_agree(pma_coupler *c, pma_status status)
{
    if (atomic_load(&c->stopped))
        status = PMA_STOPPED;
    if (status == PMA_OK && next_round(c) == REBASED)
        status = meet_next(c, PMA_OK);
    if (!c->exchange->ended)
        status = meet_next(c, status);
    c->exchange->ended = true;
    return status;
}

/* ---- in an iterated fine step, and in a pass of shooting --------------------------------------
 *
 * To be read with iterated_fine.c and shooting.c: all come to each of their stages with what
 * happened so far, and have the numbers of all members then, so that all processes go on with the
 * same sums. */

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
    pma_iteration_member *theirs = member_in(c, m);
    memcpy(theirs->block, from, block_size(c, m) * sizeof(double));
    theirs->known = theirs->known || theirs->changed;
}

/* Those that were made since the last interface problem, if any; all know which. */
static pma_status send_blocks(pma_coupler *c)
{
    static const pma_message BLOCKS = {block_size, write_block, read_block};
    for (size_t i = 0; i < c->parts.count; i++) {
        if (block_size(c, &c->coupled[i]) > 0)
            return meet(c, &BLOCKS, PMA_OK);
    }
    return PMA_OK;
}

pma_status pma_messages_begin(pma_coupler *c)
{
    PMA_TRY(pma_exchange_interface(c));
    return send_blocks(c);
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
    return meet(c, &FACTORS, PMA_OK);
}

/* ---- measures of residuals and corrections -------------------------------------------------- */

static size_t measure_size(const pma_coupler *c, const pma_coupled *m)
{
    return PMA_MEASURES * one(c, m);
}

static void write_measure(const pma_coupler *c, const pma_coupled *m, double *to)
{
    const pma_measure *own = &member_in(c, m)->measure;
    const double numbers[PMA_MEASURES] = {own->correction, own->motion, own->slope,   own->residual,
                                          own->pull,       own->leap,   own->rounded, own->departs};
    memcpy(to, numbers, measure_size(c, m) * sizeof(double));
}

static void read_measure(pma_coupler *c, const pma_coupled *m, const double *from)
{
    if (is_iterated(m))
        member_in(c, m)->measure = (pma_measure){.correction = from[0],
                                                 .motion = from[1],
                                                 .slope = from[2],
                                                 .residual = from[3],
                                                 .pull = from[4],
                                                 .leap = from[5],
                                                 .rounded = from[6],
                                                 .departs = from[7]};
}

pma_status pma_messages_measures(pma_coupler *c)
{
    static const pma_message MEASURES = {measure_size, write_measure, read_measure};
    return meet(c, &MEASURES, PMA_OK);
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
    status = meet(c, &RESIDUALS, status == PMA_NOT_FINITE ? PMA_OK : status);
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
    PMA_TRY(meet(c, &LAWS, status));
    return send_blocks(c);
}

/* ---- runs (N14) ----------------------------------------------------------------------------- */

static size_t run_size(const pma_coupler *c, const pma_coupled *m)
{
    (void)c;
    return m->member.has_internal ? 3 + m->member.link->nb : 0;
}

static void write_run(const pma_coupler *c, const pma_coupled *m, double *to)
{
    const pma_member *member = &m->member;
    const pma_iteration_member *own = member_in(c, m);
    if (!member->has_internal)
        return;
    const double *end = member->table->values(member->self, c->parts.schedule->tie->kind,
                                              member->substeps, false, NULL);
    *to++ = own->kinetic_before;
    *to++ = own->kinetic;
    *to++ = own->scale;
    memcpy(to, end, member->link->nb * sizeof(double));
}

static void read_run(pma_coupler *c, const pma_coupled *m, const double *from)
{
    pma_iteration_member *theirs = member_in(c, m);
    if (!m->member.has_internal)
        return;
    theirs->kinetic_before = *from++;
    theirs->kinetic = *from++;
    theirs->scale = *from++;
    pma_remote_receive(m->member.self, c->parts.schedule->tie->kind, m->member.substeps, false,
                       from);
}

pma_status pma_messages_runs(pma_coupler *c, pma_status status)
{
    static const pma_message RUNS = {run_size, write_run, read_run};
    return meet(c, &RUNS, status);
}
