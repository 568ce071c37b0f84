#include "rig/linkage.h"

#include <math.h>
#include <string.h>

static size_t numbers(const void *of, size_t width)
{
    (void)of, (void)width;
    return 0;
}

/* ---- a matrix ------------------------------------------------------------------------------- */

/* x (n) := A x, or A^T x */
static void multiply(size_t n, const double *A, bool transposed, double *work, double *x)
{
    memset(work, 0, n * sizeof(double));
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++)
            work[i] += (transposed ? A[j * n + i] : A[i * n + j]) * x[j];
    }
    memcpy(x, work, n * sizeof(double));
}

/* ---- two arms ------------------------------------------------------------------------------- */

/* x_i = x + l_i (cos(theta - alpha_i) - cos alpha_i)                                       (Y17) */
static void send_to_arms(const pma_linkage *p, const pma_command *d)
{
    const double x = d->u[0], theta = d->u[1], v = d->v[0], rate = d->v[1], a = d->a[0];
    for (size_t i = 0; i < 2; i++) {
        const double l = p->length[i], angle = theta - p->angle[i];
        d->u[i] = x + l * (cos(angle) - cos(p->angle[i]));
        d->v[i] = v - l * sin(angle) * rate;
    }
    const double spin = d->a[1];
    for (size_t i = 0; i < 2; i++) {
        const double l = p->length[i], angle = theta - p->angle[i];
        d->a[i] = a - l * sin(angle) * spin - l * cos(angle) * rate * rate;
    }
}

/* x_1 - x_2 = P (cos theta - 1) + Q sin theta: the theta of the two that is nearer to 0 */
static double rotation(const pma_linkage *p, const double *x)
{
    const double P = p->length[0] * cos(p->angle[0]) - p->length[1] * cos(p->angle[1]);
    const double Q = p->length[0] * sin(p->angle[0]) - p->length[1] * sin(p->angle[1]);
    const double ratio = (x[0] - x[1] + P) / hypot(P, Q);
    const double turn = asin(fmax(-1.0, fmin(ratio, 1.0))), phase = atan2(P, fabs(Q));
    return copysign(1.0, Q) * (turn - phase);
}

static void receive_from_arms(const pma_linkage *p, double *x, double *f)
{
    const double theta = rotation(p, x), l = p->length[0], alpha = p->angle[0];
    double moment = 0.0;
    for (size_t i = 0; i < 2; i++)
        moment -= p->length[i] * sin(theta - p->angle[i]) * f[i];
    x[0] -= l * (cos(theta - alpha) - cos(alpha));
    x[1] = theta;
    f[0] += f[1];
    f[1] = moment;
}

/* ---- both ----------------------------------------------------------------------------------- */

static void send(const void *of, size_t width, double done, const pma_command *command,
                 double *memory)
{
    const pma_linkage *p = of;
    (void)done, (void)memory;
    if (p->has_arms) {
        send_to_arms(p, command);
        return;
    }
    multiply(width, p->matrix, false, p->work, command->u);
    multiply(width, p->matrix, false, p->work, command->v);
    multiply(width, p->matrix, false, p->work, command->a);
}

static void receive(const void *of, size_t width, double done, double *x, double *f, double *memory)
{
    const pma_linkage *p = of;
    (void)done, (void)memory;
    if (p->has_arms) {
        receive_from_arms(p, x, f);
        return;
    }
    multiply(width, p->inverse, false, p->work, x);
    multiply(width, p->matrix, true, p->work, f);
}

const pma_filter_kind pma_linkage_kind = {.numbers = numbers, .send = send, .receive = receive};
