#include "member/update.h"

/* clang-format off: attributes are long, and a name begins its line */

/* ---- the loops, to be compiled for each kind of processor ----------------------------------- */

__attribute__((always_inline)) static inline void
predict(const pma_step *c, size_t begin, size_t end, const pma_state *from, const pma_state *to)
{
    const double *u0 = from->u, *v0 = from->v, *w0 = from->w, *a0 = from->a;
    double *ut = to->u, *vt = to->v, *y = to->w, *known = to->a;
#pragma omp simd
    for (size_t i = begin; i < end; i++) {
        const double v = v0[i], w = w0[i], a = a0[i];
        ut[i] = u0[i] + c->h * v + c->u_a * a + c->u_w * w;
        vt[i] = v + c->v_a * a + c->v_w * w;
        known[i] = c->a_a * a + c->a_w * w;
        y[i] = 0.0;
    }
}

/* x * 0 is 0 only where x is finite, in whatever order these are added */
__attribute__((always_inline)) static inline bool correct(const pma_step *c, size_t begin,
                                                          size_t end, const pma_state *x)
{
    double *u = x->u, *v = x->v, *w = x->w, *a = x->a;
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = begin; i < end; i++) {
        const double u1 = u[i] + c->al1 * w[i];
        const double v1 = v[i] + c->al2 * w[i];
        const double a1 = a[i] + c->a_w1 * w[i];
        u[i] = u1;
        v[i] = v1;
        a[i] = a1;
        zero += 0.0 * u1 * v1 * a1;
    }
    return zero == 0.0;
}

/* ---- for each kind of processor ------------------------------------------------------------- */

static void predict_plain(const pma_step *c, size_t begin, size_t end, const pma_state *from,
                          const pma_state *to)
{
    predict(c, begin, end, from, to);
}

static bool correct_plain(const pma_step *c, size_t begin, size_t end, const pma_state *x)
{
    return correct(c, begin, end, x);
}

/* clang-format on */

static const pma_update PLAIN = {.predict = predict_plain, .correct = correct_plain};

const pma_update *pma_update_plain(void)
{
    return &PLAIN;
}

#if defined(__x86_64__)

/* clang-format off */

/* AVX2 alone: with fused multiply-adds the digits would depend on the processor. */
__attribute__((target("avx2"))) static void
predict_avx2(const pma_step *c, size_t begin, size_t end, const pma_state *from,
             const pma_state *to)
{
    predict(c, begin, end, from, to);
}

__attribute__((target("avx2"))) static bool
correct_avx2(const pma_step *c, size_t begin, size_t end, const pma_state *x)
{
    return correct(c, begin, end, x);
}

/* clang-format on */

static const pma_update AVX2 = {.predict = predict_avx2, .correct = correct_avx2};

const pma_update *pma_update_best(void)
{
    return __builtin_cpu_supports("avx2") ? &AVX2 : &PLAIN;
}

#else

const pma_update *pma_update_best(void)
{
    return &PLAIN;
}

#endif
