#include "member/remote.h"

#include <stdlib.h>
#include <string.h>

struct pma_remote {
    pma_remote_parts parts;
    double *before, *after;   /* nb: vf at both ends of the substep at hand */
    double *moving;           /* nb: v, or in mid-step what the multipliers add to it */
    double *displaced;        /* nb: u at the end of the macro step, or expected there */
    double *displaced_before; /* nb: ... and at the present */
    double *block;
};

pma_status pma_remote_create(const pma_remote_parts *parts, pma_remote **out)
{
    const size_t nb = parts->link.nb;
    *out = NULL;
    const pma_status status = pma_link_check(&parts->link);
    if (status != PMA_OK)
        return status;
    pma_remote *r = calloc(1, sizeof *r);
    if (!r)
        return PMA_NO_MEMORY;
    r->block = calloc(5 * nb + 1, sizeof(double));
    if (!r->block) {
        free(r);
        return PMA_NO_MEMORY;
    }
    r->parts = *parts;
    r->before = r->block;
    r->after = r->block + nb;
    r->moving = r->block + 2 * nb;
    r->displaced = r->block + 3 * nb;
    r->displaced_before = r->block + 4 * nb;
    *out = r;
    return PMA_OK;
}

void pma_remote_destroy(pma_remote *r)
{
    if (!r)
        return;
    free(r->block);
    free(r);
}

static double *target_of(const pma_remote *r, pma_interface_kind kind, size_t j)
{
    switch (kind) {
    case PMA_FREE_VELOCITY:
        return r->after;
    case PMA_BEGINNING_VELOCITY:
        return r->before;
    case PMA_EXPECTED_DISPLACEMENT:
        return r->displaced;
    case PMA_DISPLACEMENT:
        return j > 0 ? r->displaced : r->displaced_before;
    case PMA_VELOCITY:
    case PMA_LINK_VELOCITY:
        break;
    }
    return r->moving;
}

void pma_remote_receive(pma_remote *r, pma_interface_kind kind, size_t j, bool next,
                        const double *values)
{
    double *target = target_of(r, kind, j);
    if (kind == PMA_FREE_VELOCITY && next) {
        target = r->before;
        r->before = r->after;
        r->after = target;
    }
    memcpy(target, values, r->parts.link.nb * sizeof(double));
}

/* ---- values on the interface ---------------------------------------------------------------- */

/* What was received belongs to the operator and to the multipliers. */
static const double *values(void *self, pma_interface_kind kind, size_t j, bool twice,
                            const double *lam)
{
    (void)twice, (void)lam;
    return target_of(self, kind, j);
}

/* ---- what is done elsewhere ----------------------------------------------------------------- */

static pma_status advance(void *self, const pma_substep *closed, const pma_substep *opened,
                          const double *lam, const pma_workers *workers)
{
    (void)self, (void)closed, (void)opened, (void)lam, (void)workers;
    return PMA_OK;
}

static pma_status prepare(void *self, bool ahead, size_t workers)
{
    (void)self, (void)ahead, (void)workers;
    return PMA_OK;
}

static size_t opened(const void *self)
{
    (void)self;
    return 0;
}

static bool is_known(const void *self, const pma_substep *step)
{
    (void)self, (void)step;
    return false;
}

static void record(void *self, pma_recordable what, size_t j, const double *lam,
                   const pma_selection *selection, size_t row)
{
    (void)self, (void)what, (void)j, (void)lam, (void)selection, (void)row;
}

static void commit(void *self)
{
    (void)self;
}

static void shift(void *self, const pma_substep *step, const double *mu)
{
    (void)self, (void)step, (void)mu;
}

static void begin_response(void *self, bool twice, const double *dlam)
{
    (void)self, (void)twice, (void)dlam;
}

static void respond(void *self, size_t j, const double *lam, const double *dlam)
{
    (void)self, (void)j, (void)lam, (void)dlam;
}

static pma_status add_response(void *self, const double *dlam)
{
    (void)self, (void)dlam;
    return PMA_OK;
}

static size_t repeats(const void *self, bool recorded)
{
    (void)self, (void)recorded;
    return 0;
}

/* ---- iterated elsewhere; the coupler receives slopes, laws, blocks and measures ------------- */

static pma_status begin(void *self, const pma_substep *step, const double *lam)
{
    (void)self, (void)step, (void)lam;
    return PMA_OK;
}

static pma_status converge(void *self, const pma_newton *newton, const double *lam,
                           bool (*stop)(void *ctx), void *ctx)
{
    (void)self, (void)newton, (void)lam, (void)stop, (void)ctx;
    return PMA_OK;
}

static pma_status evaluate(void *self, bool tangent, pma_measure *measure)
{
    (void)self, (void)tangent, (void)measure;
    return PMA_OK;
}

static pma_status linearize(void *self, bool fresh, const double *lam, bool *changed)
{
    (void)self, (void)fresh, (void)lam;
    *changed = false;
    return PMA_OK;
}

static void correct(void *self, const double *lam, pma_measure *measure)
{
    (void)self, (void)lam, (void)measure;
}

static void move(void *self, double by)
{
    (void)self, (void)by;
}

static void restart(void *self, const double *lam)
{
    (void)self, (void)lam;
}

static void rebase(void *self, size_t j, const double *lam)
{
    (void)self, (void)j, (void)lam;
}

static void block(void *self, double *out)
{
    (void)self, (void)out;
}

static pma_status finish(void *self, const double *lam)
{
    (void)self, (void)lam;
    return PMA_OK;
}

static bool has_factor(const void *self)
{
    (void)self;
    return true;
}

static const pma_iterated_table ITERATED = {.begin = begin,
                                            .converge = converge,
                                            .evaluate = evaluate,
                                            .linearize = linearize,
                                            .correct = correct,
                                            .move = move,
                                            .restart = restart,
                                            .remember_rounding = commit,
                                            .rebase = rebase,
                                            .block = block,
                                            .finish = finish,
                                            .has_factor = has_factor};

static const pma_member_table TABLE = {.advance = advance,
                                       .opened = opened,
                                       .values = values,
                                       .record = record,
                                       .commit = commit,
                                       .discard = commit,
                                       .prepare = prepare,
                                       .is_known = is_known,
                                       .begin_response = begin_response,
                                       .respond = respond,
                                       .add_response = add_response,
                                       .repeats = repeats,
                                       .hold_energy = begin_response,
                                       .shift = shift};

pma_member pma_remote_member(pma_remote *r)
{
    const pma_remote_parts *p = &r->parts;
    return (pma_member){
        .table = &TABLE,
        .self = r,
        .link = &p->link,
        .substeps = p->substeps,
        .h = p->h,
        .entries = 1,
        .alone = 1,
        .doubling = pma_doubling_of(p->doubled, p->continues),
        .shoots = p->shoots,
        .elsewhere = true,
        .iterated = {.table = p->iterates ? &ITERATED : NULL, .count = p->count, .rows = p->rows}};
}
