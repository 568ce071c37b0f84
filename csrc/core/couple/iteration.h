/* iteration.h - what a coupler iterates with when some members have internal forces.      (N12)
 *
 * The interface matrix follows the tangents: it is the sum of a constant part, of the members that
 * are not iterated, and of a block for each of the others. */
#ifndef PMA_ITERATION_H
#define PMA_ITERATION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/matrix.h"
#include "factor/numeric.h"
#include "solve/broyden.h"
#include "solve/interface.h"
#include "solve/newton.h"
#include "state.h"
#include "status.h"

/* Bare arrays of the caller, which have to outlive the coupler. */
typedef struct {
    pma_newton newton;

    /* pm and gc: the pattern of H, and the entries of its constant part, in the first macro step
     * and after it */
    pma_numeric_parts H;
    const double *start, *later;

    /* macro: the sum over the members without internal forces of what dLam adds to their velocities
     * at the end of a macro step, in the first macro step and after it */
    pma_matrix response_start, response;
    pma_matrix H_size; /* the size of the entries of H */
} pma_iteration_parts;

/* A member that is iterated. */
typedef struct {
    /* pm and gc */
    int64_t *where; /* count x count: entries of H */
    double *block;  /* count x count: its part of H */
    bool known;     /* the block follows its tangent, */
    bool changed;   /* ... and was made since the last interface problem */
    bool factored;  /* there is a factor, which can be kept */
    pma_measure measure;
    /* macro */
    double *corrections; /* substeps: made in all passes of a macro step */
    double kinetic_before, kinetic,
        scale; /* v . M v at the present, at the end; of the iteration */
} pma_iteration_member;

typedef struct {
    pma_iteration_parts parts;
    pma_numeric H;
    pma_interface interface;
    pma_iteration_member *members; /* one for each member; those that are not iterated are empty */
    bool stale;                    /* some block has changed since H was factored */
    double *lam_begin;             /* p: the multipliers at the beginning of the substeps at hand */
    double *lam_star;              /* p: those of the residuals at hand */
    int64_t following;             /* macro step for which the blocks are known; -1: none */

    /* macro: the increment of the multipliers, the residual, the last correction, B ~ H^-1 */
    double *dlam, *residual, *residual_before, *correction;
    double *scratch; /* 3 p */
    double *terms;   /* p: the size of what is summed in the residual */
    double moved;    /* |Lam| . |H| |Lam| */
    pma_broyden broyden;

    /* macro: what belongs to the present, and the same of the macro step at hand: the energy scale,
     * the increment of the multipliers, B */
    double *present, *working;
    size_t size;
    pma_state_counts counts; /* among these, of B */

    /* what the members are asked to do at the moment */
    bool tangent, fresh;
    double by;
    bool not_finite; /* the residual of some member, of any process */
    bool pulls;      /* pm and gc: the last correction has changed multipliers, */
    bool parted;     /* ... and the iterate is where constraints do not hold */

    int64_t *positions; /* of the blocks of all members, or of nothing; */
    double *own;        /* ... and the blocks; or multipliers and corrections of the members */
} pma_iteration;

typedef struct pma_coupler pma_coupler;

/* For the iterations of a fine step, or of a macro step (shooting). The interface of the former
 * replaces H of the coupler's parts. */
pma_status pma_iteration_create_fine(pma_coupler *c, const pma_iteration_parts *parts);
pma_status pma_iteration_create_macro(pma_coupler *c, const pma_iteration_parts *parts);
void pma_iteration_destroy(pma_iteration *it); /* NULL is allowed */

/* A start: nothing has moved, nothing is known. */
void pma_iteration_start(pma_iteration *it);

/* What the present keeps, by its name in files. */
pma_state_array pma_iteration_array(pma_iteration *it);

/* A macro step, from what the present keeps; what it leaves is kept if all went well. And what is
 * done before and after its fine steps. */
void pma_iteration_begin(pma_coupler *c);
void pma_iteration_end(pma_coupler *c);
pma_status pma_iteration_step(pma_coupler *c, pma_status (*step)(pma_coupler *c));

/* H as the blocks are now, factored. PMA_SINGULAR. */
pma_status pma_iteration_factor(pma_coupler *c);

#endif
