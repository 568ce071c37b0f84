/* remote.h - a subdomain of another process, as far as the coupler of this one has to know it.
 *
 * Its steps are taken elsewhere. What it has on the interface is received (couple/exchange.h),
 * and multiplied with its L_b here as there: sums over all subdomains are bitwise identical in
 * every process. */
#ifndef PMA_REMOTE_H
#define PMA_REMOTE_H

#include "algebra/link.h"
#include "subdomain/member.h"

/* What a coupler has to know beforehand; the arrays of the link are the caller's. */
typedef struct {
    pma_link link;
    size_t substeps;
    double h;
    bool doubled, continues;
    bool has_internal; /* forces */
    bool iterates;     /* ... its steps, with the interface; then its constraints, ascending */
    size_t count;
    const int64_t *rows;
} pma_remote_parts;

typedef struct pma_remote pma_remote;

pma_status pma_remote_create(const pma_remote_parts *parts, pma_remote **out);
void pma_remote_destroy(pma_remote *r); /* NULL is allowed */

/* For a coupler; r has to outlive it. */
pma_member pma_remote_member(pma_remote *r);

/* Takes values (nb) of this kind at time level j over; `next`: what was the free velocity at the
 * end of a substep is the one at its beginning now. */
void pma_remote_receive(pma_remote *r, pma_interface_kind kind, size_t j, bool next,
                        const double *values);

#endif
