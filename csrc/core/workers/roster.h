/* roster.h - which worker has which subdomain: decided once, from sizes alone.
 *
 * Everything is measured in matrix entries read, so that a roster never depends on a clock. */
#ifndef PMA_ROSTER_H
#define PMA_ROSTER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "status.h"

/* What there is to do for one subdomain. */
typedef struct {
    size_t entries;  /* read by one substep */
    size_t substeps; /* substeps in a macro step */
    bool by_caller;  /* worker 0 has to do it */
    bool parallel;   /* takes double steps: can be left to a worker beside the fine steps */
    bool divides;    /* several workers can do it together, a part each */
} pma_duty;

/* Worker w has the subdomains order[begin[w]]..order[begin[w + 1] - 1], in ascending order. */
typedef struct {
    size_t workers;
    size_t fine;   /* workers of the fine steps; the others have subdomains beside them */
    size_t split;  /* done by all workers of the fine steps, in worker 0's list; or PMA_NO_SPLIT */
    size_t *order; /* one for each subdomain */
    size_t *begin; /* workers + 1 */
    void *block;
} pma_roster;

/* The cost of posting work and waiting for it in one fine step, as entries that could be read
 * meanwhile: some microseconds, and more where threads have fallen asleep. */
#define PMA_MEETING 20000

/* A range of rows is worth a worker if it reads at least this number of entries. */
#define PMA_RANGE (5 * PMA_MEETING)

#define PMA_NO_SPLIT SIZE_MAX

/* At most `workers` workers, as many as there are subdomains and ranges at most; if `worthwhile`,
 * one only unless several save a fifth of the time. Some of them work beside the fine steps where
 * that is faster than if all went with them, and the largest subdomain that divides, of two ranges
 * at least, is split among them where that is.                                   (W1) (W2) (W3) */
pma_status pma_roster_create(size_t count, const pma_duty *duties, size_t workers, bool worthwhile,
                             pma_roster *out);
void pma_roster_destroy(pma_roster *r); /* a zeroed one is allowed */

#endif
