#include "member/specimen.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

enum { TERMS = PMA_ADAPTIVE_TERMS, COEFFICIENTS = 5, ROW = TERMS + 1 };

/* Share of the identity in the least squares, whose columns have length 1: a motion of one
 * frequency has x'' = - w^2 x and tells nothing of one direction of the coefficients. */
static const double RIDGE = 1e-6;

/* ---- an actuator ---------------------------------------------------------------------------- */

/* Memory of a dof: the last commands and their velocities in rings, the sum (Y1), and the state. */
static size_t actuator_numbers(const pma_actuator *a)
{
    return 2 * a->length + 1 + a->order;
}

/* sum_i w_i d(k - l_i)                                                                     (Y1) */
static double weighted(const pma_actuator *a, const double *ring, size_t now)
{
    double sum = 0.0;
    for (size_t i = 0; i < a->taps; i++)
        sum += a->weight[i] * ring[(now + a->length - (size_t)a->lag[i]) % a->length];
    return sum;
}

/* Equidistributed in (0, 1): a hash of a counter, so that nothing else is remembered of it. */
static double uniform(uint64_t seed, uint64_t number)
{
    uint64_t z = seed + (number + 1) * UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    z ^= z >> 31;
    return ((double)(z >> 12) + 0.5) * 0x1p-52;
}

/* Normally distributed: Box and Muller */
static double normal(uint64_t seed, uint64_t number)
{
    const double two_pi = 6.283185307179586;
    return sqrt(-2.0 * log(uniform(seed, 2 * number))) *
           cos(two_pi * uniform(seed, 2 * number + 1));
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

/* Before the first evaluation the command and the actuator were at rest where it begins. */
static void rest(const pma_actuator *a, double u, double *ring, double *z)
{
    for (size_t i = 0; i < a->length; i++) {
        ring[i] = u;
        ring[a->length + i] = 0.0;
    }
    z[-1] = u;
    for (size_t i = 0; i < a->order; i++)
        z[i] = i == 0 ? u : 0.0;
}

static void move(const pma_actuator *a, double done, size_t dof, size_t n, double *u, double *v,
                 double *own)
{
    const size_t now = (size_t)fmod(done, (double)a->length);
    double *rates = own + a->length, *sum = rates + a->length, *z = sum + 1;
    if (done == 0.0)
        rest(a, *u, own, z);
    own[now] = *u;
    rates[now] = *v;
    const double c0 = *sum, wanted = weighted(a, own, now);
    const double above = wanted > a->largest ? a->largest : wanted;
    const double c1 = above < -a->largest ? -a->largest : above;
    *sum = c1;
    *v = c1 == wanted ? weighted(a, rates, now) : 0.0;
    if (done > 0.0)
        advance(a, c0, c1, z);
    double x = a->order > 0 ? z[0] : c1;
    if (a->order > 0) {
        *v = a->slope[a->order] * c1;
        for (size_t i = 0; i < a->order; i++)
            *v += a->slope[i] * z[i];
    }
    if (a->noise > 0.0)
        x += a->noise * normal(a->seed, (uint64_t)done * n + dof);
    *u = a->quantum > 0.0 ? a->quantum * nearbyint(x / a->quantum) : x; /* (Y3) */
}

/* ---- adaptive compensation ------------------------------------------------------------------ */

/* Memory of a dof: coefficients, the last three commands and velocities, the output, where it
 * began, the largest |x|, the last three x through the low-pass filter, its states for x and for
 * commands, and the window of samples. */
typedef struct {
    double *a, *d, *v, *output, *begin, *largest, *x, *low, *window;
} adapting;

static size_t adaptive_numbers(const pma_adaptive *p)
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

/* ---- a specimen ----------------------------------------------------------------------------- */

static size_t numbers_of_dof(const pma_filter *f)
{
    return f->adaptive ? adaptive_numbers(f->adaptive) : actuator_numbers(&f->actuator);
}

/* The number of evaluations, and for each dof what the type needs; an adaptive one begins each with
 * its coefficients. */
static size_t numbers_of_filter(const pma_filter *f, size_t n)
{
    return 1 + n * numbers_of_dof(f);
}

size_t pma_specimen_numbers(const pma_specimen *s)
{
    size_t numbers = s->n + pma_springs_numbers(&s->springs);
    for (size_t k = 0; k < s->count; k++)
        numbers += numbers_of_filter(&s->filters[k], s->n);
    return numbers;
}

static void pass(const pma_filter *f, size_t n, double *u, double *v, double *memory)
{
    double *own = memory + 1;
    for (size_t i = 0; i < n; i++, own += numbers_of_dof(f)) {
        if (f->adaptive)
            compensate(f->adaptive, *memory, &u[i], &v[i], own);
        else
            move(&f->actuator, *memory, i, n, &u[i], &v[i], own);
    }
}

static void adapt(const pma_filter *f, size_t n, const double *measured, double *memory)
{
    double *own = memory + 1;
    for (size_t i = 0; f->adaptive && i < n; i++, own += numbers_of_dof(f))
        learn(f->adaptive, *memory, measured[i], own);
    *memory += 1.0;
}

static bool is_allowed(const pma_specimen *s, const double *u, const double *v)
{
    pma_cell *cell = s->cell;
    if (!cell || !cell->allows)
        return true;
    cell->refused = !cell->allows(cell->self, s->number, u, v);
    return !cell->refused;
}

int pma_specimen_evaluate(const pma_specimen *s, double t, double *u, double *v, double *r,
                          double *memory)
{
    const size_t n = s->n;
    double *own = memory + n;
    for (size_t k = 0; k < s->count; k++) {
        pass(&s->filters[k], n, u, v, own);
        own += numbers_of_filter(&s->filters[k], n);
        if (k + 1 == s->compensators && !is_allowed(s, u, v))
            return 1;
    }
    memset(s->work, 0, n * sizeof(double));
    pma_springs_subtract(&s->springs, u, own, own, s->work);
    for (size_t i = 0; i < n; i++)
        r[i] -= s->work[i];
    memset(s->work, 0, n * sizeof(double));
    const int code = s->function ? s->function(t, (intptr_t)n, u, v, s->work, s->user) : 0;
    for (size_t i = 0; i < n; i++)
        r[i] += s->work[i];
    memcpy(memory, u, n * sizeof(double));
    own = memory + n;
    for (size_t k = 0; k < s->count; k++) {
        adapt(&s->filters[k], n, u, own);
        own += numbers_of_filter(&s->filters[k], n);
    }
    return code;
}
