#include "subdomain/scheme.h"

pma_step pma_step_make(pma_scheme s, double h)
{
    const double d = 1.0 - s.am;
    return (pma_step){
        .h = h,
        .al1 = h * h * s.beta * (1.0 - s.af) / d,
        .al2 = h * s.gamma * (1.0 - s.af) / d,
        .u_a = h * h * (0.5 - s.beta / d),
        .u_w = h * h * s.beta * s.af / d,
        .v_a = h * (1.0 - s.gamma / d),
        .v_w = h * s.gamma * s.af / d,
        .a_a = -s.am / d,
        .a_w = s.af / d,
        .a_w1 = (1.0 - s.af) / d,
    };
}

/* ---- estimates ------------------------------------------------------------------------------ */

/* e = u_1 - [u + h v + h^2 (2 w + w_1) / 6]                                                (D1) */
static inline double error(const pma_motion_rows *x, size_t begin, size_t end, double h)
{
    return x->u[end] -
           (x->u[begin] + h * x->v[begin] + h * h * (2.0 * x->w[begin] + x->w[end]) / 6.0);
}

void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, double *e)
{
    for (size_t s = 0; s < steps->count; s++) {
        const size_t begin = (size_t)steps->begin[s] * x->columns;
        const size_t end = (size_t)steps->end[s] * x->columns;
        const double h = (double)(steps->end[s] - steps->begin[s]) * steps->h;
        for (size_t k = 0; k < x->columns; k++)
            e[k * steps->count + s] = error(x, begin + k, end + k, h);
    }
}
