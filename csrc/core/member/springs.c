#include "member/springs.h"

#include <math.h>
#include <string.h>

#include "member/pull.h"

/* Springs at a time, so that their deformations and forces stay in the first cache. */
enum { CHUNK = 256 };

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
    pma_pull *const pull = pma_pull_best();
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
            pull(at.set, at.begin, at.count, d0, d, inner0, inner1, f);
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
        const double rise = sign * pma_pull_slope(inner1, sign, P[3][i], P[4][i], P[5][i], false);
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
