/* ring.h - the time levels of what watches a subdomain: the present, that before it, and those of
 * the macro step at hand, which take turns. Each is a struct of the one who watches. */
#ifndef PMA_RING_H
#define PMA_RING_H

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>

typedef struct {
    size_t substeps; /* of a macro step */
    size_t kept;     /* levels after the present */
    bool doubled;    /* the level before the present is used */
    void **at;       /* kept + 2: the present, those after it, and that before it */
} pma_ring;

/* After the present: with responses all of a macro step, otherwise those from which the next
 * substeps go on, and that at its end. */
static inline pma_ring pma_ring_of(size_t substeps, bool doubled, bool has_responses)
{
    const size_t turns = doubled ? 3 : 2;
    const size_t kept = substeps <= 2 ? 2 : has_responses ? substeps : turns;
    return (pma_ring){.substeps = substeps, .kept = kept, .doubled = doubled};
}

/* Of kept + 2 levels of this size; r->at has been allocated. */
static inline void pma_ring_fill(pma_ring *r, const pma_ring *of, void *levels, size_t size)
{
    r->substeps = of->substeps;
    r->kept = of->kept;
    r->doubled = of->doubled;
    for (size_t k = 0; k < r->kept + 2; k++)
        r->at[k] = (char *)levels + k * size;
}

/* Time level j, counted from the present. Valid until the next commit. */
static inline void *pma_ring_at(const pma_ring *r, size_t j)
{
    assert(j <= r->substeps);
    return r->at[j == 0 ? 0 : 1 + (j - 1) % r->kept];
}

/* Time level j - 1, from which a double step goes on that ends at j + 1. */
static inline void *pma_ring_before(const pma_ring *r, size_t j)
{
    return j > 0 ? pma_ring_at(r, j - 1) : r->at[r->kept + 1];
}

static inline void pma_ring_swap(void **a, void **b)
{
    void *kept = *a;
    *a = *b;
    *b = kept;
}

/* The last time level becomes the present, and the one before it that before the present. */
static inline void pma_ring_commit(pma_ring *r)
{
    const size_t last = r->substeps;
    if (r->doubled)
        pma_ring_swap(&r->at[r->kept + 1], &r->at[last == 1 ? 0 : 1 + (last - 2) % r->kept]);
    pma_ring_swap(&r->at[0], &r->at[1 + (last - 1) % r->kept]);
}

#endif
