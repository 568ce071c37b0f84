#include "member/iterate.h"

#include <stdlib.h>
#include <string.h>

#include "member/iterated_substep.h"

/* ---- making --------------------------------------------------------------------------------- */

static pma_status check(const pma_parts *p, const pma_iterate_parts *parts)
{
    if (parts->tangent.n != p->n || parts->tangent.nb != p->nb || parts->M_size.n != p->n)
        return PMA_BAD_SIZE;
    return pma_matrix_check(&parts->M_size);
}

static size_t entries_of_link(const pma_link *L)
{
    return L->nb > 0 ? (size_t)L->ptr[L->nb] : 0;
}

/* The place of a row among those of the subdomain, which ascend. */
static size_t place_of(const pma_iterate *it, int64_t row)
{
    size_t low = 0, high = it->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (it->rows[middle] < row)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void find_rows(pma_iterate *it)
{
    const pma_link *L = &it->of->parts.link;
    for (size_t k = 0; k < entries_of_link(L); k++)
        it->rows[L->index[k]] = 1; /* zero before */
    for (size_t row = 0; row < L->p; row++) {
        if (it->rows[row] != 0)
            it->rows[it->count++] = (int64_t)row;
    }
    for (size_t k = 0; k < entries_of_link(L); k++)
        it->column[k] = place_of(it, L->index[k]);
}

static int64_t spring_entry(const pma_iterate *it, int32_t row, int32_t column)
{
    if (row < 0 || column < 0)
        return -1;
    return (int64_t)pma_numeric_entry(&it->parts.tangent, (size_t)row, (size_t)column);
}

/* PMA_BAD_INDEX where the pattern lacks an entry of a spring. */
static pma_status find_spring_entries(pma_iterate *it)
{
    const pma_springs *springs = &it->of->parts.springs;
    int64_t *at = it->spring_entries;
    for (size_t s = 0; it->parts.springs && s < springs->count; s++) {
        const pma_spring_set *set = &springs->sets[s];
        for (size_t i = 0; i < set->count; i++, at += 4) {
            const int32_t ends[2] = {set->first[i], set->second[i]};
            for (size_t k = 0; k < 4; k++) {
                at[k] = spring_entry(it, ends[k / 2], ends[k % 2]);
                if (at[k] == (int64_t)SIZE_MAX && ends[k / 2] >= 0 && ends[k % 2] >= 0)
                    return PMA_BAD_INDEX;
            }
        }
    }
    return PMA_OK;
}

static double *take(double **next, size_t count)
{
    double *taken = *next;
    *next += count;
    return taken;
}

static pma_status allocate(pma_iterate *it)
{
    const pma_parts *p = &it->of->parts;
    const size_t n = p->n, total = p->springs.total, springs = pma_iterate_spring_numbers(it);
    const size_t history = p->internal.history, functions = pma_internal_scratch(&p->internal);
    const size_t kept = it->parts.keeps ? (size_t)it->parts.tangent.ptr[n] : 0;
    const size_t stiffness = p->internal.count > 0 ? (size_t)it->parts.tangent.ptr[n] : 0;
    const size_t size = 15 * n + 2 * p->nb + 2 * p->link.p + springs + total + history + functions +
                        kept + stiffness;
    it->block = calloc(size + 1, sizeof(double));
    it->rows = calloc(p->link.p + 1, sizeof *it->rows);
    it->column = calloc(entries_of_link(&p->link) + 1, sizeof *it->column);
    it->spring_entries = calloc(4 * total + 1, sizeof *it->spring_entries);
    it->diagonal = calloc(n + 1, sizeof *it->diagonal);
    if (!it->block || !it->rows || !it->column || !it->spring_entries || !it->diagonal)
        return PMA_NO_MEMORY;
    double *next = it->block;
    double **const vectors[15] = {&it->u_n,  &it->v_n,     &it->fixed,  &it->guess, &it->u,
                                  &it->v,    &it->f,       &it->force,  &it->R,     &it->dw,
                                  &it->size, &it->product, &it->forces, &it->limit, &it->rounding};
    for (size_t i = 0; i < 15; i++)
        *vectors[i] = take(&next, n);
    it->pull = take(&next, p->nb);
    it->pull_size = take(&next, p->nb);
    it->lam = take(&next, 2 * p->link.p);
    it->springs_n = take(&next, springs);
    it->slopes = take(&next, total);
    it->history_n = take(&next, history);
    it->scratch = take(&next, functions);
    it->entries = take(&next, kept);
    it->stiffness = take(&next, stiffness);
    return PMA_OK;
}

pma_status pma_iterate_create(pma_subdomain *s, const pma_iterate_parts *parts, pma_iterate **out)
{
    *out = NULL;
    pma_status status = check(&s->parts, parts);
    if (status != PMA_OK)
        return status;
    pma_iterate *it = calloc(1, sizeof *it);
    if (!it)
        return PMA_NO_MEMORY;
    it->of = s;
    it->parts = *parts;
    status = pma_numeric_create(&parts->tangent, &it->numeric);
    if (status == PMA_OK)
        status = allocate(it);
    if (status == PMA_OK) {
        find_rows(it);
        for (size_t i = 0; i < s->parts.n; i++)
            it->diagonal[i] = (int64_t)pma_numeric_entry(&parts->tangent, i, i);
        status = find_spring_entries(it);
    }
    if (status == PMA_OK) {
        it->many =
            calloc(pma_numeric_compliance_scratch(&it->numeric, it->count) + 1, sizeof *it->many);
        status = it->many ? PMA_OK : PMA_NO_MEMORY;
    }
    if (status != PMA_OK) {
        pma_iterate_destroy(it);
        return status;
    }
    *out = it;
    return PMA_OK;
}

void pma_iterate_destroy(pma_iterate *it)
{
    if (!it)
        return;
    pma_numeric_destroy(&it->numeric);
    free(it->block);
    free(it->many);
    free(it->rows);
    free(it->column);
    free(it->spring_entries);
    free(it->diagonal);
    free(it);
}

const pma_iterate_parts *pma_iterate_get_parts(const pma_iterate *it)
{
    return &it->parts;
}

const pma_factor *pma_iterate_factor(const pma_iterate *it)
{
    return &it->numeric.factor;
}

double *pma_iterate_force(const pma_iterate *it)
{
    return it->force;
}

/* ---- what belongs to the present ------------------------------------------------------------ */

pma_iterate_failure pma_iterate_failed(const pma_iterate *it)
{
    return (pma_iterate_failure){
        .t = it->step.t1, .iterations = it->corrections, .dof = it->singular};
}

double pma_iterate_scale(const pma_iterate *it)
{
    return it->scale_present;
}

const double *pma_iterate_kept(const pma_iterate *it, bool *twice)
{
    *twice = it->factored_twice_present;
    return it->parts.keeps && it->factored_present ? it->entries : NULL;
}

size_t pma_iterate_entries(const pma_iterate *it)
{
    return (size_t)it->parts.tangent.ptr[it->parts.tangent.n];
}

pma_status pma_iterate_restore(pma_iterate *it, double scale, const double *kept, bool twice)
{
    it->scale = it->scale_present = scale;
    it->factored = it->factored_present = kept != NULL;
    it->factored_twice = it->factored_twice_present = twice;
    it->refactored = it->overwritten = false;
    if (!kept || !it->parts.keeps)
        return PMA_OK;
    size_t column;
    memcpy(it->entries, kept, pma_iterate_entries(it) * sizeof(double));
    memcpy(it->numeric.values, kept, pma_iterate_entries(it) * sizeof(double));
    return pma_numeric_factor(&it->numeric, &column);
}

void pma_iterate_commit(pma_iterate *it)
{
    it->scale_present = it->scale;
    it->factored_present = it->factored;
    it->factored_twice_present = it->factored_twice;
    if (it->parts.keeps && it->refactored)
        memcpy(it->entries, it->numeric.factored, pma_iterate_entries(it) * sizeof(double));
    it->refactored = false;
}

void pma_iterate_discard(pma_iterate *it)
{
    it->scale = it->scale_present;
    if (!it->refactored)
        return;
    const double *kept = it->parts.keeps && it->factored_present ? it->entries : NULL;
    pma_iterate_restore(it, it->scale_present, kept, it->factored_twice_present);
}
