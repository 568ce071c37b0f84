/* elimination.h - the numbers of a factor in panels, made by one worker or by several.
 *
 * A supernode is made by one worker, which subtracts the updates of its descendants in ascending
 * order and factors its panel. So the sums do not depend on who makes what, and the factor is
 * bitwise the same for any number of workers. Workers take subtrees of the elimination tree, and
 * above these single supernodes, in an order in which what others wait for comes early; where an
 * update is not there yet they wait for it. */
#ifndef PMA_ELIMINATION_H
#define PMA_ELIMINATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/panels.h"
#include "factor/blas.h"
#include "status.h"

/* A matrix by rows, whose symmetric pattern the panels were made for. If its values are not
 * symmetric, the entries of a row ascend. */
typedef struct {
    size_t n;
    const int64_t *ptr;
    const int32_t *index;
    const double *values;
    double lost;     /* a pivot must be above this part of its diagonal entry */
    double growth;   /* pivots of any sign: most that R_ij D_j Q_ij may be, relative to A_ii */
    bool indefinite; /* symmetric, with pivots of any sign */
} pma_panels_input;

/* What a call of `work` does besides, in the thread of worker 0. */
typedef struct {
    bool (*stop)(void *ctx); /* called after each supernode: true ends the elimination */
    void (*rest)(void);      /* by each worker that waits long; NULL: it looks all the time */
    void *ctx;
} pma_patience;

typedef struct pma_elimination pma_elimination;

/* Threads besides the caller's, which take part where a factor is made again and again. */
typedef struct {
    size_t workers; /* with the caller; 0: it is alone */
    /* Calls pma_elimination_work for all workers, or for some and at least for worker 0, and
     * returns when all of these have returned. */
    void (*work)(void *ctx, pma_elimination *e);
    void (*rest)(void); /* see pma_patience */
    void *ctx;
} pma_crew;

/* Which supernodes update which, and what is done in what order; with scratch for the workers. The
 * panels were checked; owner (n): the supernode of each column. Arrays of the caller, which have to
 * outlive it. Allocates: PMA_NO_MEMORY, *out is NULL then. */
pma_status pma_elimination_create(const pma_panels *p, size_t n, const int64_t *owner,
                                  const pma_blas *blas, size_t workers, pma_elimination **out);
void pma_elimination_destroy(pma_elimination *e); /* NULL is allowed */

/* R, Q and the reciprocals of D; pivots are on the diagonal. Begun by one thread, which is worker
 * 0; done by the workers, all or some of them, each in a thread of its own; ended by one thread
 * when all have returned.
 *
 * Symmetric (p->Q is 0) and not `indefinite`: pivots are positive. Otherwise they have any sign,
 * and what is subtracted from a diagonal entry is bounded by `growth`: A is factored without a loss
 * of digits.                                                                                  (F11)
 * inverse (n): output. PMA_NOT_DEFINITE with the first such column in *column, PMA_BAD_INDEX for an
 * entry outside the pattern or across from none, PMA_STOPPED when stop returned true. */
void pma_elimination_begin(pma_elimination *e, const pma_panels_input *input, double *inverse,
                           const pma_patience *patience);
void pma_elimination_work(pma_elimination *e, size_t worker);
pma_status pma_elimination_end(pma_elimination *e, size_t *column);

/* All three by one worker. */
pma_status pma_elimination_run(pma_elimination *e, const pma_panels_input *input, double *inverse,
                               const pma_patience *patience, size_t *column);

/* In the thread of worker 0, while others work: calls stop. */
void pma_elimination_look(pma_elimination *e);

#endif
