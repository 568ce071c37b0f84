#include "rig/linear.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "rig/signals.h"

/* Memory: the number of evaluations, the last commands in a ring for each input, the command that
 * is followed (c), and the state (z). */
size_t pma_linear_numbers(const pma_linear *p)
{
    return 1 + p->inputs * (p->delay.length + 1) + p->states;
}

static double rounded(double quantum, double x)
{
    return quantum > 0.0 ? quantum * nearbyint(x / quantum) : x;
}

/* y (rows) := or += A x */
static void multiply(size_t rows, size_t columns, const double *A, const double *x, bool adds,
                     double *y)
{
    for (size_t i = 0; i < rows; i++) {
        double sum = adds ? y[i] : 0.0;
        for (size_t j = 0; j < columns; j++)
            sum += A[i * columns + j] * x[j];
        y[i] = sum;
    }
}

/* c := commands late (Y1), as the converter and the actuator take them */
static void take_commands(const pma_linear *p, double done, const double *u, double *ring,
                          double *c)
{
    const size_t length = p->delay.length, now = (size_t)fmod(done, (double)length);
    for (size_t i = 0; i < p->inputs; i++, ring += length) {
        for (size_t k = 0; done == 0.0 && k < length; k++)
            ring[k] = u[i];
        ring[now] = u[i];
        const double wanted = pma_delay_sum(&p->delay, ring, now);
        c[i] = rounded(p->quantum, fmax(-p->largest, fmin(wanted, p->largest)));
    }
}

static void add_noise(const pma_linear *p, double done, double *x, double *f)
{
    const size_t m = p->inputs;
    const uint64_t number = (uint64_t)done * 2 * m;
    for (size_t i = 0; i < m; i++) {
        if (p->noise > 0.0)
            x[i] += p->noise * pma_noise_normal(p->seed, number + i);
        if (p->force_noise > 0.0)
            f[i] += p->force_noise * pma_noise_normal(p->seed, number + m + i);
        x[i] = rounded(p->quantum, x[i]);
    }
}

void pma_linear_evaluate(const pma_linear *p, double *u, double *f, double *memory)
{
    const size_t m = p->inputs, s = p->states;
    double *ring = memory + 1, *c = ring + m * p->delay.length, *z = c + m;
    const double done = *memory;
    if (done > 0.0) {
        multiply(s, s, p->phi, z, false, p->work);
        multiply(s, m, p->before, c, true, p->work);
    }
    take_commands(p, done, u, ring, c);
    /* z := phi z + before c(k) + after c(k + 1)                                           (Y13) */
    multiply(s, m, done > 0.0 ? p->after : p->rest, c, done > 0.0, p->work);
    memcpy(z, p->work, s * sizeof(double));
    multiply(m, s, p->displacement, z, false, u);
    multiply(m, s, p->force, z, false, f);
    add_noise(p, done, u, f);
    *memory += 1.0;
}
