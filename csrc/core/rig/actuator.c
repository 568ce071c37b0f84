#include "rig/actuator.h"

#include <math.h>
#include <string.h>

#include "rig/signals.h"

/* Memory of a dof: the last commands and their velocities in rings, the sum (Y1), and the state. */
static size_t numbers_of_dof(const pma_actuator *a)
{
    return 2 * a->delay.length + 1 + a->order;
}

static size_t numbers(const void *of, size_t width)
{
    return width * numbers_of_dof(of);
}

/* z := phi z + before c0 + after c1                                                        (Y2) */
static void advance(const pma_actuator *a, double c0, double c1, double *z)
{
    double next[PMA_ACTUATOR_ORDER] = {0.0};
    for (size_t i = 0; i < a->order; i++) {
        next[i] = a->before[i] * c0 + a->after[i] * c1;
        for (size_t j = 0; j < a->order; j++)
            next[i] += a->phi[i * a->order + j] * z[j];
    }
    memcpy(z, next, a->order * sizeof(double));
}

static double within(double largest, double c)
{
    const double above = c > largest ? largest : c;
    return above < -largest ? -largest : above;
}

/* Before the first evaluation the command and the actuator were at rest where it begins, the
 * actuator within its saturation. */
static void rest(const pma_actuator *a, double u, double *ring, double *z)
{
    for (size_t i = 0; i < a->delay.length; i++) {
        ring[i] = u;
        ring[a->delay.length + i] = 0.0;
    }
    z[-1] = within(a->largest, u);
    for (size_t i = 0; i < a->order; i++)
        z[i] = i == 0 ? z[-1] : 0.0;
}

/* u and v of a dof, whose noise has this number */
static void move(const pma_actuator *a, double done, uint64_t number, double *u, double *v,
                 double *own)
{
    const size_t length = a->delay.length, now = (size_t)fmod(done, (double)length);
    double *rates = own + length, *sum = rates + length, *z = sum + 1;
    if (done == 0.0)
        rest(a, *u, own, z);
    own[now] = *u;
    rates[now] = *v;
    const double c0 = *sum, wanted = pma_delay_sum(&a->delay, own, now);
    const double c1 = within(a->largest, wanted);
    *sum = c1;
    *v = c1 == wanted ? pma_delay_sum(&a->delay, rates, now) : 0.0;
    if (done > 0.0)
        advance(a, c0, c1, z);
    double x = a->order > 0 ? z[0] : c1;
    if (a->order > 0) {
        *v = a->slope[a->order] * c1;
        for (size_t i = 0; i < a->order; i++)
            *v += a->slope[i] * z[i];
    }
    if (a->noise > 0.0)
        x += a->noise * pma_noise_normal(a->seed, number);
    *u = a->quantum > 0.0 ? a->quantum * nearbyint(x / a->quantum) : x; /* (Y3) */
}

static void send(const void *of, size_t width, double done, const pma_command *command,
                 double *memory)
{
    const pma_actuator *a = of;
    for (size_t i = 0; i < width; i++)
        move(a, done, (uint64_t)done * width + i, &command->u[i], &command->v[i],
             memory + i * numbers_of_dof(a));
}

const pma_filter_kind pma_actuator_kind = {.numbers = numbers, .send = send};
