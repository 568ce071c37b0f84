#include "rig/adaptive.h"

#include <math.h>
#include <string.h>

enum { TERMS = PMA_ADAPTIVE_TERMS, COEFFICIENTS = 5, ROW = TERMS + 1 };

/* Share of the identity in the least squares, whose columns have length 1: a motion of one
 * frequency has x'' = - w^2 x and tells nothing of one direction of the coefficients. */
static const double RIDGE = 1e-6;

/* Memory of a dof: coefficients, the last three commands and velocities, the output, where it
 * began, the largest |x|, the last three x through the low-pass filter, its states for x and for
 * commands, and the window of samples. */
typedef struct {
    double *a, *d, *v, *output, *begin, *largest, *x, *low, *window;
} adapting;

static size_t numbers_of_dof(const pma_adaptive *p)
{
    return 4 * TERMS + 3 + 4 * p->sections + ROW * p->window;
}

static adapting adapting_at(const pma_adaptive *p, double *own)
{
    double *d = own + TERMS, *v = d + TERMS, *x = v + TERMS, *output = x + TERMS, *low = output + 3;
    return (adapting){.a = own,
                      .d = d,
                      .v = v,
                      .x = x,
                      .output = output,
                      .begin = output + 1,
                      .largest = output + 2,
                      .low = low,
                      .window = low + 4 * p->sections};
}

static void push(double *last, double value)
{
    last[2] = last[1];
    last[1] = last[0];
    last[0] = value;
}

/* out := (x, x', x''), differences backward */
static void differentiate(const double *last, double h, double *out)
{
    out[0] = last[0];
    out[1] = (last[0] - last[1]) / h;
    out[2] = (last[0] - 2.0 * last[1] + last[2]) / (h * h);
}

/* a0 d + a1 d' + a2 d''                                                                    (Y6) */
static double compensated(const pma_adaptive *p, const double *a, const double *last)
{
    double terms[TERMS], sum = 0.0;
    differentiate(last, p->h, terms);
    for (size_t i = 0; i < TERMS; i++)
        sum += a[i] * terms[i];
    return sum;
}

static void compensate(const pma_adaptive *p, double done, double *u, double *v, double *own)
{
    const adapting at = adapting_at(p, own);
    for (size_t i = 0; done == 0.0 && i < TERMS; i++) {
        at.a[i] = p->start[i];
        at.d[i] = *u;
        at.v[i] = *v;
        *at.begin = *u;
    }
    push(at.d, *u);
    push(at.v, *v);
    *u = *at.output = compensated(p, at.a, at.d);
    *v = compensated(p, at.a, at.v);
}

/* The low-pass filter, sections of the second order in the transposed direct form */
static double low_pass(const pma_adaptive *p, double x, double *state)
{
    for (size_t i = 0; i < p->sections; i++, state += 2) {
        const double *c = p->section + COEFFICIENTS * i;
        const double y = c[0] * x + state[0];
        state[0] = c[1] * x - c[3] * y + state[1];
        state[1] = c[2] * x - c[4] * y;
        x = y;
    }
    return x;
}

/* Elimination for a positive definite matrix; b := A^-1 b. */
static void solve(double A[TERMS][TERMS], double *b)
{
    for (size_t k = 0; k < TERMS; k++) {
        for (size_t i = k + 1; i < TERMS; i++) {
            const double factor = A[i][k] / A[k][k];
            for (size_t j = k; j < TERMS; j++)
                A[i][j] -= factor * A[k][j];
            b[i] -= factor * b[k];
        }
    }
    for (size_t k = TERMS; k-- > 0;) {
        for (size_t j = k + 1; j < TERMS; j++)
            b[k] -= A[k][j] * b[j];
        b[k] /= A[k][k];
    }
}

/* change (TERMS): from a to the least squares of  command = x a  over the samples, (Y7); the
 * columns have length 1 */
static void fit(const double *window, size_t samples, const double *a, double *change)
{
    double A[TERMS][TERMS] = {{0.0}}, length[TERMS];
    memset(change, 0, TERMS * sizeof(double));
    for (size_t k = 0; k < samples; k++) {
        const double *row = window + ROW * k;
        double left = row[TERMS];
        for (size_t i = 0; i < TERMS; i++)
            left -= row[i] * a[i];
        for (size_t i = 0; i < TERMS; i++) {
            change[i] += row[i] * left;
            for (size_t j = 0; j < TERMS; j++)
                A[i][j] += row[i] * row[j];
        }
    }
    for (size_t i = 0; i < TERMS; i++)
        length[i] = A[i][i] > 0.0 ? sqrt(A[i][i]) : 1.0;
    for (size_t i = 0; i < TERMS; i++) {
        change[i] /= length[i];
        for (size_t j = 0; j < TERMS; j++)
            A[i][j] /= length[i] * length[j];
        A[i][i] += RIDGE;
    }
    solve(A, change);
    for (size_t i = 0; i < TERMS; i++)
        change[i] /= length[i];
}

/* As far as a coefficient may change in one adaptation, and within its limits. */
static double limited(const pma_adaptive *p, size_t i, double a, double change)
{
    const double up = change > p->change[i] ? p->change[i] : change;
    const double next = a + (up < -p->change[i] ? -p->change[i] : up);
    const double below = next > p->most[i] ? p->most[i] : next;
    return below < p->least[i] ? p->least[i] : below;
}

static double largest_of(const double *window, size_t samples)
{
    double largest = 0.0;
    for (size_t k = 0; k < samples; k++)
        largest = fmax(largest, fabs(window[ROW * k]));
    return largest;
}

/* What was measured is compared with the output, and the coefficients adapt. */
static void learn(const pma_adaptive *p, double done, double measured, double *own)
{
    const adapting at = adapting_at(p, own);
    push(at.x, low_pass(p, measured - *at.begin, at.low));
    const double output = low_pass(p, *at.output - *at.begin, at.low + 2 * p->sections);
    *at.largest = fmax(*at.largest, fabs(at.x[0]));
    if (fmod(done, (double)p->every) != 0.0)
        return;
    const double taken = floor(done / (double)p->every);
    double *row = at.window + ROW * (size_t)fmod(taken, (double)p->window);
    differentiate(at.x, p->h, row);
    row[TERMS] = output;
    const size_t samples = taken + 1.0 < (double)p->window ? (size_t)taken + 1 : p->window;
    const double largest = largest_of(at.window, samples);
    if (4 * samples < p->window || !(largest > 0.0) || largest < p->threshold * *at.largest)
        return;
    double change[TERMS];
    fit(at.window, samples, at.a, change);
    for (size_t i = 0; i < TERMS; i++) {
        if (isfinite(change[i]))
            at.a[i] = limited(p, i, at.a[i], change[i]);
    }
}

static size_t numbers(const void *of, size_t width)
{
    return width * numbers_of_dof(of);
}

static void send(const void *of, size_t width, double done, const pma_command *command,
                 double *memory)
{
    const pma_adaptive *p = of;
    for (size_t i = 0; i < width; i++)
        compensate(p, done, &command->u[i], &command->v[i], memory + i * numbers_of_dof(p));
}

static void receive(const void *of, size_t width, double done, double *x, double *f, double *memory)
{
    const pma_adaptive *p = of;
    (void)f;
    for (size_t i = 0; i < width; i++)
        learn(p, done, x[i], memory + i * numbers_of_dof(p));
}

const pma_filter_kind pma_adaptive_kind = {.numbers = numbers, .send = send, .receive = receive};
