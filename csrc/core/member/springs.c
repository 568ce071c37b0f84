#include "member/springs.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* Springs at a time, so that their deformations and forces stay in the first cache. */
enum { CHUNK = 256 };

/* Substeps of (H4) at most: where rate * x is beyond, z has come to rest at its limit. */
enum { MOST_STEPS = 256 };

const size_t pma_spring_parameters[PMA_SPRING_LAWS] = {2, 2, 3, 7};

static int is_dof(int32_t dof, size_t n)
{
    return dof >= -1 && (dof < 0 || (size_t)dof < n);
}

pma_status pma_springs_check(const pma_springs *springs, size_t n)
{
    size_t total = 0;
    for (size_t s = 0; s < springs->count; s++) {
        const pma_spring_set *set = &springs->sets[s];
        total += set->count;
        for (size_t i = 0; i < set->count; i++) {
            if (!is_dof(set->first[i], n) || !is_dof(set->second[i], n))
                return PMA_BAD_INDEX;
        }
    }
    return total == springs->total ? PMA_OK : PMA_BAD_SIZE;
}

/* ---- the laws: f and the inner variable of `count` springs at d ----------------------------- */

/* (H1)  f = k d + k3 d^3 */
static void pull_cubic(size_t count, const double *k, const double *k3, const double *d, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        f[i] = d[i] * (k[i] + k3[i] * d[i] * d[i]);
}

/* (H2)  f = k (d - gap), if that is positive; a d that is not finite stays to be seen */
static void pull_gap(size_t count, const double *k, const double *gap, const double *d, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const double closed = k[i] * (d[i] - gap[i]);
        f[i] = d[i] <= gap[i] ? 0.0 : closed;
    }
}

/* (H3)  p goes along when |d - p| would pass d_y;  f = k_hard d + k_soft (d - p) */
static void pull_bilinear(size_t count, const double *hard, const double *soft, const double *d_y,
                          const double *d, const double *p0, double *p1, double *f)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++) {
        const double e = d[i] - p0[i], up = d[i] - d_y[i], down = d[i] + d_y[i];
        const double below = e < -d_y[i] ? down : p0[i];
        const double p = e > d_y[i] ? up : below;
        p1[i] = p;
        f[i] = hard[i] * d[i] + soft[i] * (d[i] - p);
    }
}

/* dz/dx on a path on which d moves one way, sign = +-1, and x = |d - d0| / d_y grows      (H4)
 * With `whole` n is 1 or 2. */
__attribute__((always_inline)) static inline double slope(double z, double sign, double n,
                                                          double beta, double gamma, bool whole)
{
    const double size = fabs(z), square = size * size;
    const double power = n == 1.0 ? size : whole || n == 2.0 ? square : pow(size, n);
    return sign * (1.0 - power * (gamma + (sign * z < 0.0 ? -beta : beta)));
}

/* Springs that follow their paths together, since each waits for one number after the other. */
enum { BLOCK = 8 };

typedef struct {
    const double *n, *beta, *gamma;
    double z[BLOCK], sign[BLOCK], steps[BLOCK], h[BLOCK];
} paths;

/* A step of the classical Runge-Kutta rule for spring i, if it has one left. */
__attribute__((always_inline)) static inline void follow(paths *p, size_t i, double done,
                                                         bool whole)
{
    const double z = p->z[i], sign = p->sign[i], h = p->h[i];
    const double n = p->n[i], beta = p->beta[i], gamma = p->gamma[i];
    const double a = slope(z, sign, n, beta, gamma, whole);
    const double b = slope(z + 0.5 * h * a, sign, n, beta, gamma, whole);
    const double c = slope(z + 0.5 * h * b, sign, n, beta, gamma, whole);
    const double d = slope(z + h * c, sign, n, beta, gamma, whole);
    const double next = z + h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
    p->z[i] = done < p->steps[i] ? next : z;
}

static void follow_all(paths *p, size_t count, double done)
{
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, false);
}

/* Whole exponents alone, so that all springs are in vectors. */
static void follow_whole(paths *p, size_t count, double done)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        follow(p, i, done, true);
}

/* Steps with rate * h <= 1/2 along paths of the lengths |x|; returns the largest number of them. */
static inline double divide(paths *p, size_t count, const double *x, const double *rate)
{
    double most = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double length = fabs(x[i]), wanted = 2.0 * rate[i] * length;
        const bool follows = wanted < MOST_STEPS;
        p->sign[i] = x[i] < 0.0 ? -1.0 : 1.0;
        p->steps[i] = follows ? 1.0 + (double)(int)wanted : MOST_STEPS;
        p->h[i] = follows ? length / p->steps[i] : 0.5 / rate[i];
        most = p->steps[i] > most ? p->steps[i] : most;
    }
    return most;
}

/* (H4)  f = k_hard d + f_soft z, of up to BLOCK springs */
static void pull_block(size_t count, const double *const P[], const double *d0, const double *d,
                       const double *z0, double *z1, double *f)
{
    paths p = {.n = P[3], .beta = P[4], .gamma = P[5]};
    double x[BLOCK] = {0.0};
    bool whole = true;
    for (size_t i = 0; i < count; i++) {
        x[i] = (d[i] - d0[i]) * P[2][i];
        p.z[i] = z0[i];
        whole = whole && (p.n[i] == 1.0 || p.n[i] == 2.0);
    }
    const double most = divide(&p, count, x, P[6]);
    for (size_t done = 0; (double)done < most; done++) {
        if (whole)
            follow_whole(&p, count, (double)done);
        else
            follow_all(&p, count, (double)done);
    }
    for (size_t i = 0; i < count; i++) {
        z1[i] = p.z[i];
        f[i] = P[0][i] * d[i] + P[1][i] * z1[i];
    }
}

static void pull_bouc_wen(size_t count, const double *const P[], const double *d0, const double *d,
                          const double *z0, double *z1, double *f)
{
    for (size_t i = 0; i < count; i += BLOCK) {
        const double *of_block[PMA_SPRING_PARAMETERS];
        for (size_t k = 0; k < PMA_SPRING_PARAMETERS; k++)
            of_block[k] = P[k] + i;
        const size_t m = count - i < BLOCK ? count - i : BLOCK;
        pull_block(m, of_block, d0 + i, d + i, z0 + i, z1 + i, f + i);
    }
}

/* ---- all springs ---------------------------------------------------------------------------- */

/* Some springs of one law, and their position in the arrays of a time level. */
typedef struct {
    const pma_spring_set *set;
    size_t begin, count, position;
} chunk;

static void measure(const chunk *at, const double *u, double *d)
{
    const int32_t *first = at->set->first + at->begin, *second = at->set->second + at->begin;
    for (size_t i = 0; i < at->count; i++)
        d[i] = (first[i] < 0 ? 0.0 : u[first[i]]) - (second[i] < 0 ? 0.0 : u[second[i]]);
}

static void pull(const chunk *at, const double *d, const double *d0, const double *inner0,
                 double *inner1, double *f)
{
    const double *P[PMA_SPRING_PARAMETERS] = {NULL};
    const size_t count = at->count;
    for (size_t k = 0; k < pma_spring_parameters[at->set->law]; k++)
        P[k] = at->set->parameters[k] + at->begin;
    switch (at->set->law) {
    case PMA_CUBIC:
        pull_cubic(count, P[0], P[1], d, f);
        break;
    case PMA_GAP:
        pull_gap(count, P[0], P[1], d, f);
        break;
    case PMA_BILINEAR:
        pull_bilinear(count, P[0], P[1], P[2], d, inner0, inner1, f);
        break;
    case PMA_BOUC_WEN:
        pull_bouc_wen(count, P, d0, d, inner0, inner1, f);
        break;
    }
}

static void spread(const chunk *at, const double *f, double *y)
{
    const int32_t *first = at->set->first + at->begin, *second = at->set->second + at->begin;
    for (size_t i = 0; i < at->count; i++) {
        if (first[i] >= 0)
            y[first[i]] -= f[i];
        if (second[i] >= 0)
            y[second[i]] += f[i];
    }
}

void pma_springs_subtract(const pma_springs *springs, const double *u, const double *from,
                          double *to, double *y)
{
    const size_t total = springs->total;
    double d[CHUNK];
    chunk at = {.position = 0};
    for (size_t s = 0; s < springs->count; s++) {
        at.set = &springs->sets[s];
        for (at.begin = 0; at.begin < at.set->count; at.begin += CHUNK, at.position += at.count) {
            const size_t left = at.set->count - at.begin;
            at.count = left < CHUNK ? left : CHUNK;
            const double *d0 = from + at.position, *inner0 = d0 + 2 * total;
            double *f = to + total + at.position, *inner1 = f + total;
            measure(&at, u, d);
            pull(&at, d, d0, inner0, inner1, f);
            memcpy(to + at.position, d, at.count * sizeof(double));
            spread(&at, f, y);
        }
    }
}

/* ---- tangents ------------------------------------------------------------------------------- */

/* Of one spring that went from d0 with the inner variable inner0 to d with inner1. That of Bouc-Wen
 * is the slope of the path itself, which the Runge-Kutta rule follows to a few digits. */
static double tangent(const pma_spring_set *set, size_t i, double d0, double d, double inner0,
                      double inner1)
{
    const double *const *P = set->parameters;
    switch (set->law) {
    case PMA_CUBIC:
        return P[0][i] + 3.0 * P[1][i] * d * d;
    case PMA_GAP:
        return d <= P[1][i] ? 0.0 : P[0][i];
    case PMA_BILINEAR:
        return P[0][i] + (fabs(d - inner0) > P[2][i] ? 0.0 : P[1][i]);
    case PMA_BOUC_WEN: {
        const double sign = d < d0 ? -1.0 : 1.0;
        const double rise = sign * slope(inner1, sign, P[3][i], P[4][i], P[5][i], false);
        return P[0][i] + P[1][i] * P[2][i] * rise;
    }
    }
    return 0.0;
}

void pma_springs_tangent(const pma_springs *springs, const double *from, const double *to,
                         double *slopes)
{
    const size_t total = springs->total;
    for (size_t s = 0, at = 0; s < springs->count; at += springs->sets[s++].count) {
        for (size_t i = 0; i < springs->sets[s].count; i++)
            slopes[at + i] = tangent(&springs->sets[s], i, from[at + i], to[at + i],
                                     from[2 * total + at + i], to[2 * total + at + i]);
    }
}

/* ---- energy --------------------------------------------------------------------------------- */

/* (H5) */
static double stored(const pma_spring_set *set, size_t i, double d, double inner)
{
    const double *const *P = set->parameters;
    switch (set->law) {
    case PMA_CUBIC:
        return 0.5 * d * d * (P[0][i] + 0.5 * P[1][i] * d * d);
    case PMA_GAP:
        return d <= P[1][i] ? 0.0 : 0.5 * P[0][i] * (d - P[1][i]) * (d - P[1][i]);
    case PMA_BILINEAR:
        return 0.5 * (P[0][i] * d * d + P[1][i] * (d - inner) * (d - inner));
    case PMA_BOUC_WEN:
        return 0.5 * (P[0][i] * d * d + P[1][i] / P[2][i] * inner * inner);
    }
    return 0.0;
}

double pma_springs_energy(const pma_springs *springs, const double *level)
{
    double sum = 0.0;
    for (size_t s = 0, at = 0; s < springs->count; at += springs->sets[s++].count) {
        for (size_t i = 0; i < springs->sets[s].count; i++)
            sum += stored(&springs->sets[s], i, level[at + i], level[2 * springs->total + at + i]);
    }
    return sum;
}

double pma_springs_work(const pma_springs *springs, const double *from, const double *to)
{
    const size_t total = springs->total;
    double sum = 0.0;
    for (size_t i = 0; i < total; i++)
        sum += (to[i] - from[i]) * (from[total + i] + to[total + i]);
    return 0.5 * sum;
}
