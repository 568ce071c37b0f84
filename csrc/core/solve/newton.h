/* newton.h - Newton's method for equations that are residuals with a tangent.              (N3)
 *
 * The equations are those of one subdomain under given multipliers, or of all subdomains that end a
 * substep together with the interface: the iteration is the same, and knows them by a table. */
#ifndef PMA_NEWTON_H
#define PMA_NEWTON_H

#include <stdbool.h>
#include <stddef.h>

#include "status.h"

/* A residual that is this many times the one that the correction began with has jumped.  (N9) */
#define PMA_LEAP 1e3

/* A residual that is rounding is small against the forces in its row up to this part of them; a
 * larger one is accepted only where the tangent is that of the forces.                    (N21) */
#define PMA_SMALL 1e-3

/* Iterations that a description may allow: files of a stranger have a bound of time. */
enum { PMA_MOST_ITERATIONS = 1000 };

typedef struct {
    double tolerance;  /* of a residual and of the error after the last correction          (N7) */
    size_t iterations; /* at most, 1..PMA_MOST_ITERATIONS */
    bool reuse;        /* a tangent is kept until convergence slows down */
} pma_newton;

/* What is measured of the residual at an iterate, and of a correction. Energies are squares: e^2
 * and s^2 of (N5) and (N6); of several subdomains, sums. Parts are the largest of all rows. */
typedef struct {
    double correction; /* e^2 = al1 dw . Mbar_t dw                                          (N5) */
    double motion;     /* the largest du . Mbar_t du / al1 so far, du over a substep        (N6) */
    double slope; /* al2 dw . R: of the last correction at the iterate, of one at its beginning */
    double residual; /* |R| in parts of the forces in its row, 0 where it is rounding (N7) (N8) */
    double pull;     /* of a correction: |L^T dLam| in parts of what is rounding in its row (N8) */
    double leap;     /* the residual in parts of that which the last correction began with  (N9) */
    double rounded;  /* |R| in parts of the forces in its row, of rows in which it is rounding */
    double departs;  /* of a subdomain in which that is not small, |s(x) - (1 - x) s(0)| over
                        x |s(0)| of its own slope                                          (N21) */
} pma_measure;

static inline void pma_measure_add(pma_measure *sum, const pma_measure *m)
{
    sum->correction += m->correction;
    sum->motion += m->motion;
    sum->slope += m->slope;
    sum->residual = m->residual > sum->residual ? m->residual : sum->residual;
    sum->pull = m->pull > sum->pull ? m->pull : sum->pull;
    sum->leap = m->leap > sum->leap ? m->leap : sum->leap;
    sum->rounded = m->rounded > sum->rounded ? m->rounded : sum->rounded;
    sum->departs = m->departs > sum->departs ? m->departs : sum->departs;
}

/* Operations on the iterate. Those that return a status end the iteration with it, but that a value
 * which is not finite can be answered by a shorter step. */
typedef struct {
    /* The residual R at the iterate, with its tangent if wanted; measures all but a correction. */
    pma_status (*evaluate)(void *ctx, bool tangent, pma_measure *measure);
    /* A correction, with the tangent factored before if it is new; measures it. */
    pma_status (*correct)(void *ctx, bool fresh, pma_measure *measure);
    /* The iterate goes on along the last correction by this part of it; by -1: back. */
    void (*move)(void *ctx, double by);
    /* The iterate is the first guess again. */
    void (*restart)(void *ctx);
    /* The residuals of this substep are rounding, and such of their size are from now on. (N9) */
    void (*remember_rounding)(void *ctx);
} pma_equations;

/* Iterates until residual and error are below the tolerance. PMA_NOT_CONVERGED, or what an
 * operation comes back with.
 *
 * has_factor: is there a factor that can be kept? */
pma_status pma_newton_solve(const pma_newton *newton, const pma_equations *equations, void *ctx,
                            bool has_factor);

#endif
