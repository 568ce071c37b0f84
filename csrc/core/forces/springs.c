#include "forces/springs.h"

#include <assert.h>
#include <string.h>

#include "algebra/lanes.h"
#include "forces/laws.h"
#include "memory.h"

#define INLINE __attribute__((always_inline)) static inline

/* Springs at a time, so that their deformations and forces stay in the first cache. */
enum { CHUNK = 256 };

size_t pma_spring_parameters(const pma_spring_set *set)
{
    const pma_law *law = &pma_laws[set->law];
    return law->parameters + set->elements * law->each_parameters;
}

size_t pma_springs_fields(const pma_springs *springs)
{
    size_t inner = 1;
    for (size_t s = 0; s < springs->count; s++) {
        const pma_law *law = &pma_laws[springs->sets[s].law];
        const size_t own = law->inner + springs->sets[s].elements * law->each_inner;
        inner = own > inner ? own : inner;
    }
    return 2 + inner;
}

size_t pma_springs_numbers(const pma_springs *springs)
{
    return springs->total > 0 ? pma_springs_fields(springs) * springs->total : 0;
}

size_t pma_springs_tables(const pma_springs *springs)
{
    size_t tables = 0;
    for (size_t s = 0; s < springs->count; s++)
        tables += pma_laws[springs->sets[s].law].most > 0;
    return tables;
}

void pma_springs_counts(const pma_springs *springs, pma_state_counts *out)
{
    for (size_t s = 0, at = 2 * springs->total; s < springs->count;
         at += springs->sets[s++].count) {
        const pma_spring_set *set = &springs->sets[s];
        const size_t most = pma_laws[set->law].most;
        if (most > 0)
            *out++ = (pma_state_counts){at, set->count, (double)most};
    }
}

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
        if (pma_spring_parameters(set) > PMA_SPRING_PARAMETERS)
            return PMA_BAD_SIZE;
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

bool pma_springs_have_rates(const pma_springs *springs)
{
    for (size_t s = 0; s < springs->count; s++) {
        if (pma_laws[springs->sets[s].law].dashpot)
            return true;
    }
    return false;
}

/* Springs of the same dofs in one lane after the other: 1 or PMA_LANES of them, which a compiler
 * knows. The lanes of a dof follow one another. */
INLINE void measure(const chunk *at, const size_t lanes, const double *u, double *d)
{
    const int32_t *first = at->set->first + at->begin, *second = at->set->second + at->begin;
    for (size_t i = 0; i < at->count; i += lanes) {
        for (size_t l = 0; l < lanes; l++) {
            const double u_first = first[i] < 0 ? 0.0 : u[(size_t)first[i] + l];
            const double u_second = second[i] < 0 ? 0.0 : u[(size_t)second[i] + l];
            d[i + l] = u_first - u_second;
        }
    }
}

/* d := the difference of x at both ends */
static void measure_set(const pma_springs *springs, const chunk *at, const double *x, double *d)
{
    if (springs->in_lanes)
        measure(at, PMA_LANES, x, d);
    else
        measure(at, 1, x, d);
}

INLINE void spread(const pma_spring_set *set, size_t begin, size_t count, const size_t lanes,
                   double sign, const double *f, double *y)
{
    const int32_t *first = set->first + begin, *second = set->second + begin;
    for (size_t i = 0; i < count; i += lanes) {
        for (size_t l = 0; l < lanes && first[i] >= 0; l++)
            y[(size_t)first[i] + l] -= sign * f[i + l];
        for (size_t l = 0; l < lanes && second[i] >= 0; l++)
            y[(size_t)second[i] + l] += sign * f[i + l];
    }
}

/* The springs of a chunk go from one level to another, to the deformations d. */
static void go(const chunk *at, size_t total, const double *d, const double *rate,
               const double *from, double *to, bool best)
{
    const double *P[PMA_SPRING_PARAMETERS] = {NULL};
    const pma_law *law = &pma_laws[at->set->law];
    for (size_t k = 0; k < pma_spring_parameters(at->set); k++)
        P[k] = at->set->parameters[k] + at->begin;
    const pma_law_path path = {.count = at->count,
                               .elements = at->set->elements,
                               .stride = total,
                               .P = P,
                               .d0 = from + at->position,
                               .d = d,
                               .rate = rate,
                               .f0 = from + total + at->position,
                               .inner0 = from + 2 * total + at->position,
                               .f = to + total + at->position,
                               .inner1 = to + 2 * total + at->position};
    (best ? law->go : law->go_plain)(&path);
}

/* y -= sign f */
static void spread_set(const pma_springs *springs, const chunk *at, double sign, const double *f,
                       double *y)
{
    if (springs->in_lanes)
        spread(at->set, at->begin, at->count, PMA_LANES, sign, f, y);
    else
        spread(at->set, at->begin, at->count, 1, sign, f, y);
}

static void subtract(const pma_springs *springs, const double *u, const double *v,
                     const double *from, double *to, double *y, bool best)
{
    const size_t total = springs->total;
    double d[CHUNK], rate[CHUNK];
    chunk at = {.position = 0};
    for (size_t s = 0; s < springs->count; s++) {
        at.set = &springs->sets[s];
        for (at.begin = 0; at.begin < at.set->count; at.begin += CHUNK, at.position += at.count) {
            const size_t left = at.set->count - at.begin;
            at.count = left < CHUNK ? left : CHUNK;
            measure_set(springs, &at, u, d);
            if (pma_laws[at.set->law].dashpot && v)
                measure_set(springs, &at, v, rate);
            else if (pma_laws[at.set->law].dashpot)
                memset(rate, 0, at.count * sizeof(double));
            go(&at, total, d, rate, from, to, best);
            memcpy(to + at.position, d, at.count * sizeof(double));
            spread_set(springs, &at, 1.0, to + total + at.position, y);
        }
    }
}

void pma_springs_subtract(const pma_springs *springs, const double *u, const double *v,
                          const double *from, double *to, double *y)
{
    subtract(springs, u, v, from, to, y, pma_has_avx2());
}

void pma_springs_subtract_plain(const pma_springs *springs, const double *u, const double *v,
                                const double *from, double *to, double *y)
{
    subtract(springs, u, v, from, to, y, false);
}

pma_status pma_springs_subtract_first(const pma_springs *springs, const double *u, const double *v,
                                      double *y)
{
    double *fresh = pma_memory_allocate(pma_springs_numbers(springs) + 1, sizeof *fresh);
    if (!fresh)
        return PMA_NO_MEMORY;
    pma_springs_subtract(springs, u, v, fresh, fresh, y);
    pma_memory_release(fresh);
    return PMA_OK;
}

/* ---- tangents and energy -------------------------------------------------------------------- */

/* Spring i of a set, number `at` of all, that went from one level to another. */
static pma_law_end end_of(const pma_springs *springs, const pma_spring_set *set, size_t i,
                          size_t at, const double *from, const double *to)
{
    const size_t total = springs->total;
    return (pma_law_end){.i = i,
                         .elements = set->elements,
                         .stride = total,
                         .P = set->parameters,
                         .d0 = from[at],
                         .d = to[at],
                         .f = to[total + at],
                         .inner0 = from + 2 * total + at,
                         .inner1 = to + 2 * total + at};
}

void pma_springs_tangent(const pma_springs *springs, const double *from, const double *to,
                         double by_d, double by_rate, double *slopes)
{
    assert(springs->total > 0);
    for (size_t s = 0, at = 0; s < springs->count; at += springs->sets[s++].count) {
        const pma_spring_set *set = &springs->sets[s];
        const pma_law *law = &pma_laws[set->law];
        for (size_t i = 0; i < set->count; i++) {
            const pma_law_end end = end_of(springs, set, i, at + i, from, to);
            slopes[at + i] = by_d * law->tangent(&end);
            if (law->dashpot)
                slopes[at + i] += by_rate * law->dashpot(&end);
        }
    }
}

void pma_springs_add_energy(const pma_springs *springs, size_t lanes, const double *level,
                            double *out)
{
    for (size_t s = 0, at = 0, lane = 0; s < springs->count; s++) {
        const pma_spring_set *set = &springs->sets[s];
        for (size_t i = 0; i < set->count; i++, at++) {
            const pma_law_end end = end_of(springs, set, i, at, level, level);
            out[lane] += pma_laws[set->law].energy(&end);
            lane = lane + 1 < lanes ? lane + 1 : 0;
        }
    }
}

double pma_springs_energy(const pma_springs *springs, const double *level)
{
    double sum = 0.0;
    pma_springs_add_energy(springs, 1, level, &sum);
    return sum;
}

void pma_springs_subtract_work(const pma_springs *springs, size_t lanes, const double *from,
                               const double *to, double *out)
{
    const size_t total = springs->total;
    for (size_t i = 0; i < total; i += lanes) {
        for (size_t l = 0; l < lanes; l++)
            out[l] -= 0.5 * (to[i + l] - from[i + l]) * (from[total + i + l] + to[total + i + l]);
    }
}

double pma_springs_work(const pma_springs *springs, const double *from, const double *to)
{
    double sum = 0.0;
    pma_springs_subtract_work(springs, 1, from, to, &sum);
    return -sum;
}

void pma_springs_add(const pma_springs *springs, const double *level, double *r)
{
    const double *f = level + springs->total;
    for (size_t s = 0; s < springs->count; s++) {
        const chunk all = {.set = &springs->sets[s], .count = springs->sets[s].count};
        spread_set(springs, &all, -1.0, f, r);
        f += all.count;
    }
}
