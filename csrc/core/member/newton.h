/* newton.h - Newton's method for equations that are residuals with a tangent.              (N3)
 *
 * The equations are those of one subdomain under given multipliers, or of all subdomains that end a
 * substep together with the interface: the iteration is the same, and knows them by a table. */
#ifndef PMA_NEWTON_H
#define PMA_NEWTON_H

#include <stdbool.h>
#include <stddef.h>

#include "status.h"

typedef struct {
    double tolerance;  /* of the error after the last correction, as a part of the motion */
    size_t iterations; /* at most */
    bool reuse;        /* a tangent is kept until convergence slows down */
} pma_newton;

/* Energies, which are squares: e^2, s^2 and e_0^2 of (N5) to (N8). Scaling of single dofs does not
 * change them; of several subdomains, sums. */
typedef struct {
    double correction; /* e^2 = al1 dw . Mbar_t dw                                          (N5) */
    double motion;     /* the largest du . Mbar_t du / al1 so far, du over a substep        (N6) */
    double rounding;   /* of the terms of the residual                                      (N8) */
    double slope;      /* al2 dw . R before the correction */
    double residual;   /* no energy: the largest |R| before the correction, in parts of the
                        * rounding of the terms of its row                                (N21) */
} pma_measure;

static inline void pma_measure_add(pma_measure *sum, const pma_measure *m)
{
    sum->correction += m->correction;
    sum->motion += m->motion;
    sum->rounding += m->rounding;
    sum->slope += m->slope;
    sum->residual = m->residual > sum->residual ? m->residual : sum->residual;
}

/* Operations on the iterate. Those that return a status end the iteration with it, but that a value
 * which is not finite can be answered by a shorter step. */
typedef struct {
    /* The residual R at the iterate, with its tangent if wanted; slope: al2 dw . R, dw the last
     * correction. */
    pma_status (*evaluate)(void *ctx, bool tangent, double *slope);
    /* A correction, with the tangent factored before if it is new. */
    pma_status (*correct)(void *ctx, bool fresh, pma_measure *measure);
    /* The iterate goes on along the last correction by this part of it; by -1: back. */
    void (*move)(void *ctx, double by);
    /* The iterate is the first guess again. */
    void (*restart)(void *ctx);
    /* The motion so far counts as at least this many times the energy of the last correction. */
    void (*raise)(void *ctx, double factor);
} pma_equations;

/* Iterates until the error is below the tolerance. PMA_NOT_CONVERGED, or what an operation comes
 * back with.
 *
 * has_factor: is there a factor that can be kept? */
pma_status pma_newton_solve(const pma_newton *newton, const pma_equations *equations, void *ctx,
                            bool has_factor);

#endif
