#include "solve/complementarity.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "memory.h"
#include "object.h"
#include "solve/cone.h"

/* Columns of the factor made before what is right of them is updated. */
enum { BLOCK = 48 };

/* Pivoting in blocks for this number of turns without fewer rows that are wrong, then one row at a
 * time, at most as often as there are rows, and some more; then sweeps. */
enum { PATIENCE = 8, MORE_TURNS = 100 };

/* Part of the largest b: the rounding of a solution. A pivot below this part of its diagonal entry
 * is that of a row which follows from the others. */
static const double ROUNDING = 1e-12, SHARE = 1e-2, LOST = 1e-11;

struct pma_complementarity {
    pma_complementarity_parts parts;
    size_t rows, turns;
    const double *W;
    double *factor; /* of W in `factor_rows` rows, by columns; or W in the closed rows, of sweeps */
    size_t factor_rows;   /* rows of the factor; none of them where it is not known */
    size_t *in;           /* rows: of the factor */
    size_t *wanted;       /* rows: that are to push */
    size_t *active;       /* rows: of the closed contacts */
    size_t *top, *bottom; /* rows of the factor: where its columns begin and end */
    bool *pushing;        /* rows */
    bool *follows;        /* rows of the factor: it follows from those before */
    double *y, *z;        /* rows */
    pma_cone *cone;
    size_t coned, *seen; /* closed rows of its last problem */
    size_t *at;          /* contacts+1: in the closed rows */
    double *mu, *load;   /* contacts, rows: of the closed ones */
};

pma_status pma_complementarity_create(const pma_complementarity_parts *parts,
                                      pma_complementarity **out)
{
    const size_t rows = (size_t)parts->first[parts->contacts];
    const pma_array arrays[] = {PMA_ARRAY(pma_complementarity, factor, rows * rows),
                                PMA_ARRAY(pma_complementarity, in, rows),
                                PMA_ARRAY(pma_complementarity, wanted, rows),
                                PMA_ARRAY(pma_complementarity, active, rows),
                                PMA_ARRAY(pma_complementarity, top, rows),
                                PMA_ARRAY(pma_complementarity, bottom, rows),
                                PMA_ARRAY(pma_complementarity, pushing, rows),
                                PMA_ARRAY(pma_complementarity, follows, rows),
                                PMA_ARRAY(pma_complementarity, y, rows),
                                PMA_ARRAY(pma_complementarity, z, rows),
                                PMA_ARRAY(pma_complementarity, seen, rows),
                                PMA_ARRAY(pma_complementarity, at, rows + 1),
                                PMA_ARRAY(pma_complementarity, mu, rows),
                                PMA_ARRAY(pma_complementarity, load, rows),
                                {0}};
    pma_complementarity *x = *out = pma_object_create(sizeof *x, arrays);
    if (!x)
        return PMA_NO_MEMORY;
    x->parts = *parts;
    x->rows = rows;
    x->cone = pma_cone_create(rows);
    if (x->cone)
        return PMA_OK;
    pma_memory_release(x);
    *out = NULL;
    return PMA_NO_MEMORY;
}

void pma_complementarity_destroy(pma_complementarity *x)
{
    if (x)
        pma_cone_destroy(x->cone);
    pma_memory_release(x);
}

void pma_complementarity_set(pma_complementarity *x, const double *W)
{
    x->W = W;
    x->factor_rows = 0;
    pma_cone_forget(x->cone);
}

static double entry(const pma_complementarity *x, size_t i, size_t j)
{
    return x->W[j * x->rows + i];
}

/* max |b_k| / sqrt(W_kk) over the closed rows: b and P are compared in units of energy */
static double size_of(const pma_complementarity *x, size_t count, const double *b)
{
    double size = 0.0;
    for (size_t i = 0; i < count; i++) {
        const size_t k = x->active[i];
        size = fmax(size, fabs(b[k]) / sqrt(entry(x, k, k)));
    }
    return size;
}

/* ... or the part SHARE of max |P_k| sqrt(W_kk), where large impulses cancel each other */
static double size_with(const pma_complementarity *x, size_t count, const double *P, double size)
{
    for (size_t i = 0; i < count; i++) {
        const size_t k = x->active[i];
        size = fmax(size, SHARE * fabs(P[k]) * sqrt(entry(x, k, k)));
    }
    return size;
}

/* ---- the factor of W in some rows: A = L U, L with a unit diagonal, without exchanges -------- */

/* W need not be symmetric, but its symmetric part is positive semidefinite: pivots are not negative
 * but for rounding. Rows that follow from those before are left out. Nothing is below `low`. */
static void factor_columns(pma_complementarity *x, size_t n, size_t begin, size_t end, size_t low)
{
    double *A = x->factor;
    for (size_t j = begin; j < end; j++) {
        double *column = A + j * n;
        x->follows[j] = !(column[j] > LOST * entry(x, x->in[j], x->in[j]));
        for (size_t i = j + 1; i < low; i++)
            column[i] = x->follows[j] ? 0.0 : column[i] / column[j];
        if (x->follows[j])
            column[j] = 1.0;
        for (size_t k = j + 1; k < end && !x->follows[j]; k++) {
            const double u = A[k * n + j];
            for (size_t i = j + 1; i < low; i++)
                A[k * n + i] -= column[i] * u;
        }
    }
}

/* U in the rows begin..end-1, right of them up to `right`: what of it follows is not read */
static void finish_rows(pma_complementarity *x, size_t n, size_t begin, size_t end, size_t right)
{
    double *A = x->factor;
    for (size_t k = end; k < right; k++) {
        for (size_t j = begin; j < end; j++) {
            const double u = A[k * n + j];
            for (size_t i = j + 1; i < end && !x->follows[j]; i++)
                A[k * n + i] -= A[j * n + i] * u;
            if (x->follows[j])
                A[k * n + j] = 0.0;
        }
    }
}

/* Where the columns begin..end-1 of A end, at least at `end`. */
static size_t lowest(const double *A, size_t n, size_t begin, size_t end)
{
    size_t low = end;
    for (size_t j = begin; j < end; j++) {
        size_t i = n;
        while (i > low && A[j * n + i - 1] == 0.0)
            i--;
        low = i;
    }
    return low;
}

/* Where the rows begin..end-1 of A end, at least at `end`. */
static size_t rightmost(const double *A, size_t n, size_t begin, size_t end)
{
    for (size_t k = n; k > end; k--) {
        for (size_t i = begin; i < end; i++) {
            if (A[(k - 1) * n + i] != 0.0)
                return k;
        }
    }
    return end;
}

static void factor(pma_complementarity *x, size_t n)
{
    double *A = x->factor;
    const pma_block all = {A, n};
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < n; i++)
            A[j * n + i] = entry(x, x->in[i], x->in[j]);
    }
    for (size_t begin = 0; begin < n; begin += BLOCK) {
        const size_t end = n - begin < BLOCK ? n : begin + BLOCK;
        const size_t low = lowest(A, n, begin, end), right = rightmost(A, n, begin, end);
        factor_columns(x, n, begin, end, low);
        finish_rows(x, n, begin, end, right);
        pma_blas_multiply(&x->parts.blas, low - end, right - end, end - begin, -1.0,
                          pma_block_at(all, end, begin), pma_block_at(all, begin, end), false, 1.0,
                          pma_block_at(all, end, end));
    }
    x->factor_rows = n;
    for (size_t j = 0; j < n; j++) {
        x->top[j] = 0;
        x->bottom[j] = n;
        while (x->top[j] < j && A[j * n + x->top[j]] == 0.0)
            x->top[j]++;
        while (x->bottom[j] > j + 1 && A[j * n + x->bottom[j] - 1] == 0.0)
            x->bottom[j]--;
    }
}

/* z (n) := A^-1 z, zero in rows that follow */
static void solve(const pma_complementarity *x, size_t n, double *z)
{
    const double *A = x->factor;
    for (size_t j = 0; j < n; j++) {
        z[j] = x->follows[j] ? 0.0 : z[j];
        for (size_t i = j + 1; i < x->bottom[j]; i++)
            z[i] -= A[j * n + i] * z[j];
    }
    for (size_t j = n; j-- > 0;) {
        z[j] = x->follows[j] ? 0.0 : z[j] / A[j * n + j];
        for (size_t i = x->top[j]; i < j; i++)
            z[i] -= A[j * n + i] * z[j];
    }
}

/* ---- without friction: block principal pivoting ---------------------------------------------- */

/* P of W P + b = 0 in the rows that push, 0 in the others, whose y is found */
static void solve_pushing(pma_complementarity *x, size_t count, const double *b, double *P)
{
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        if (x->pushing[x->active[i]])
            x->wanted[n++] = x->active[i];
    }
    if (n != x->factor_rows || memcmp(x->in, x->wanted, n * sizeof *x->in) != 0) {
        memcpy(x->in, x->wanted, n * sizeof *x->in);
        factor(x, n);
    }
    x->turns++;
    for (size_t i = 0; i < n; i++)
        x->z[i] = -b[x->in[i]];
    solve(x, n, x->z);
    size_t rest = 0;
    for (size_t i = 0; i < count; i++) {
        const size_t k = x->active[i];
        P[k] = 0.0;
        x->y[k] = b[k];
        if (!x->pushing[k])
            x->wanted[rest++] = k;
    }
    for (size_t j = 0; j < n; j++) {
        P[x->in[j]] = x->z[j];
        for (size_t i = 0; i < rest; i++)
            x->y[x->wanted[i]] += entry(x, x->wanted[i], x->in[j]) * x->z[j];
    }
}

/* P_k < 0 where it pushes, y_k < 0 where it does not, but for rounding */
static bool is_wrong(const pma_complementarity *x, size_t k, const double *P, double size)
{
    const double root = sqrt(entry(x, k, k));
    return x->pushing[k] ? P[k] < -ROUNDING * size / root : x->y[k] < -ROUNDING * size * root;
}

static bool any_follows(const pma_complementarity *x)
{
    bool any = false;
    for (size_t j = 0; j < x->factor_rows; j++)
        any = any || x->follows[j];
    return any;
}

/* The rows that are wrong, in x->wanted; their number. */
static size_t find_wrong(pma_complementarity *x, size_t count, const double *P, double size)
{
    size_t wrong = 0;
    size = size_with(x, count, P, size);
    for (size_t i = 0; i < count; i++) {
        if (is_wrong(x, x->active[i], P, size))
            x->wanted[wrong++] = x->active[i];
    }
    return wrong;
}

/* True when the solution was found. */
static bool pivot(pma_complementarity *x, size_t count, const double *b, double *P)
{
    const double size = size_of(x, count, b);
    size_t best = SIZE_MAX, patience = PATIENCE, wrong = 1;
    for (x->turns = 0; wrong > 0 && x->turns < count + MORE_TURNS;) {
        solve_pushing(x, count, b, P);
        wrong = find_wrong(x, count, P, size);
        patience = wrong < best ? PATIENCE : patience > 0 ? patience - 1 : 0;
        best = wrong < best ? wrong : best;
        if (patience == 0 && any_follows(x))
            break; /* one at a time ends for regular W alone */
        /* all at once; or, as Murty, always the last of them alone */
        for (size_t i = patience > 0 || wrong == 0 ? 0 : wrong - 1; i < wrong; i++)
            x->pushing[x->wanted[i]] = !x->pushing[x->wanted[i]];
    }
    for (size_t i = 0; i < count; i++)
        P[x->active[i]] = fmax(P[x->active[i]], 0.0);
    return wrong == 0;
}

/* ---- with friction --------------------------------------------------------------------------- */

/* b, P and W in the closed rows, for cones */
static pma_cone_problem gather(pma_complementarity *x, size_t count, size_t contacts,
                               const size_t *closed, const double *b, const double *P)
{
    size_t at = 0;
    for (size_t i = 0; i < contacts; i++) {
        x->at[i] = at;
        x->mu[i] = x->parts.friction[closed[i]];
        at += (size_t)(x->parts.first[closed[i] + 1] - x->parts.first[closed[i]]);
    }
    x->at[contacts] = at;
    for (size_t j = 0; j < count; j++) {
        x->load[j] = b[x->active[j]];
        x->z[j] = P[x->active[j]];
        for (size_t i = 0; i < count; i++)
            x->factor[j * count + i] = entry(x, x->active[i], x->active[j]);
    }
    x->factor_rows = 0; /* the factor was overwritten */
    if (count != x->coned || memcmp(x->active, x->seen, count * sizeof *x->seen) != 0)
        pma_cone_forget(x->cone);
    memcpy(x->seen, x->active, count * sizeof *x->seen);
    x->coned = count;
    return (pma_cone_problem){.contacts = contacts,
                              .rows = count,
                              .at = x->at,
                              .mu = x->mu,
                              .W = x->factor,
                              .b = x->load,
                              .z = x->z,
                              .y = x->y};
}

static pma_status solve_cones(pma_complementarity *x, size_t count, size_t contacts,
                              const size_t *closed, const double *b, double *P, size_t *row)
{
    const pma_cone_problem problem = gather(x, count, contacts, closed, b, P);
    const pma_status status = pma_cone_solve(x->cone, &problem, row);
    if (status != PMA_OK)
        *row = x->active[*row];
    for (size_t i = 0; i < count; i++)
        P[x->active[i]] = x->z[i];
    return status;
}

/* ---- both ----------------------------------------------------------------------------------- */

/* The rows of the closed contacts, the normal ones alone or with tangents; their number. */
static size_t activate(pma_complementarity *x, size_t count, const size_t *closed, bool tangents)
{
    const int64_t *first = x->parts.first;
    size_t all = 0;
    for (size_t i = 0; i < count; i++) {
        const int64_t end = tangents ? first[closed[i] + 1] : first[closed[i]] + 1;
        for (int64_t k = first[closed[i]]; k < end; k++)
            x->active[all++] = (size_t)k;
    }
    return all;
}

static bool is_rough(const pma_complementarity *x, size_t k)
{
    return x->parts.friction[k] > 0.0 && x->parts.first[k + 1] - x->parts.first[k] > 1;
}

pma_status pma_complementarity_solve(pma_complementarity *x, size_t count, const size_t *closed,
                                     const double *b, double *P, size_t *row)
{
    bool rough = false;
    size_t rows = activate(x, count, closed, true);
    for (size_t i = 0; i < count; i++)
        rough = rough || is_rough(x, closed[i]);
    /* what pushed and is closed */
    memset(x->pushing, 0, x->rows * sizeof *x->pushing);
    for (size_t i = 0; i < rows; i++)
        x->pushing[x->active[i]] = true;
    for (size_t k = 0; k < x->rows; k++) {
        P[k] = x->pushing[k] ? P[k] : 0.0;
        x->pushing[k] = x->pushing[k] && P[k] > 0.0;
    }
    if (!rough && pivot(x, activate(x, count, closed, false), b, P))
        return PMA_OK;
    rows = activate(x, count, closed, true);
    return solve_cones(x, rows, count, closed, b, P, row);
}

size_t pma_complementarity_turns(const pma_complementarity *x)
{
    return x->turns;
}
