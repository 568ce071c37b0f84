/* inner.c - see inner.h. */
#include "inner.h"

#include <math.h>
#include <string.h>

#include "matrices.h"
#include "subdomains.h"

/* ---- a full pattern -------------------------------------------------------------------------- */

static void add_supernode(full_pattern *q, size_t *count, size_t n, size_t begin, size_t end)
{
    if (begin == end)
        return;
    int64_t rows = q->row_ptr[*count];
    for (size_t i = end; i < n; i++)
        q->rows[rows++] = (int32_t)i;
    for (size_t i = begin; i < end; i++)
        q->owner[i] = (int64_t)*count;
    q->start[*count + 1] = q->start[*count] + (int64_t)((end - begin) * (n - begin));
    *count += 1;
    q->first[*count] = (int64_t)end;
    q->row_ptr[*count] = rows;
}

pma_numeric_parts describe_full(full_pattern *q, size_t n, size_t nb)
{
    size_t count = 0;
    *q = (full_pattern){.ptr = {0}};
    for (size_t i = 0; i < n; i++) {
        q->ptr[i + 1] = (int64_t)((i + 1) * n);
        for (size_t j = 0; j < n; j++)
            q->index[i * n + j] = (int32_t)j;
    }
    add_supernode(q, &count, n, 0, n - nb);
    add_supernode(q, &count, n, n - nb, n);
    return (pma_numeric_parts){
        .n = n,
        .nb = nb,
        .ptr = q->ptr,
        .index = q->index,
        .panels = {count, q->first, q->row_ptr, q->rows, q->start, NULL, 0},
        .owner = q->owner,
        .blas = NAIVE_BLAS,
    };
}

/* ---- the functions --------------------------------------------------------------------------- */

/* What they were given are copies: they may be spoilt. */
static int leave(inner *x, intptr_t n, double *u, double *v, double *f)
{
    x->evaluated++;
    for (intptr_t i = 0; i < n; i++)
        u[i] = v[i] = NAN;
    if (x->spoil_from > 0 && x->evaluated >= x->spoil_from)
        f[0] = NAN;
    return x->evaluated == x->fail_at ? 7 : 0;
}

/* Arrays are added to, so that one that did not arrive zeroed shows in the result. */
static int elastic(double t, intptr_t n, double *u, double *v, double *q, double *f, double *K,
                   double *C, double *q1, void *user)
{
    inner *x = user;
    (void)q, (void)C, (void)q1;
    for (intptr_t i = 0; i < n; i++) {
        f[i] += x->cubic * u[i] * u[i] * u[i] + x->ramp * t;
        for (intptr_t j = 0; j < n; j++)
            f[i] += x->K1[i * n + j] * u[j];
    }
    for (intptr_t k = 0; K && k < n * n; k++)
        K[k] += x->K1[k] + (k % (n + 1) == 0 ? 3.0 * x->cubic * u[k / n] * u[k / n] : 0.0);
    return leave(x, n, u, v, f);
}

static double flow(double u, double p, double yield)
{
    return fabs(u - p) > yield ? u - copysign(yield, u - p) : p;
}

static int plastic(double t, intptr_t n, double *u, double *v, double *q, double *f, double *K,
                   double *C, double *q1, void *user)
{
    inner *x = user;
    (void)t;
    const double p = flow(u[0], q[0], x->yield);
    f[0] += x->plastic * (u[0] - p);
    for (intptr_t i = 0; i < n; i++) {
        for (intptr_t j = 0; j < n; j++)
            f[i] += x->K2[i * n + j] * u[j] + x->C2[i * n + j] * v[j];
    }
    for (intptr_t k = 0; K && k < n * n; k++) {
        K[k] += x->K2[k];
        C[k] += x->C2[k];
    }
    if (K && p == q[0])
        K[0] += x->plastic;
    q1[0] += p - q[0]; /* of q, as which it arrives */
    q1[1] += 1.0;
    q[0] = q[1] = NAN;
    return leave(x, n, u, v, f);
}

void naive_inner(const subdomain *x, double t, const double *u, const double *q, double *f,
                 double *q1)
{
    const inner *in = &x->inner;
    memset(f, 0, x->n * sizeof(double));
    if (!in->used)
        return;
    for (size_t i = 0; i < x->n; i++)
        f[i] = in->cubic * pow(u[i], 3.0) + in->ramp * t;
    q1[0] = flow(u[x->n - 1], q[0], in->yield);
    q1[1] = q[1] + 1.0;
    f[x->n - 1] += in->plastic * (u[x->n - 1] - q1[0]);
}

/* ---- a subdomain ----------------------------------------------------------------------------- */

void share_matrices(subdomain *x)
{
    inner *in = &x->inner;
    const size_t n = x->n;
    const double damping = in->used && x->implicit ? 0.5 : 0.0, stiffness = in->used ? 0.25 : 0.0;
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < n; j++) {
            const size_t ours = i * n + j, user = (n - 1 - i) * n + (n - 1 - j);
            in->K1[user] = 2.0 * stiffness * x->K[ours];
            in->K2[user] = stiffness * x->K[ours];
            in->C2[user] = damping * x->C[ours];
            in->K[ours] = (1.0 - 3.0 * stiffness) * x->K[ours] - in->springs_K[ours];
            in->C[ours] = (1.0 - damping) * x->C[ours];
            in->where[user] = (int64_t)ours;
        }
    }
}

pma_internal describe_internal(subdomain *x)
{
    inner *in = &x->inner;
    const size_t entries = x->implicit ? x->n * x->n : 0;
    in->forces[0] = (pma_internal_force){.function = elastic, .user = in};
    in->forces[1] = (pma_internal_force){.function = plastic, .user = in, .history = HISTORY};
    for (size_t k = 0; k < 2; k++) {
        in->forces[k].entries = entries;
        in->forces[k].where = in->where;
    }
    return (pma_internal){.n = x->n,
                          .count = in->used ? 2 : 0,
                          .history = in->used ? HISTORY : 0,
                          .forces = in->forces,
                          .order = x->order,
                          .initial = in->initial};
}

const pma_iterate_parts *describe_iterate(subdomain *x, const double *al1, const double *al2)
{
    inner *in = &x->inner;
    const size_t n = x->n;
    for (size_t i = 0; i < n * n; i++) {
        const double C = x->D_r[i] + (x->lagged ? 0.0 : in->C[i]);
        in->M_size[i] = fabs(x->M[i]);
        for (size_t twice = 0; twice < 2; twice++)
            in->base[twice][i] = x->M[i] + al2[twice] * C + al1[twice] * (in->K[i] + x->K_r[i]);
    }
    in->iterate = (pma_iterate_parts){.springs = in->springs,
                                      .keeps = in->keeps,
                                      .tangent = describe_full(&in->pattern, n, x->nb),
                                      .base = in->base[0],
                                      .base_twice = in->base[1],
                                      .M_size = {.form = PMA_DENSE, .n = n, .values = in->M_size}};
    return in->used && x->implicit ? &in->iterate : NULL;
}
