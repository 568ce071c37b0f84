#include "algebra/agenda.h"

#include <stdlib.h>

/* Tasks for each worker that a factor is divided into, about. */
enum { TASKS = 32 };

/* ---- updates -------------------------------------------------------------------------------- */

/* The end of the rows of supernode d, from `row` on, that are columns of the same supernode. */
static size_t end_of_update(const pma_panels *p, size_t d, size_t row, const int64_t *owner,
                            size_t *target)
{
    const int32_t *rows = p->rows + p->row_ptr[d];
    *target = (size_t)owner[rows[row]];
    while (row < pma_panels_rows(p, d) && rows[row] < p->first[*target + 1])
        row++;
    return row;
}

static pma_status list_updates(const pma_panels *p, const int64_t *owner, pma_agenda *a)
{
    size_t target;
    a->update = calloc(p->count + 2, sizeof *a->update);
    if (!a->update)
        return PMA_NO_MEMORY;
    size_t *next = a->update + 1;
    for (size_t d = 0; d < p->count; d++) {
        for (size_t row = 0; row < pma_panels_rows(p, d); next[target + 1]++)
            row = end_of_update(p, d, row, owner, &target);
    }
    for (size_t s = 0; s < p->count; s++)
        next[s + 1] += next[s];
    const size_t count = next[p->count];
    a->source = calloc(2 * count + 1, sizeof *a->source);
    if (!a->source)
        return PMA_NO_MEMORY;
    a->row = a->source + count;
    /* `next` moves on to where the updates of the next supernode begin */
    for (size_t d = 0; d < p->count; d++) {
        for (size_t row = 0, end; row < pma_panels_rows(p, d); row = end) {
            end = end_of_update(p, d, row, owner, &target);
            a->source[next[target]] = d;
            a->row[next[target]++] = row;
        }
    }
    return PMA_OK;
}

/* ---- tasks ---------------------------------------------------------------------------------- */

typedef struct {
    size_t first, last;
    double rest; /* multiplications on the longest way to the root, with its own */
} task;

/* What is known of supernodes. */
typedef struct {
    const pma_panels *p;
    const int64_t *owner;
    double *cost;  /* multiplications of what updates it and of its panel */
    double *below; /* those of the subtree */
    size_t *low;   /* the first supernode of the subtree */
    size_t *task;  /* that has it */
} survey;

static size_t parent_of(const survey *v, size_t s)
{
    const pma_panels *p = v->p;
    return pma_panels_rows(p, s) > 0 ? (size_t)v->owner[p->rows[p->row_ptr[s]]] : p->count;
}

static double update_cost(const pma_panels *p, const pma_agenda *a, size_t k, size_t s)
{
    const size_t d = a->source[k];
    const int32_t *rows = p->rows + p->row_ptr[d];
    size_t end = a->row[k];
    while (end < pma_panels_rows(p, d) && rows[end] < p->first[s + 1])
        end++;
    return (double)(end - a->row[k]) * (double)(pma_panels_rows(p, d) - a->row[k]) *
           (double)pma_panels_width(p, d);
}

/* Returns the cost of all. */
static double add_up(const survey *v, const pma_agenda *a)
{
    const pma_panels *p = v->p;
    double total = 0.0;
    for (size_t s = 0; s < p->count; s++)
        v->low[s] = s;
    for (size_t s = 0; s < p->count; s++) {
        const double width = (double)pma_panels_width(p, s);
        v->cost[s] = width * width * (double)pma_panels_height(p, s);
        for (size_t k = a->update[s]; k < a->update[s + 1]; k++)
            v->cost[s] += update_cost(p, a, k, s);
        v->below[s] += v->cost[s];
        total += v->cost[s];
        const size_t parent = parent_of(v, s);
        if (parent == p->count)
            continue;
        v->below[parent] += v->below[s];
        v->low[parent] = v->low[s] < v->low[parent] ? v->low[s] : v->low[parent];
    }
    return total;
}

/* Ascending ranges: the largest subtree of at most this cost that begins with a supernode, or it
 * alone. Some orders have other supernodes in the range of a subtree, which does no harm. */
static size_t cut(const survey *v, double most, task *list)
{
    size_t count = 0;
    for (size_t s = 0; s < v->p->count; s = list[count++].last + 1) {
        size_t last = s, above;
        while ((above = parent_of(v, last)) < v->p->count && v->low[above] == s &&
               v->below[above] <= most)
            last = above;
        list[count] = (task){.first = s, .last = last};
        for (size_t k = s; k <= last; k++)
            v->task[k] = count;
    }
    return count;
}

/* From the root on: a task ends before what it updates, which is further on. */
static void find_rests(const survey *v, const pma_agenda *a, size_t count, task *list)
{
    for (size_t t = count; t-- > 0;) {
        for (size_t s = list[t].first; s <= list[t].last; s++)
            list[t].rest += v->cost[s];
        for (size_t s = list[t].first; s <= list[t].last; s++) {
            for (size_t k = a->update[s]; k < a->update[s + 1]; k++) {
                task *before = &list[v->task[a->source[k]]];
                if (before != &list[t] && before->rest < list[t].rest)
                    before->rest = list[t].rest;
            }
        }
    }
}

static int most_first(const void *a, const void *b)
{
    const task *x = a, *y = b;
    if (x->rest != y->rest)
        return x->rest < y->rest ? 1 : -1;
    return (x->first > y->first) - (x->first < y->first);
}

static void write_down(const pma_panels *p, size_t count, const task *list, pma_agenda *a)
{
    a->tasks = count;
    a->last = a->first + p->count;
    for (size_t t = 0; t < count; t++) {
        a->first[t] = list[t].first;
        a->last[t] = list[t].last;
    }
}

static pma_status list_tasks(const pma_panels *p, const int64_t *owner, size_t workers,
                             pma_agenda *a)
{
    survey v = {.p = p, .owner = owner};
    v.cost = calloc(2 * p->count + 1, sizeof *v.cost);
    v.low = calloc(2 * p->count + 1, sizeof *v.low);
    task *list = calloc(p->count + 1, sizeof *list);
    a->first = calloc(2 * p->count + 1, sizeof *a->first);
    const bool have = v.cost && v.low && list && a->first;
    if (have) {
        v.below = v.cost + p->count;
        v.task = v.low + p->count;
        const double total = add_up(&v, a);
        const double most = workers == 1 ? 2.0 * total : total / (double)(TASKS * workers);
        const size_t count = cut(&v, most, list);
        find_rests(&v, a, count, list);
        qsort(list, count, sizeof *list, most_first);
        write_down(p, count, list, a);
    }
    free(v.cost);
    free(v.low);
    free(list);
    return have ? PMA_OK : PMA_NO_MEMORY;
}

pma_status pma_agenda_create(const pma_panels *p, const int64_t *owner, size_t workers,
                             pma_agenda *out)
{
    *out = (pma_agenda){.tasks = 0};
    pma_status status = list_updates(p, owner, out);
    if (status == PMA_OK)
        status = list_tasks(p, owner, workers, out);
    if (status != PMA_OK)
        pma_agenda_destroy(out);
    return status;
}

void pma_agenda_destroy(pma_agenda *a)
{
    free(a->update);
    free(a->source);
    free(a->first);
    *a = (pma_agenda){.tasks = 0};
}
