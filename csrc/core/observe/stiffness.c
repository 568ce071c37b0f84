#include "observe/stiffness.h"

#include <string.h>

#include "algebra/lanes.h"

/* x . A x of a lane */
static double square(const pma_stiffness *s, const pma_matrix *A, const double *x, size_t lane,
                     double *product)
{
    if (A->form == PMA_ZERO)
        return 0.0;
    memset(product, 0, s->n * sizeof(double));
    pma_matrix_subtract(A, x, product);
    return -pma_dot(s->n, s->lanes, lane, x, product);
}

/* d := to - from */
static void subtract(size_t n, const double *from, const double *to, double *d)
{
    for (size_t i = 0; i < n; i++)
        d[i] = to[i] - from[i];
}

/* stiff (dr + K du) . du over du . M du, or  (stiff dr - al1 K_r du - inert K du) . du */
static double of_displacement(const pma_stiffness *s, const pma_step_limits *step, const double *du,
                              const double *dr, size_t lane, double *product)
{
    const double k = pma_dot(s->n, s->lanes, lane, du, dr);
    if (!(k > 0.0))
        return 0.0;
    const double m = square(s, &s->M, du, lane, product);
    if (!(m > 0.0))
        return 0.0;
    const double K = square(s, &s->K, du, lane, product);
    if (s->is_explicit) /* a step that is too long for K alone is not that of the forces */
        return step->stiff * K < m ? step->stiff * (k + K) / m : 0.0;
    const double K_r = square(s, &s->K_r, du, lane, product);
    return (step->stiff * k - step->al1 * K_r - step->inert * K) / m;
}

/* (damp dr - (2 damp - h) D_r dv) . dv over dv . M dv, since v1 - vs1 = (2 damp - h) w1 */
static double of_velocity(const pma_stiffness *s, const pma_step_limits *step, const double *dv,
                          const double *dr, size_t lane, double *product)
{
    const double m = square(s, &s->M, dv, lane, product);
    if (!(m > 0.0))
        return 0.0;
    const double D_r = square(s, &s->D_r, dv, lane, product);
    return (step->damp * pma_dot(s->n, s->lanes, lane, dv, dr) -
            (2.0 * step->damp - step->h) * D_r) /
           m;
}

pma_excess pma_stiffness_excess(const pma_stiffness *s, const pma_step_limits *step,
                                const pma_evaluation_at *from, const pma_evaluation_at *to,
                                size_t lane, double *scratch)
{
    double *d = scratch, *dr = scratch + s->n, *product = scratch + 2 * s->n;
    pma_excess excess = {.displacement = 0.0};
    subtract(s->n, from->total, to->total, dr);
    subtract(s->n, from->ut, to->ut, d);
    excess.displacement = of_displacement(s, step, d, dr, lane, product);
    if (to->vs && excess.displacement > 1.0) {
        subtract(s->n, from->vs, to->vs, d);
        excess.velocity = of_velocity(s, step, d, dr, lane, product);
    }
    return excess;
}
