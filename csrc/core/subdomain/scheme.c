#include "subdomain/scheme.h"

#include "algebra/processors.h"

pma_step pma_step_make(pma_scheme s, double h)
{
    const double d = 1.0 - s.am;
    return (pma_step){
        .h = h,
        .al1 = h * h * s.beta * (1.0 - s.af) / d,
        .al2 = h * s.gamma * (1.0 - s.af) / d,
        .u_a = h * h * (0.5 - s.beta / d),
        .u_w = h * h * s.beta * s.af / d,
        .v_a = h * (1.0 - s.gamma / d),
        .v_w = h * s.gamma * s.af / d,
        .a_a = -s.am / d,
        .a_w = s.af / d,
        .a_w1 = (1.0 - s.af) / d,
    };
}

/* ---- estimates ------------------------------------------------------------------------------ */

/* e = u_1 - [u + h v + h^2 (2 w + w_1) / 6]                                                (D1) */
static inline double error(const pma_motion_rows *x, size_t begin, size_t end, double h)
{
    return x->u[end] -
           (x->u[begin] + h * x->v[begin] + h * h * (2.0 * x->w[begin] + x->w[end]) / 6.0);
}

void pma_estimate_errors(const pma_motion_rows *x, const pma_recorded_steps *steps, double *e)
{
    for (size_t s = 0; s < steps->count; s++) {
        const size_t begin = (size_t)steps->begin[s] * x->columns;
        const size_t end = (size_t)steps->end[s] * x->columns;
        const double h = (double)(steps->end[s] - steps->begin[s]) * steps->h;
        for (size_t k = 0; k < x->columns; k++)
            e[k * steps->count + s] = error(x, begin + k, end + k, h);
    }
}

/* ---- predictors and correctors -------------------------------------------------------------- */

/* clang-format off: attributes are long, and a name begins its line */

/* Fewer rows than fill two registers are taken one after the other: what was stored as one number
 * and is loaded as part of a register, or the other way round, has to wait for the cache. They have
 * loops of their own, whose functions save no registers and compare no addresses. */
enum { FEW = 8 };

/* ---- the loops, to be compiled for each kind of processor ----------------------------------- */

__attribute__((always_inline)) static inline void
predict_row(const pma_step *c, size_t i, const pma_state *from, const pma_state *to)
{
    const double v = from->v[i], w = from->w[i], a = from->a[i];
    to->u[i] = from->u[i] + c->h * v + c->u_a * a + c->u_w * w;
    to->v[i] = v + c->v_a * a + c->v_w * w;
    to->a[i] = c->a_a * a + c->a_w * w;
    to->w[i] = 0.0;
}

__attribute__((always_inline)) static inline void
predict(const pma_step *c, size_t begin, size_t end, const pma_state *from, const pma_state *to)
{
    const pma_step step = *c; /* or it would be read again after each number that is stored */
    const pma_state x = *from, y = *to;
#pragma omp simd
    for (size_t i = begin; i < end; i++)
        predict_row(&step, i, &x, &y);
}

__attribute__((always_inline)) static inline void
predict_few(const pma_step *c, size_t begin, size_t end, const pma_state *from, const pma_state *to)
{
    const pma_step step = *c;
    const pma_state x = *from, y = *to;
#pragma omp simd simdlen(1)
    for (size_t i = begin; i < end; i++)
        predict_row(&step, i, &x, &y);
}

/* x * 0 is 0 only where x is finite, in whatever order these are added */
__attribute__((always_inline)) static inline double correct_row(const pma_step *c, size_t i,
                                                                const pma_state *x)
{
    const double w = x->w[i];
    const double u1 = x->u[i] + c->al1 * w;
    const double v1 = x->v[i] + c->al2 * w;
    const double a1 = x->a[i] + c->a_w1 * w;
    x->u[i] = u1;
    x->v[i] = v1;
    x->a[i] = a1;
    return 0.0 * u1 * v1 * a1;
}

__attribute__((always_inline)) static inline bool correct(const pma_step *c, size_t begin,
                                                          size_t end, const pma_state *x)
{
    const pma_step step = *c;
    const pma_state y = *x;
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = begin; i < end; i++)
        zero += correct_row(&step, i, &y);
    return zero == 0.0;
}

__attribute__((always_inline)) static inline bool correct_few(const pma_step *c, size_t begin,
                                                              size_t end, const pma_state *x)
{
    const pma_step step = *c;
    const pma_state y = *x;
    double zero = 0.0;
#pragma omp simd simdlen(1)
    for (size_t i = begin; i < end; i++)
        zero += correct_row(&step, i, &y);
    return zero == 0.0;
}

/* ---- for each kind of processor ------------------------------------------------------------- */

/* clang-format on */

/* noinline: so that what is few has no registers to save */
PMA_COMPILED(__attribute__((noinline)) void, predict_many,
             (const pma_step *c, size_t begin, size_t end, const pma_state *from,
              const pma_state *to),
             predict(c, begin, end, from, to);)

PMA_COMPILED(__attribute__((noinline)) bool, correct_many,
             (const pma_step *c, size_t begin, size_t end, const pma_state *x),
             return correct(c, begin, end, x);)

#define CHOOSING(kind)                                                                             \
    static void predict_##kind(const pma_step *c, size_t begin, size_t end, const pma_state *from, \
                               const pma_state *to)                                                \
    {                                                                                              \
        if (end - begin < FEW)                                                                     \
            predict_few(c, begin, end, from, to);                                                  \
        else                                                                                       \
            predict_many_##kind(c, begin, end, from, to);                                          \
    }                                                                                              \
    static bool correct_##kind(const pma_step *c, size_t begin, size_t end, const pma_state *x)    \
    {                                                                                              \
        if (end - begin < FEW)                                                                     \
            return correct_few(c, begin, end, x);                                                  \
        return correct_many_##kind(c, begin, end, x);                                              \
    }                                                                                              \
    static const pma_update kind = {.predict = predict_##kind, .correct = correct_##kind};

CHOOSING(plain)
CHOOSING(avx2)

const pma_update *pma_update_plain(void)
{
    return &plain;
}

const pma_update *pma_update_best(void)
{
    return pma_has_avx2() ? &avx2 : &plain;
}
