#include "solve/newton.h"

#include <assert.h>
#include <math.h>

/* A tangent that is kept is made again where corrections fall by less than this. */
#define SLOW 0.2

/* Where nothing is known of the next correction, or corrections hardly fall, what is left counts
 * this many times.                                                                         (N7) */
#define UNKNOWN 1e3

/* Where the slope along a correction has grown to this part of the one before it, with the other
 * sign, the correction is too long; it is shortened to half that.                          (N10) */
#define OVERSHOOT 0.8
#define ENOUGH 0.5

/* Parts of a correction over which rounding shows, and over which it does not; where nothing but
 * rounding shows, the slope departs from the tangent by no more than this, and the residual is no
 * larger multiple of the one before.                                                       (N9) */
#define NEAR 0x1p-20
#define FAR 0x1p30
#define FOLLOWS 0.1

/* Multiple of the last correction over which rounding hardly shows, and that is still short. */
#define MANY 0x1p10

/* Shorter corrections tried at most. */
enum { MOST_TRIALS = 8 };

/* Where an iteration is. */
typedef struct {
    const pma_newton *newton;
    const pma_equations *equations;
    void *ctx;
    size_t count;    /* corrections made since the first guess */
    double e;        /* of the last one; 0 before */
    double slope;    /* s(0) of the last one */
    double rate;     /* what is left after the last one, in parts of it */
    double allowed;  /* ... may be this                                                      (N7) */
    bool keeps;      /* tangents are kept; false after they have failed */
    bool has_factor; /* ... and there is one */
    bool slow;       /* ... which is to be made again */
    bool close;      /* the last correction was small enough */
    pma_measure at;  /* the residual at the iterate */
    pma_measure looked; /* ... and along the last correction */
} iteration;

/* ---- (N7)  is what is left small enough? ---------------------------------------------------- */

/* What is left after a correction, in parts of it; theta: its ratio to the one before it, infinite
 * where there is none. */
static double rate_of(double theta)
{
    return theta < 1.0 ? fmin(theta / (1.0 - theta), UNKNOWN) : UNKNOWN;
}

/* At an iterate that satisfies the constraints, as all do after a correction. */
static bool is_balanced(const iteration *it)
{
    const double left = it->at.residual;
    return it->count > 0 && (left == 0.0 || (it->close && left <= it->newton->tolerance));
}

/* The part x of the last correction, of the size e, was made. */
static bool is_small(const iteration *it, double e, double x)
{
    return (it->rate + 1.0 - x) * e <= it->allowed;
}

/* ---- (N10)  line search --------------------------------------------------------------------- */

static pma_status slope_at(iteration *it, double *x, double to, double *slope)
{
    pma_measure m = {0};
    it->equations->move(it->ctx, to - *x);
    *x = to;
    const pma_status status = it->equations->evaluate(it->ctx, false, &m);
    *slope = m.slope;
    it->looked = m;
    return status;
}

/* The correction is shortened to where the slope has fallen to half. `s1` is that at its end, or
 * not a number where the residual is not finite there. */
static pma_status search(iteration *it, double s1)
{
    const double s0 = it->slope;
    double x = 1.0, low = 0.0, s_low = s0, high = 1.0, s_high = s1;
    pma_status status = PMA_OK;
    for (int trial = 0; trial < MOST_TRIALS; trial++) {
        const double width = high - low;
        double to = isfinite(s_high) ? low + width * s_low / (s_low - s_high) : low + 0.5 * width;
        to = fmin(fmax(to, low + 0.1 * width), high - 0.1 * width);
        double s = NAN;
        status = slope_at(it, &x, to, &s);
        if (status != PMA_OK && status != PMA_NOT_FINITE)
            return status;
        if (status == PMA_OK && fabs(s) <= ENOUGH * fabs(s0))
            break;
        if (status == PMA_OK && s > 0.0) {
            low = to;
            s_low = s;
        } else {
            high = to;
            s_high = status == PMA_OK ? s : NAN;
        }
    }
    it->close = status == PMA_OK && is_small(it, it->e, x);
    it->e *= x;
    return status;
}

/* ---- one iteration -------------------------------------------------------------------------- */

static bool wants_tangent(const iteration *it)
{
    return !it->keeps || !it->has_factor || (it->slow && !it->close);
}

/* Tangents that were kept have failed: fresh ones from now on, from where the iterate is now. */
static void give_up_tangents(iteration *it)
{
    it->keeps = it->close = false;
    it->e = 0.0;
}

/* Is the last correction, seen from its end, one that led astray? Corrections after the first
 * satisfy the constraints, so that the multipliers have no part in the slope. */
static bool led_astray(const iteration *it, pma_status status, double slope)
{
    if (it->count == 0)
        return false;
    if (status == PMA_NOT_FINITE)
        return true;
    if (it->count == 1)
        return false;
    const double limit = OVERSHOOT * it->slope;
    return it->keeps ? !(fabs(slope) <= fabs(limit)) : limit > 0.0 && slope < -limit;
}

/* R and its tangent at an iterate from which a correction can be made */
static pma_status evaluate(iteration *it, bool *fresh)
{
    const pma_equations *eq = it->equations;
    *fresh = wants_tangent(it);
    pma_status status = eq->evaluate(it->ctx, *fresh, &it->at);
    const double slope = it->at.slope;
    if (status != PMA_OK && status != PMA_NOT_FINITE)
        return status;
    if ((status == PMA_OK && is_balanced(it)) || !led_astray(it, status, slope))
        return status;
    if (it->keeps && status == PMA_NOT_FINITE) {
        give_up_tangents(it);
        it->count = 0;
        eq->restart(it->ctx);
    } else if (it->keeps) {
        give_up_tangents(it);
        eq->move(it->ctx, -1.0);
    } else {
        if (it->count == 1)
            return status; /* the ties do not hold before the first correction: nothing to search */
        PMA_TRY(search(it, status == PMA_OK ? slope : NAN));
    }
    *fresh = true;
    return eq->evaluate(it->ctx, true, &it->at);
}

/* ---- (N9)  corrections that do not fall because they are rounding --------------------------- */

/* |s(x) - (1 - x) s(0)| / |x s(0)|, from where the iterate is, `from` */
static double departure(iteration *it, double *from, double x)
{
    double s;
    const pma_status status = slope_at(it, from, x, &s);
    return status == PMA_OK ? fabs(s / it->slope - (1.0 - x)) / x : NAN;
}

/* (N21)  Residuals that are rounding, and large against their rows, are so by tangents that the
 * forces follow over a multiple of the last correction: a tangent that is far too large makes
 * every residual rounding. The iterate is evaluated again. */
static pma_status check_tangents(iteration *it, bool fresh, bool *right)
{
    static const double multiples[] = {MANY, FAR};
    double x = 1.0, slope;
    *right = false;
    for (size_t k = 0; k < 2 && !*right; k++) {
        const pma_status status = slope_at(it, &x, multiples[k], &slope);
        if (status != PMA_OK && status != PMA_NOT_FINITE)
            return status;
        *right = status == PMA_OK && it->looked.departs <= FOLLOWS;
    }
    it->equations->move(it->ctx, 1.0 - x);
    return it->equations->evaluate(it->ctx, fresh, &it->at);
}

/* The slope does not follow the tangent over a small part of the last correction, but does over a
 * large multiple, and the residual is one for which such a correction stands. */
static bool is_rounding(iteration *it)
{
    double x = 1.0;
    const bool rounding = it->count >= 2 && it->at.leap <= PMA_LEAP &&
                          !(departure(it, &x, NEAR) <= FOLLOWS) &&
                          departure(it, &x, FAR) <= FOLLOWS;
    it->equations->move(it->ctx, 1.0 - x);
    return rounding;
}

pma_status pma_newton_solve(const pma_newton *newton, const pma_equations *equations, void *ctx,
                            bool has_factor)
{
    assert(newton->tolerance >= 0.0); /* zero where a part of a denormal one was taken */
    iteration it = {.newton = newton,
                    .equations = equations,
                    .ctx = ctx,
                    .keeps = newton->reuse,
                    .has_factor = has_factor};
    for (size_t k = 0; k < newton->iterations; k++) {
        pma_measure m = {0};
        bool fresh = false;
        pma_status status = evaluate(&it, &fresh);
        if (status == PMA_OK && is_balanced(&it)) {
            bool right = it.at.rounded <= PMA_SMALL;
            if (!right)
                status = check_tangents(&it, fresh, &right);
            if (right || status != PMA_OK)
                return status;
        }
        if (status == PMA_OK)
            status = equations->correct(ctx, fresh, &m);
        if (status != PMA_OK)
            return status == PMA_NOT_FINITE && k > 0 ? PMA_NOT_CONVERGED : status;
        it.count++;
        it.has_factor = true;
        const double e = sqrt(m.correction), theta = it.e > 0.0 ? e / it.e : INFINITY;
        if (it.keeps && !fresh && it.e > 0.0 && !(theta <= 1.0)) {
            give_up_tangents(&it); /* further away than before */
            it.count = 0;
            equations->restart(ctx);
            continue;
        }
        it.rate = rate_of(theta);
        it.allowed = newton->tolerance * sqrt(m.motion);
        it.close = is_small(&it, e, 1.0);
        it.slow = it.count > 1 && theta > SLOW;
        it.e = e;
        it.slope = m.slope;
    }
    pma_status status = equations->evaluate(ctx, false, &it.at);
    if (status != PMA_OK)
        return status == PMA_NOT_FINITE ? PMA_NOT_CONVERGED : status;
    if (is_balanced(&it)) {
        bool right = it.at.rounded <= PMA_SMALL;
        if (!right)
            PMA_TRY(check_tangents(&it, false, &right));
        return right ? PMA_OK : PMA_NOT_CONVERGED;
    }
    if (!is_rounding(&it))
        return PMA_NOT_CONVERGED;
    equations->remember_rounding(ctx);
    return PMA_OK;
}
