#include "forces/internal.h"

#include <assert.h>
#include <math.h>
#include <string.h>

/* Tangents are symmetric to this part of their largest entry. */
#define SYMMETRY 1e-9

pma_status pma_internal_check(const pma_internal *internal, size_t entries)
{
    size_t history = 0;
    for (size_t i = 0; internal->count > 0 && i < internal->n; i++) {
        if (internal->order[i] < 0 || (size_t)internal->order[i] >= internal->n)
            return PMA_BAD_INDEX;
    }
    for (size_t k = 0; k < internal->count; k++) {
        const pma_internal_force *force = &internal->forces[k];
        history += force->history;
        for (size_t i = 0; i < force->entries; i++) {
            if (force->where[i] < 0 || (size_t)force->where[i] >= entries)
                return PMA_BAD_INDEX;
            if (force->across && force->across[i] >= (int64_t)force->entries)
                return PMA_BAD_INDEX;
        }
    }
    return history == internal->history ? PMA_OK : PMA_BAD_SIZE;
}

static size_t most_entries(const pma_internal *internal)
{
    size_t most = 0;
    for (size_t k = 0; k < internal->count; k++)
        most = internal->forces[k].entries > most ? internal->forces[k].entries : most;
    return most;
}

/* u, v and f in the user's order, K and C of one function, q and q1 */
size_t pma_internal_scratch(const pma_internal *internal)
{
    if (internal->count == 0)
        return 0;
    return 3 * internal->n + 2 * most_entries(internal) + 2 * internal->history;
}

static bool is_symmetric(const pma_internal_force *force, const double *tangent)
{
    double largest = 0.0, skew = 0.0;
    for (size_t i = 0; force->across && i < force->entries; i++) {
        const double other = force->across[i] < 0 ? 0.0 : tangent[force->across[i]];
        largest = fmax(largest, fabs(tangent[i]));
        skew = fmax(skew, fabs(tangent[i] - other));
    }
    return skew <= SYMMETRY * largest;
}

pma_status pma_internal_evaluate(const pma_internal *internal, const pma_internal_point *x,
                                 const pma_internal_values *out, double *scratch, int *code)
{
    assert(internal->count == 0 || (scratch && code));
    double *const tangent = out->tangent, *const stiffness = out->stiffness;
    const size_t n = internal->n, entries = internal->count > 0 ? most_entries(internal) : 0;
    double *own_u = scratch, *own_v = own_u + n, *own_f = own_v + n;
    double *K = own_f + n, *C = K + entries, *own_q = C + entries;
    double *own_q1 = own_q + internal->history;
    size_t at = 0;
    for (size_t k = 0; k < internal->count; k++) {
        const pma_internal_force *force = &internal->forces[k];
        for (size_t i = 0; i < n; i++) {
            own_u[internal->order[i]] = x->u[i];
            own_v[internal->order[i]] = x->v[i];
        }
        memset(own_f, 0, n * sizeof(double));
        memset(K, 0, 2 * entries * sizeof *K);
        memcpy(own_q + at, x->q + at, force->history * sizeof(double));
        memcpy(own_q1 + at, x->q + at, force->history * sizeof(double));
        *code = force->function(x->t, (intptr_t)n, own_u, own_v, own_q + at, own_f,
                                tangent ? K : NULL, tangent ? C : NULL, own_q1 + at, force->user);
        if (*code != 0)
            return PMA_INTERNAL_FAILED;
        if (tangent && !(is_symmetric(force, K) && is_symmetric(force, C)))
            return PMA_UNSYMMETRIC;
        for (size_t i = 0; i < n; i++)
            out->f[i] += own_f[internal->order[i]];
        for (size_t i = 0; tangent && i < force->entries; i++)
            tangent[force->where[i]] += out->al1 * K[i] + out->al2 * C[i];
        for (size_t i = 0; tangent && stiffness && i < force->entries; i++)
            stiffness[force->where[i]] += K[i];
        at += force->history;
    }
    if (internal->count > 0)
        memcpy(out->q1, own_q1, internal->history * sizeof(double));
    return PMA_OK;
}

bool pma_internal_has_potential(const pma_internal *internal)
{
    for (size_t k = 0; k < internal->count; k++) {
        if (internal->forces[k].potential)
            return true;
    }
    return false;
}

pma_status pma_internal_potential(const pma_internal *internal, const double *u, double *energy,
                                  double *scratch, int *code)
{
    *energy = 0.0;
    for (size_t k = 0; k < internal->count; k++) {
        const pma_internal_force *force = &internal->forces[k];
        double stored = 0.0;
        if (!force->potential)
            continue;
        for (size_t i = 0; i < internal->n; i++)
            scratch[internal->order[i]] = u[i];
        *code = force->potential((intptr_t)internal->n, scratch, &stored, force->user);
        if (*code != 0)
            return PMA_INTERNAL_FAILED;
        *energy += stored;
    }
    return PMA_OK;
}
