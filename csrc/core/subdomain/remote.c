#include "subdomain/remote.h"

#include <string.h>

#include "memory.h"
#include "object.h"

struct pma_remote {
    pma_remote_parts parts;
    double *before, *after;   /* nb: vf at both ends of the substep at hand */
    double *moving;           /* nb: v, or in mid-step what the multipliers add to it */
    double *displaced;        /* nb: u at the end of the macro step */
    double *displaced_before; /* nb: ... and at the present */
};

pma_status pma_remote_create(const pma_remote_parts *parts, pma_remote **out)
{
    const size_t nb = parts->link.nb;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_remote, before, nb),           PMA_ARRAY(pma_remote, after, nb),
        PMA_ARRAY(pma_remote, moving, nb),           PMA_ARRAY(pma_remote, displaced, nb),
        PMA_ARRAY(pma_remote, displaced_before, nb), {0}};
    *out = NULL;
    PMA_TRY(pma_link_check(&parts->link));
    pma_remote *r = *out = pma_object_create(sizeof *r, arrays);
    if (!r)
        return PMA_NO_MEMORY;
    r->parts = *parts;
    return PMA_OK;
}

void pma_remote_destroy(pma_remote *r)
{
    pma_memory_release(r);
}

static double *target_of(const pma_remote *r, pma_interface_kind kind, size_t j)
{
    switch (kind) {
    case PMA_FREE_VELOCITY:
        return r->after;
    case PMA_BEGINNING_VELOCITY:
        return r->before;
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

/* No other operation is called: a coupler works with the members of its own process. */
static const pma_member_table TABLE = {.values = values};
static const pma_iterated_table ITERATED = {0};

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
        .doubling = pma_doubling_of(p->doubled, p->continues),
        .has_internal = p->has_internal,
        .elsewhere = true,
        .iterated = {.table = p->iterates ? &ITERATED : NULL, .count = p->count, .rows = p->rows}};
}
