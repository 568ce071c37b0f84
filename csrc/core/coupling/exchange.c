#include "coupling/exchange.h"

#include <stdlib.h>
#include <string.h>

#include "coupling/schedule.h"
#include "member/remote.h"

/* The rounds of a macro step, in their order: one for each interface problem, and where a time
 * level is recorded one for the jumps there; two more for tied displacements; one after (S3); at
 * last all agree to commit. PRESENT is that before the first macro step of a call. */
typedef enum { PRESENT, INTERFACE, JUMP, REBASED, AGREEMENT } round;

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
    c->exchange = calloc(1, sizeof *c->exchange);
    if (!c->exchange)
        return PMA_NO_MEMORY;
    c->exchange->parts = *parts;
    return parts->first[parts->ranks] == (int64_t)c->parts.count ? PMA_OK : PMA_BAD_SIZE;
}

void pma_exchange_destroy(pma_exchange *x)
{
    free(x);
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
    if (solved >= fine && solved < fine + c->parts.schedule->more_rounds)
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
    if (x->solved < c->fine + c->parts.schedule->more_rounds)
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

pma_status pma_exchange_message(pma_coupler *c, const pma_message *message, pma_status status)
{
    return meet(c, message, status);
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
