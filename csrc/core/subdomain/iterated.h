/* iterated.h - what a member with internal forces does more, in interface space.         (N11)
 *
 * Its substep is iterated together with the interface: at the iterate it contributes an affine law
 * of its velocity there, L v = o + G Lam, and is given the multipliers that solve the sum of all
 * laws. Or it is iterated alone, under given multipliers. */
#ifndef PMA_ITERATED_H
#define PMA_ITERATED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "solve/newton.h"
#include "state.h"
#include "status.h"

typedef struct {
    /* The first guess of a substep, from the multipliers at its beginning (N4). Evaluates loads
     * and what is evaluated once. */
    pma_status (*begin)(void *self, const pma_substep *step, const double *lam);

    /* Iterates alone, under lam, up to the energy scale of the member itself. PMA_STOPPED when
     * stop, called before each evaluation, returns true. */
    pma_status (*converge)(void *self, const pma_newton *newton, const double *lam,
                           bool (*stop)(void *ctx), void *ctx);

    /* See pma_equations. `linearize` factors the tangent if it is fresh, and makes the law: o is
     * then the free velocity at the end of the substep, G its compliance, and `changed` says
     * whether G is another one than before; lam: the multipliers that `correct` was given last. */
    pma_status (*evaluate)(void *self, bool tangent, pma_measure *measure);
    pma_status (*linearize)(void *self, bool fresh, const double *lam, bool *changed);
    void (*correct)(void *self, const double *lam, pma_measure *measure);
    void (*move)(void *self, double by);
    void (*restart)(void *self, const double *lam);
    void (*remember_rounding)(void *self);

    /* The law in the middle of a substep that ends later (N13): the stored free velocity of its
     * beginning, time level j, follows the new tangent. */
    void (*rebase)(void *self, size_t j, const double *lam);

    /* block (count x count) := G between the constraints of the member */
    void (*block)(void *self, double *block);

    /* The iterate is the state at the end of the substep. */
    pma_status (*finish)(void *self, const double *lam);

    /* The corrections made for the substep that ended at time level j, to be read or written; the
     * energy scale s^2 (N6). */
    double *(*corrections)(void *self, size_t j);
    double (*scale)(const void *self);

    /* Is there a factor, which can be kept? */
    bool (*has_factor)(const void *self);
} pma_iterated_table;

/* The constraints of such a member: their rows, ascending. */
typedef struct {
    const pma_iterated_table *table;
    size_t count;
    const int64_t *rows;
} pma_iterated;

#endif
