#include "member/estimate.h"

#include <math.h>
#include <string.h>

size_t pma_motion_read(const pma_motion_rows *x)
{
    return x->columns == 0 ? 0 : 1 + (x->columns - 1) / x->stride;
}

static double length_of(const pma_recorded_steps *steps, size_t s)
{
    return (double)(steps->end[s] - steps->begin[s]) * steps->h;
}

/* e = u_1 - [u + h v + h^2 (2 w + w_1) / 6]                                                (D1) */
static inline double error(const pma_motion_rows *x, size_t begin, size_t end, double h)
{
    return x->u[end] -
           (x->u[begin] + h * x->v[begin] + h * h * (2.0 * x->w[begin] + x->w[end]) / 6.0);
}

void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, size_t ld,
                         double *e)
{
    const size_t read = pma_motion_read(x);
    for (size_t s = 0; s < steps->count; s++) {
        const size_t begin = (size_t)steps->begin[s] * x->columns;
        const size_t end = (size_t)steps->end[s] * x->columns;
        const double h = length_of(steps, s);
        for (size_t k = 0; k < read; k++)
            e[k * ld + s] = error(x, begin + k * x->stride, end + k * x->stride, h);
    }
}

static void average(const pma_motion_rows *x, const pma_recorded_steps *steps, double *mean)
{
    const size_t read = pma_motion_read(x);
    memset(mean, 0, read * sizeof(double));
    for (size_t s = 0; s < steps->count; s++) {
        const double *u = x->u + (size_t)steps->begin[s] * x->columns;
        for (size_t k = 0; k < read; k++)
            mean[k] += u[k * x->stride];
    }
    for (size_t k = 0; k < read; k++)
        mean[k] /= (double)steps->count;
}

pma_norms pma_estimate_norms(const pma_motion_rows *x, const pma_recorded_steps *steps,
                             const double *mass, double *mean)
{
    const size_t read = pma_motion_read(x);
    double rate = 0.0, motion = 0.0, speed = 0.0, acceleration = 0.0;
    average(x, steps, mean);
    for (size_t s = 0; s < steps->count; s++) {
        const size_t begin = (size_t)steps->begin[s] * x->columns;
        const size_t end = (size_t)steps->end[s] * x->columns;
        const double h = length_of(steps, s);
        double square = 0.0;
        for (size_t k = 0; k < read; k++) {
            const size_t i = begin + k * x->stride;
            const double e = error(x, i, end + k * x->stride, h), d = x->u[i] - mean[k];
            square += mass[k] * (e * e);
            motion += mass[k] * (d * d);
            speed += mass[k] * (x->v[i] * x->v[i]);
            acceleration += mass[k] * (x->w[i] * x->w[i]);
        }
        rate += sqrt(square) / h;
    }
    const double count = (double)steps->count;
    return (pma_norms){.rate = rate / count,
                       .motion = sqrt(motion / count),
                       .speed = sqrt(speed / count),
                       .acceleration = sqrt(acceleration / count)};
}

void pma_estimate_distance(const pma_motion_rows *x, size_t count, const int64_t *levels,
                           const double *mass, const double *mean, double *distance)
{
    const size_t read = pma_motion_read(x);
    for (size_t s = 0; s < count; s++) {
        const double *u = x->u + (size_t)levels[s] * x->columns;
        double square = 0.0;
        for (size_t k = 0; k < read; k++) {
            const double d = u[k * x->stride] - mean[k];
            square += mass[k] * (d * d);
        }
        distance[s] = sqrt(square);
    }
}
