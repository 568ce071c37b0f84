#include "subdomain/iterate.h"

#include <math.h>
#include <string.h>

#include "memory.h"
#include "object.h"
#include "subdomain/iterated_substep.h"

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

static pma_status allocate(pma_iterate *it)
{
    const pma_parts *p = &it->of->parts;
    const size_t n = p->n, total = p->springs.total, entries = pma_iterate_entries(it);
    const pma_array arrays[] = {
        PMA_ARRAY(pma_iterate, u_n, n),
        PMA_ARRAY(pma_iterate, v_n, n),
        PMA_ARRAY(pma_iterate, fixed, n),
        PMA_ARRAY(pma_iterate, guess, n),
        PMA_ARRAY(pma_iterate, u, n),
        PMA_ARRAY(pma_iterate, v, n),
        PMA_ARRAY(pma_iterate, f, n),
        PMA_ARRAY(pma_iterate, force, n),
        PMA_ARRAY(pma_iterate, R, n),
        PMA_ARRAY(pma_iterate, dw, n),
        PMA_ARRAY(pma_iterate, size, n),
        PMA_ARRAY(pma_iterate, product, n),
        PMA_ARRAY(pma_iterate, forces, n),
        PMA_ARRAY(pma_iterate, limit, n),
        PMA_ARRAY(pma_iterate, rounding, n),
        PMA_ARRAY(pma_iterate, pull, p->nb),
        PMA_ARRAY(pma_iterate, pull_size, p->nb),
        PMA_ARRAY(pma_iterate, lam, 2 * p->link.p),
        PMA_ARRAY(pma_iterate, springs_n, pma_iterate_spring_numbers(it)),
        PMA_ARRAY(pma_iterate, slopes, total),
        PMA_ARRAY(pma_iterate, history_n, p->internal.history),
        PMA_ARRAY(pma_iterate, scratch, pma_internal_scratch(&p->internal)),
        PMA_ARRAY(pma_iterate, entries, it->parts.keeps ? entries : 0),
        PMA_ARRAY(pma_iterate, stiffness, p->internal.count > 0 ? entries : 0),
        PMA_ARRAY(pma_iterate, rows, p->link.p),
        PMA_ARRAY(pma_iterate, column, entries_of_link(&p->link)),
        PMA_ARRAY(pma_iterate, spring_entries, 4 * total),
        PMA_ARRAY(pma_iterate, diagonal, n),
        {0}};
    it->block = pma_object_fill(it, arrays);
    return it->block ? PMA_OK : PMA_NO_MEMORY;
}

static pma_status fill(pma_iterate *it)
{
    const pma_numeric_parts *tangent = &it->parts.tangent;
    PMA_TRY(pma_numeric_create(tangent, &it->numeric));
    PMA_TRY(allocate(it));
    find_rows(it);
    for (size_t i = 0; i < tangent->n; i++)
        it->diagonal[i] = (int64_t)pma_numeric_entry(tangent, i, i);
    PMA_TRY(find_spring_entries(it));
    const size_t many = pma_numeric_compliance_scratch(&it->numeric, it->count);
    it->many = pma_memory_allocate(many + 1, sizeof *it->many);
    return it->many ? PMA_OK : PMA_NO_MEMORY;
}

pma_status pma_iterate_create(pma_subdomain *s, const pma_iterate_parts *parts, pma_iterate **out)
{
    *out = NULL;
    PMA_TRY(check(&s->parts, parts));
    pma_iterate *it = pma_memory_allocate(1, sizeof *it);
    if (!it)
        return PMA_NO_MEMORY;
    it->of = s;
    it->parts = *parts;
    const pma_status status = fill(it);
    if (status == PMA_OK)
        *out = it;
    else
        pma_iterate_destroy(it);
    return status;
}

void pma_iterate_destroy(pma_iterate *it)
{
    if (!it)
        return;
    pma_numeric_destroy(&it->numeric);
    pma_memory_release(it->block);
    pma_memory_release(it->many);
    pma_memory_release(it);
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
    const size_t n = it->of->parts.n;
    size_t spoiled = 0;
    while (spoiled < n && isfinite(it->force[spoiled]))
        spoiled++;
    return (pma_iterate_failure){.t = it->step.t1,
                                 .iterations = it->corrections,
                                 .dof = it->singular,
                                 .spoiled = spoiled < n ? spoiled : SIZE_MAX};
}

pma_kept_iteration pma_iterate_kept(const pma_iterate *it)
{
    return (pma_kept_iteration){.scale = it->scale_present,
                                .entries =
                                    it->parts.keeps && it->factored_present ? it->entries : NULL,
                                .twice = it->factored_twice_present};
}

size_t pma_iterate_entries(const pma_iterate *it)
{
    return (size_t)it->parts.tangent.ptr[it->parts.tangent.n];
}

pma_status pma_iterate_restore(pma_iterate *it, pma_kept_iteration kept)
{
    it->scale = it->scale_present = kept.scale;
    it->factored = it->factored_present = kept.entries != NULL;
    it->factored_twice = it->factored_twice_present = kept.twice;
    it->refactored = it->overwritten = false;
    if (!kept.entries || !it->parts.keeps)
        return PMA_OK;
    size_t column;
    memmove(it->entries, kept.entries, pma_iterate_entries(it) * sizeof(double));
    memcpy(it->numeric.values, it->entries, pma_iterate_entries(it) * sizeof(double));
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
    if (it->refactored)
        pma_iterate_restore(it, pma_iterate_kept(it));
}
