/* lanes.h - PMA_LANES vectors side by side, in one pass over a matrix or factor.
 *
 * Number i of lane l is at i * PMA_LANES + l: a line of the cache for each unknown. A pass over a
 * large factor takes about as long as for one vector, since it is the factor that has to be read.
 * Every lane is bitwise what one vector gets; no lane depends on another, so that those that are
 * not needed may hold zeros. Where one vector is updated element by element, as by pma_update, it
 * may as well be n * PMA_LANES long.
 *
 * A loop is written once, for the numbers of an unknown: one, or those of all lanes, for any
 * processor and for those with AVX2. */
#ifndef PMA_LANES_H
#define PMA_LANES_H

#include <stddef.h>

#include "algebra/processors.h"

enum { PMA_LANES = 8 };

/* A register of AVX2, and one of SSE2 or NEON. A vector that no register holds is in memory with
 * gcc, and takes three times as long: each kind of processor has its own. */
typedef double pma_four __attribute__((vector_size(32), aligned(8), may_alias));
typedef double pma_two __attribute__((vector_size(16), aligned(8), may_alias));

/* The numbers of an unknown in lanes, in either. */
typedef struct {
    pma_four low, high;
} __attribute__((may_alias)) pma_eight;

typedef struct {
    pma_two part[PMA_LANES / 2];
} __attribute__((may_alias)) pma_pairs;

#define PMA_INLINE __attribute__((always_inline)) static inline

PMA_INLINE void pma_add_one(double a, const double *x, double *y)
{
    *y += a * *x;
}

PMA_INLINE void pma_add_eight(double a, const pma_eight *x, pma_eight *y)
{
    y->low += a * x->low;
    y->high += a * x->high;
}

PMA_INLINE void pma_add_pairs(double a, const pma_pairs *x, pma_pairs *y)
{
#pragma GCC unroll 4
    for (int h = 0; h < PMA_LANES / 2; h++)
        y->part[h] += a * x->part[h];
}

PMA_INLINE void pma_subtract_one(double a, const double *x, double *y)
{
    *y -= a * *x;
}

PMA_INLINE void pma_subtract_eight(double a, const pma_eight *x, pma_eight *y)
{
    y->low -= a * x->low;
    y->high -= a * x->high;
}

PMA_INLINE void pma_subtract_pairs(double a, const pma_pairs *x, pma_pairs *y)
{
#pragma GCC unroll 4
    for (int h = 0; h < PMA_LANES / 2; h++)
        y->part[h] -= a * x->part[h];
}

PMA_INLINE void pma_scale_one(double a, const double *x, double *y)
{
    *y = *x * a;
}

PMA_INLINE void pma_scale_eight(double a, const pma_eight *x, pma_eight *y)
{
    y->low = x->low * a;
    y->high = x->high * a;
}

PMA_INLINE void pma_scale_pairs(double a, const pma_pairs *x, pma_pairs *y)
{
#pragma GCC unroll 4
    for (int h = 0; h < PMA_LANES / 2; h++)
        y->part[h] = x->part[h] * a;
}

/* y_l += a_l x_l, lane by lane */
PMA_INLINE void pma_add_lanes_eight(const pma_eight *a, const pma_eight *x, pma_eight *y)
{
    y->low += a->low * x->low;
    y->high += a->high * x->high;
}

PMA_INLINE void pma_add_lanes_pairs(const pma_pairs *a, const pma_pairs *x, pma_pairs *y)
{
#pragma GCC unroll 4
    for (int h = 0; h < PMA_LANES / 2; h++)
        y->part[h] += a->part[h] * x->part[h];
}

/* y += a x,  y -= a x,  y := a x  for the numbers of an unknown */
#define PMA_ADD(a, x, y) PMA_OF_NUMBER(y, pma_add)(a, x, y)
#define PMA_SUBTRACT(a, x, y) PMA_OF_NUMBER(y, pma_subtract)(a, x, y)
#define PMA_SCALE(a, x, y) PMA_OF_NUMBER(y, pma_scale)(a, x, y)
#define PMA_OF_NUMBER(y, name) \
    _Generic((y), double *: name##_one, pma_eight *: name##_eight, pma_pairs *: name##_pairs)
#define PMA_ADD_LANES(a, x, y) \
    _Generic((y), pma_eight *: pma_add_lanes_eight, pma_pairs *: pma_add_lanes_pairs)(a, x, y)

/* the number of vectors that a number of this type holds */
#define PMA_VECTORS(number) \
    _Generic((number *)0, double *: 1, pma_eight *: PMA_LANES, pma_pairs *: PMA_LANES)

/* The functions name_one, name_plain and name_avx2 with these parameters and this body, in which
 * `number` is the type of the numbers of an unknown: one vector, lanes on any processor, lanes. */
#define PMA_LOOP(name, parameters, ...) \
    static void name##_one parameters   \
    {                                   \
        typedef double number;          \
        __VA_ARGS__                     \
    }                                   \
    PMA_LANE_LOOP(name, parameters, __VA_ARGS__)

/* ... for lanes alone */
#define PMA_LANE_LOOP(name, parameters, ...)    \
    static void name##_plain parameters         \
    {                                           \
        typedef pma_pairs number;               \
        __VA_ARGS__                             \
    }                                           \
    PMA_AVX2 static void name##_avx2 parameters \
    {                                           \
        typedef pma_eight number;               \
        __VA_ARGS__                             \
    }

/* x . y of a lane of this many, 0 of 1 in a vector; both (n) */
static inline double pma_dot(size_t n, size_t lanes, size_t lane, const double *x, const double *y)
{
    double sum = 0.0;
    for (size_t i = lane; i < n; i += lanes)
        sum += x[i] * y[i];
    return sum;
}

/* out[l] (n): the vector of lane l, for the first `count` lanes */
static inline void pma_lanes_split(size_t n, const double *x, size_t count, double *const *out)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t l = 0; l < count; l++)
            out[l][i] = x[i * PMA_LANES + l];
    }
}

#endif
