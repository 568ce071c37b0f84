/* cone.c - friction: Newton's method on the states of contacts, and projected sweeps.
 *
 * To be read with (U7) and (U8) of docs/method/contact.md. */
#include "solve/cone.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "memory.h"
#include "object.h"

/* Newton's method before the sweeps up to the one number of rows, after them up to the other, where
 * a factor would cost more than all of the sweeps. */
enum { SMALL = 200, MOST_FACTORED = 1000 };
enum { FEW_SWEEPS = 50, MOST_ITERATIONS = 20 };
enum { MOST_POINTS = 60, MOST_BETWEEN = 300 };

/* Parts of the largest b: the rounding of a solution; where sweeps end; what is not a push. Pivots
 * of a scaled matrix below LOST are those of rows that follow from others. */
static const double ROUNDING = 1e-13, TOLERANCE = 1e-10, SHARE = 1e-2, LARGE = 1e4, LOST = 1e-11;

/* Proximal points: the part of W_kk that is added, and how much closer each problem is solved. */
static const double SOFT = 1e-4, CLOSER = 1e-2;

typedef enum { OPEN, STICKS, SLIDES } state;

/* What a contact is to do next. */
typedef struct {
    state state;
    double d[2], length; /* direction of P_t where it slides, and |P_t - y_t / r| */
} target;

struct pma_cone {
    double *J;             /* Newton's matrix in the rows that push, factored */
    size_t unknowns, rank; /* of it, or none; pivots */
    size_t *key, *wanted; /* unknowns: row and state, of the factor and of what is to be factored */
    size_t *unknown;      /* rows that push, with their tangents */
    size_t *swap, *pivot; /* of the factor: row exchanged with row k, and column of pivot k */
    target *target;       /* contacts */
    double *kept, *right;
    double *diagonal, *b; /* rows: of the problem, while others are solved in its place */
};

pma_cone *pma_cone_create(size_t rows)
{
    const size_t factored = rows < MOST_FACTORED ? rows : MOST_FACTORED;
    const pma_array arrays[] = {PMA_ARRAY(pma_cone, J, factored * factored),
                                PMA_ARRAY(pma_cone, key, rows),
                                PMA_ARRAY(pma_cone, wanted, rows),
                                PMA_ARRAY(pma_cone, unknown, rows),
                                PMA_ARRAY(pma_cone, swap, rows),
                                PMA_ARRAY(pma_cone, pivot, rows),
                                PMA_ARRAY(pma_cone, target, rows),
                                PMA_ARRAY(pma_cone, kept, rows),
                                PMA_ARRAY(pma_cone, right, rows),
                                PMA_ARRAY(pma_cone, diagonal, rows),
                                PMA_ARRAY(pma_cone, b, rows),
                                {0}};
    return pma_object_create(sizeof(pma_cone), arrays);
}

void pma_cone_destroy(pma_cone *x)
{
    pma_memory_release(x);
}

void pma_cone_forget(pma_cone *x)
{
    x->unknowns = 0;
}

static double entry(const pma_cone_problem *p, size_t i, size_t j)
{
    return p->W[j * p->rows + i];
}

static size_t tangents_of(const pma_cone_problem *p, size_t contact)
{
    return p->at[contact + 1] - p->at[contact] - 1;
}

/* Trace of W in the tangents, which is above its eigenvalues. */
static double stiffest(const pma_cone_problem *p, size_t contact)
{
    double sum = 0.0;
    for (size_t k = p->at[contact] + 1; k < p->at[contact + 1]; k++)
        sum += entry(p, k, k);
    return sum;
}

/* max |b_k| / sqrt(W_kk): b and P are compared in units of energy */
static double size_of(const pma_cone_problem *p)
{
    double size = 0.0;
    for (size_t k = 0; k < p->rows; k++)
        size = fmax(size, fabs(p->b[k]) / sqrt(entry(p, k, k)));
    return size;
}

/* What is rounding in y, of b or of large impulses that cancel each other; -1 where they are too
 * large: a direction that moves nothing has been followed. */
static double rounding_of(const pma_cone_problem *p)
{
    const double size = size_of(p);
    double large = size;
    for (size_t k = 0; k < p->rows; k++)
        large = fmax(large, SHARE * fabs(p->z[k]) * sqrt(entry(p, k, k)));
    return large <= LARGE * size ? ROUNDING * large : -1.0;
}

/* z_k += by, y += W_k by */
static void change(const pma_cone_problem *p, size_t k, double by)
{
    const double *W = p->W + k * p->rows;
    if (by == 0.0)
        return;
    for (size_t i = 0; i < p->rows; i++)
        p->y[i] += W[i] * by;
    p->z[k] += by;
}

/* y = W z + b */
static void find_velocities(const pma_cone_problem *p)
{
    memcpy(p->y, p->b, p->rows * sizeof(double));
    for (size_t k = 0; k < p->rows; k++) {
        const double *W = p->W + k * p->rows;
        for (size_t i = 0; i < p->rows && p->z[k] != 0.0; i++)
            p->y[i] += W[i] * p->z[k];
    }
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* q = z_t - y_t / tr W_tt; its length */
static double aim(const pma_cone_problem *p, size_t contact, double r, double q[2])
{
    const size_t at = p->at[contact] + 1;
    double length = 0.0;
    for (size_t t = 0; t < tangents_of(p, contact); t++) {
        q[t] = p->z[at + t] - p->y[at + t] / r;
        length = hypot(length, q[t]);
    }
    return length;
}

/* One contact: the largest change, in units of energy.                                     (U8) */
static double sweep_contact(const pma_cone_problem *p, size_t contact)
{
    const size_t at = p->at[contact];
    const double normal = entry(p, at, at), r = stiffest(p, contact);
    double by = fmax(0.0, p->z[at] - p->y[at] / normal) - p->z[at], q[2];
    double largest = fabs(by) * sqrt(normal);
    change(p, at, by);
    const double length = aim(p, contact, r, q), most = p->mu[contact] * p->z[at];
    const double share = length > most ? most / length : 1.0;
    for (size_t t = 0; t < tangents_of(p, contact); t++) {
        by = share * q[t] - p->z[at + 1 + t];
        largest = fmax(largest, fabs(by) * sqrt(r));
        change(p, at + 1 + t, by);
    }
    return largest;
}

/* All contacts in turn; *row is where most has changed. */
static double sweep(const pma_cone_problem *p, size_t *row)
{
    double largest = 0.0;
    for (size_t i = 0; i < p->contacts; i++) {
        const double by = sweep_contact(p, i);
        if (!(by <= largest)) {
            largest = by;
            *row = p->at[i];
        }
    }
    return largest;
}

/* ---- Newton's method ------------------------------------------------------------------------ */

/* What the contact would do in a sweep, and how far from it z is, in units of energy. */
static double look(const pma_cone_problem *p, size_t contact, double none, target *to)
{
    const size_t at = p->at[contact], tangents = tangents_of(p, contact);
    const double normal = entry(p, at, at), r = stiffest(p, contact);
    double push = p->z[at] - p->y[at] / normal, q[2];
    to->state = push * sqrt(normal) > none ? STICKS : OPEN;
    push = fmax(0.0, push);
    double far = fabs(push - p->z[at]) * sqrt(normal);
    to->length = aim(p, contact, r, q);
    const double most = p->mu[contact] * push;
    const double share = to->length > most ? most / to->length : 1.0;
    if (to->state == STICKS && tangents > 0 && to->length > most)
        to->state = SLIDES;
    for (size_t t = 0; t < tangents; t++) {
        to->d[t] = to->length > 0.0 ? q[t] / to->length : 0.0;
        far = fmax(far, fabs(share * q[t] - p->z[at + 1 + t]) * sqrt(r));
    }
    return far;
}

static double look_at_all(pma_cone *x, const pma_cone_problem *p, double none)
{
    double far = 0.0;
    for (size_t i = 0; i < p->contacts; i++) {
        const double own = look(p, i, none, &x->target[i]);
        if (!isfinite(own))
            return INFINITY;
        far = fmax(far, own);
    }
    return far;
}

/* The unknowns, and by which key a factor would be kept; sets false in *keep where it would not. */
static size_t choose(pma_cone *x, const pma_cone_problem *p, bool *keep)
{
    size_t n = 0;
    for (size_t i = 0; i < p->contacts; i++) {
        const target *to = &x->target[i];
        const size_t tangents = tangents_of(p, i);
        const size_t what = to->state == STICKS ? 0 : to->d[0] > 0.0 ? 1 : 2;
        for (size_t k = p->at[i]; k < p->at[i + 1] && to->state != OPEN; k++) {
            x->wanted[n] = 3 * k + what;
            x->unknown[n++] = k;
        }
        if (to->state == SLIDES && tangents == 2)
            *keep = false; /* its direction turns */
    }
    return n;
}

/* Entry of tangent t of a sliding contact in column k: (z_t - mu z_n d)' with d' = D q',
 * D = (1 - d d^T) / |q|, q' = z_t' - W_t z' / r                                            (U7) */
static double slide(const pma_cone_problem *p, size_t contact, const target *to, size_t t, size_t k)
{
    const size_t at = p->at[contact], tangents = tangents_of(p, contact);
    const double mu = p->mu[contact], r = stiffest(p, contact);
    const double by = mu * fmax(0.0, p->z[at]) / to->length;
    double value = k == at + 1 + t ? 1.0 : 0.0;
    value -= k == at ? mu * to->d[t] : 0.0;
    for (size_t s = 0; s < tangents && tangents > 1; s++) {
        const double D = (s == t ? 1.0 : 0.0) - to->d[t] * to->d[s];
        value -= by * D * ((k == at + 1 + s ? 1.0 : 0.0) - entry(p, at + 1 + s, k) / r);
    }
    return value;
}

/* Rows of Newton's matrix and its right-hand side, scaled by sqrt(W_kk). */
static void assemble(pma_cone *x, const pma_cone_problem *p, size_t n, bool matrix)
{
    size_t row = 0;
    for (size_t i = 0; i < p->contacts; i++) {
        const target *to = &x->target[i];
        const size_t at = p->at[i];
        for (size_t k = at; k < p->at[i + 1] && to->state != OPEN; k++, row++) {
            const double root = sqrt(entry(p, k, k));
            const bool slides = to->state == SLIDES && k > at;
            const size_t t = k - at - 1;
            x->right[row] =
                slides ? -root * (p->z[k] - p->mu[i] * p->z[at] * to->d[t]) : -p->y[k] / root;
            for (size_t j = 0; j < n && matrix; j++) {
                const size_t column = x->unknown[j];
                const double scale = sqrt(entry(p, column, column));
                x->J[j * n + row] = slides ? root * slide(p, i, to, t, column) / scale
                                           : entry(p, k, column) / (root * scale);
            }
        }
    }
}

/* J = P L U in echelon form, row pivots: columns without a pivot follow from those before. */
static void factor(pma_cone *x, size_t n)
{
    double *J = x->J;
    x->rank = 0;
    for (size_t j = 0; j < n; j++) {
        const size_t k = x->rank;
        double *column = J + j * n;
        size_t most = k;
        for (size_t i = k; i < n; i++)
            most = fabs(column[i]) > fabs(column[most]) ? i : most;
        if (!(fabs(column[most]) > LOST))
            continue;
        x->swap[k] = most;
        x->pivot[k] = j;
        x->rank++;
        for (size_t c = 0; c < n && most != k; c++) {
            const double kept = J[c * n + k];
            J[c * n + k] = J[c * n + most];
            J[c * n + most] = kept;
        }
        for (size_t i = k + 1; i < n; i++)
            column[i] /= column[k];
        for (size_t c = j + 1; c < n; c++) {
            const double u = J[c * n + k];
            for (size_t i = k + 1; i < n && u != 0.0; i++)
                J[c * n + i] -= column[i] * u;
        }
    }
}

/* Adds the solution to z, scaled back; nothing where a column has no pivot. */
static void solve(pma_cone *x, const pma_cone_problem *p, size_t n)
{
    double *z = x->right;
    for (size_t k = 0; k < x->rank; k++) {
        const double kept = z[k];
        z[k] = z[x->swap[k]];
        z[x->swap[k]] = kept;
    }
    for (size_t k = 0; k < x->rank; k++) {
        const double *column = x->J + x->pivot[k] * n;
        for (size_t i = k + 1; i < x->rank; i++)
            z[i] -= column[i] * z[k];
    }
    for (size_t k = x->rank; k-- > 0;) {
        const double *column = x->J + x->pivot[k] * n;
        const size_t row = x->unknown[x->pivot[k]];
        z[k] /= column[k];
        for (size_t i = 0; i < k; i++)
            z[i] -= column[i] * z[k];
        p->z[row] += z[k] / sqrt(entry(p, row, row));
    }
}

/* One step from the states in x->target. */
static void iterate(pma_cone *x, const pma_cone_problem *p)
{
    bool keep = true;
    const size_t n = choose(x, p, &keep);
    for (size_t i = 0; i < p->contacts; i++) {
        for (size_t k = p->at[i]; k < p->at[i + 1] && x->target[i].state == OPEN; k++)
            change(p, k, -p->z[k]);
    }
    const bool known =
        keep && n > 0 && n == x->unknowns && memcmp(x->key, x->wanted, n * sizeof *x->key) == 0;
    assemble(x, p, n, !known);
    if (!known) {
        factor(x, n);
        memcpy(x->key, x->wanted, n * sizeof *x->key);
        x->unknowns = keep ? n : 0;
    }
    solve(x, p, n);
    find_velocities(p);
}

/* True when z solves the problem up to `tolerance`, z and y as before where it does not. */
static bool newton(pma_cone *x, const pma_cone_problem *p, double tolerance)
{
    memcpy(x->kept, p->z, p->rows * sizeof(double));
    for (size_t turn = 0; turn < MOST_ITERATIONS; turn++) {
        const double rounding = rounding_of(p);
        if (look_at_all(x, p, rounding) <= fmax(rounding, rounding < 0.0 ? rounding : tolerance))
            return true;
        iterate(x, p);
    }
    memcpy(p->z, x->kept, p->rows * sizeof(double));
    find_velocities(p);
    return false;
}

/* ---- redundant rows ------------------------------------------------------------------------- */

/* W_kk and b of the problem, or with e W_kk (z - z0)_k added to y; z0 is the present z. */
static void soften(pma_cone *x, const pma_cone_problem *p, double e)
{
    for (size_t k = 0; k < p->rows; k++) {
        p->W[k * p->rows + k] = (1.0 + e) * x->diagonal[k];
        p->b[k] = x->b[k] - e * x->diagonal[k] * p->z[k];
    }
    find_velocities(p);
}

/* Proximal points: problems with one solution each, which lead to one of the problem where rows
 * follow from others. True at the solution up to rounding. */
static bool approach(pma_cone *x, const pma_cone_problem *p)
{
    bool found = false;
    for (size_t k = 0; k < p->rows; k++) {
        x->diagonal[k] = entry(p, k, k);
        x->b[k] = p->b[k];
    }
    x->unknowns = 0;
    for (size_t turn = 0; turn < MOST_POINTS && !found; turn++) {
        const double rounding = rounding_of(p), far = look_at_all(x, p, rounding);
        size_t row;
        found = far <= rounding;
        if (found)
            break;
        soften(x, p, SOFT);
        if (!newton(x, p, CLOSER * far)) {
            for (size_t k = 0; k < MOST_BETWEEN; k++) {
                if (sweep(p, &row) <= CLOSER * far)
                    break;
            }
        }
        soften(x, p, 0.0);
    }
    x->unknowns = 0;
    return found;
}

/* ---- all of it ------------------------------------------------------------------------------ */

static bool is_exact(pma_cone *x, const pma_cone_problem *p)
{
    if (!newton(x, p, 0.0))
        return false;
    for (size_t i = 0; i < p->contacts; i++)
        sweep_contact(p, i); /* what is rounding: into the cones */
    return true;
}

pma_status pma_cone_solve(pma_cone *x, const pma_cone_problem *p, size_t *row)
{
    const double tolerance = TOLERANCE * size_of(p);
    const bool exact = p->rows <= MOST_FACTORED;
    find_velocities(p);
    if (p->rows <= SMALL && is_exact(x, p))
        return PMA_OK;
    for (size_t turn = 1; turn <= PMA_MOST_SWEEPS; turn++) {
        const bool ends = sweep(p, row) <= tolerance;
        if (exact && (ends || turn == FEW_SWEEPS) && is_exact(x, p))
            return PMA_OK;
        if (ends || (exact && turn == FEW_SWEEPS && approach(x, p) && is_exact(x, p)))
            return PMA_OK;
    }
    return PMA_NO_IMPULSES;
}
