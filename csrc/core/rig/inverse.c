#include "rig/inverse.h"

#include <math.h>
#include <string.h>

/* What it remembers of `width` commands: the last command d, what was made of it (c) and its
 * velocity, d - x, c and d where the run began, states of the filters, the coefficients of the
 * variations and their covariance (by rows). */
typedef struct {
    double *d, *c, *velocity, *error, *begin_c, *begin_d;
    double *command, *feedback, *regressors, *low, *delta, *P;
} memories;

enum { SIGNALS = 6 };

static size_t numbers(const void *of, size_t width)
{
    const pma_inverse *p = of;
    return SIGNALS * width + p->command.states + p->feedback.states + p->regressors.states +
           p->low.states + p->variations * (1 + p->variations);
}

static memories at(const pma_inverse *p, size_t width, double *memory)
{
    memories m = {.d = memory};
    m.c = m.d + width;
    m.velocity = m.c + width;
    m.error = m.velocity + width;
    m.begin_c = m.error + width;
    m.begin_d = m.begin_c + width;
    m.command = m.begin_d + width;
    m.feedback = m.command + p->command.states;
    m.regressors = m.feedback + p->feedback.states;
    m.low = m.regressors + p->regressors.states;
    m.delta = m.low + p->low.states;
    m.P = m.delta + p->variations;
    return m;
}

/* At rest under the first command; nothing is known of the variations but their deviation, 1. */
static void begin(const pma_inverse *p, const double *d, const memories *m)
{
    pma_modal_rest(&p->command, d, m->command);
    for (size_t j = 0; j < p->variations; j++)
        m->P[j * p->variations + j] = 1.0;
}

/* c (width) := command + sum_j delta_j variation_j, of their outputs y                     (Y16) */
static void sum_up(const pma_inverse *p, size_t width, const double *y, const double *delta,
                   double *c)
{
    memcpy(c, y, width * sizeof(double));
    for (size_t j = 0; j < p->variations; j++) {
        for (size_t i = 0; i < width; i++)
            c[i] += delta[j] * y[(1 + j) * width + i];
    }
}

static void send(const void *of, size_t width, double done, const pma_command *command,
                 double *memory)
{
    const pma_inverse *p = of;
    const memories m = at(p, width, memory);
    double *y = p->work, *input = y + width * (1 + p->variations);
    if (done == 0.0)
        begin(p, command->u, &m);
    memcpy(m.d, command->u, width * sizeof(double));
    /* d + l1 d' + l2 d''                                                                  (Y14) */
    for (size_t i = 0; i < width; i++)
        input[i] = command->u[i] +
                   (done > 0.0 ? p->rate * command->v[i] + p->acceleration * command->a[i] : 0.0);
    pma_modal_filter(&p->command, input, m.command, y);
    sum_up(p, width, y, m.delta, command->u);
    if (p->feedback.states > 0) {
        pma_modal_filter(&p->feedback, m.error, m.feedback, y);
        for (size_t i = 0; i < width; i++)
            command->u[i] += y[i];
    }
    for (size_t i = 0; i < width; i++) {
        command->v[i] = done > 0.0 ? (command->u[i] - m.c[i]) / p->h : 0.0;
        command->a[i] = done > 0.0 ? (command->v[i] - m.velocity[i]) / p->h : 0.0;
        m.c[i] = command->u[i];
        m.velocity[i] = command->v[i];
    }
}

/* One equation  e = r delta + eps  of recursive least squares; r is `stride` apart         (Y16) */
static void learn(const pma_inverse *p, double e, const double *r, size_t stride, double *gain,
                  const memories *m)
{
    const size_t count = p->variations;
    double variance = p->variance;
    for (size_t i = 0; i < count; i++) {
        gain[i] = 0.0;
        for (size_t j = 0; j < count; j++)
            gain[i] += m->P[i * count + j] * r[j * stride];
        variance += gain[i] * r[i * stride];
        e -= m->delta[i] * r[i * stride];
    }
    if (!isfinite(e / variance))
        return;
    for (size_t i = 0; i < count; i++) {
        m->delta[i] = fmax(-p->largest, fmin(m->delta[i] + gain[i] * e / variance, p->largest));
        for (size_t j = 0; j < count; j++)
            m->P[i * count + j] -= gain[i] * gain[j] / variance;
    }
}

static void receive(const void *of, size_t width, double done, double *x, double *f, double *memory)
{
    const pma_inverse *p = of;
    const memories m = at(p, width, memory);
    double *y = p->work, *input = y + width * (1 + p->variations), *c = input + width;
    double *gain = c + width;
    (void)f;
    for (size_t i = 0; i < width; i++)
        m.error[i] = m.d[i] - x[i];
    if (p->variations == 0)
        return;
    if (done == 0.0) {
        memcpy(m.begin_d, m.d, width * sizeof(double)); /* what is measured there has noise */
        memcpy(m.begin_c, m.c, width * sizeof(double));
    }
    for (size_t i = 0; i < width; i++)
        input[i] = x[i] - m.begin_d[i];
    pma_modal_filter(&p->regressors, input, m.regressors, y);
    for (size_t i = 0; i < width; i++)
        input[i] = m.c[i] - m.begin_c[i];
    pma_modal_filter(&p->low, input, m.low, c);
    for (size_t i = 0; i < width; i++)
        learn(p, c[i] - y[i], y + width + i, width, gain, &m);
}

const pma_filter_kind pma_inverse_kind = {.numbers = numbers, .send = send, .receive = receive};
