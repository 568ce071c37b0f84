#include "factor/symbolic.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/lists.h"
#include "memory.h"
#include "object.h"

/* ---- the graph of groups -------------------------------------------------------------------- */

/* Unknowns group by group. */
static void gather(size_t n, size_t groups, const int32_t *group, int64_t *start, int32_t *members)
{
    memset(start, 0, (groups + 1) * sizeof *start);
    for (size_t i = 0; i < n; i++)
        start[group[i] + 1]++;
    for (size_t g = 0; g < groups; g++)
        start[g + 1] += start[g];
    for (size_t i = n; i-- > 0;) /* start[g + 1] goes down to the beginning of g */
        members[--start[group[i] + 1]] = (int32_t)i;
    memmove(start, start + 1, groups * sizeof *start);
    start[groups] = (int64_t)n;
}

void pma_symbolic_merge(size_t n, const int64_t *ptr, const int32_t *index, size_t groups,
                        const int32_t *group, int64_t *start, int32_t *members, int64_t *mark,
                        int64_t *list_ptr, int32_t *list)
{
    int64_t count = 0;
    gather(n, groups, group, start, members);
    for (size_t g = 0; g < groups; g++)
        mark[g] = -1;
    for (size_t g = 0; g < groups; g++) {
        const int64_t own = (int64_t)g;
        list_ptr[g] = count;
        mark[g] = own;
        for (int64_t m = start[g]; m < start[g + 1]; m++) {
            for (int64_t k = ptr[members[m]]; k < ptr[members[m] + 1]; k++) {
                const int32_t other = group[index[k]];
                if (mark[other] == own)
                    continue;
                mark[other] = own;
                list[count++] = other;
            }
        }
    }
    list_ptr[groups] = count;
}

void pma_symbolic_transpose(size_t n, const int64_t *ptr, const int32_t *index, int64_t *out_ptr,
                            int32_t *out)
{
    memset(out_ptr, 0, (n + 1) * sizeof *out_ptr);
    for (int64_t k = 0; k < ptr[n]; k++)
        out_ptr[index[k] + 1]++;
    for (size_t j = 0; j < n; j++)
        out_ptr[j + 1] += out_ptr[j];
    for (size_t i = n; i-- > 0;) { /* out_ptr[j + 1] goes down to the beginning of j */
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++)
            out[--out_ptr[index[k] + 1]] = (int32_t)i;
    }
    memmove(out_ptr, out_ptr + 1, n * sizeof *out_ptr);
    out_ptr[n] = ptr[n];
}

void pma_symbolic_unite(size_t n, const int64_t *a_ptr, const int32_t *a, const int64_t *b_ptr,
                        const int32_t *b, int64_t *ptr, int32_t *index)
{
    int64_t count = 0;
    for (size_t i = 0; i < n; i++) {
        int64_t j = a_ptr[i], k = b_ptr[i];
        ptr[i] = count;
        while (j < a_ptr[i + 1] || k < b_ptr[i + 1]) {
            const int32_t from_a = j < a_ptr[i + 1] ? a[j] : INT32_MAX;
            const int32_t from_b = k < b_ptr[i + 1] ? b[k] : INT32_MAX;
            if (index)
                index[count] = from_a < from_b ? from_a : from_b;
            count++;
            j += from_a <= from_b;
            k += from_b <= from_a;
        }
    }
    ptr[n] = count;
}

/* ---- the elimination tree ------------------------------------------------------------------- */

/* Going up from the entries of row i leads to i. `ancestor` skips what was walked before. */
static void find_parents(size_t n, const int64_t *ptr, const int32_t *index, int64_t *parent,
                         int64_t *ancestor)
{
    for (size_t i = 0; i < n; i++) {
        const int64_t row = (int64_t)i;
        parent[i] = ancestor[i] = -1;
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++) {
            for (int64_t j = index[k], above; j >= 0 && j < row; j = above) {
                above = ancestor[j];
                ancestor[j] = row;
                if (above < 0)
                    parent[j] = row;
            }
        }
    }
}

/* ---- postorder ------------------------------------------------------------------------------ */

/* Every column, except on the path to the next unnumbered leaf, has its children numbered: go
 * down to the first child, number on the way up. `child` and `next` are lists of the forest. */
static size_t number_subtree(int64_t root, int64_t *child, const int64_t *next, size_t placed,
                             const int64_t *parent, int64_t *order)
{
    int64_t j = root;
    for (;;) {
        while (child[j] >= 0) {
            const int64_t down = child[j];
            child[j] = next[down];
            j = down;
        }
        order[placed++] = j;
        if (j == root)
            return placed;
        j = parent[j];
    }
}

static void push(int64_t j, const int64_t *parent, int64_t *child, int64_t *next)
{
    next[j] = child[parent[j]];
    child[parent[j]] = j;
}

/* Children of each interior column in lists; the longest is pushed first and so comes last. */
static void list_children(size_t interior, const int64_t *parent, const int64_t *count,
                          int64_t *child, int64_t *next, int64_t *longest)
{
    for (size_t j = 0; j < interior; j++) {
        const int64_t p = parent[j];
        if (p >= 0 && (longest[p] < 0 || count[j] >= count[longest[p]]))
            longest[p] = (int64_t)j;
    }
    for (size_t p = 0; p < interior; p++) {
        if (longest[p] >= 0)
            push(longest[p], parent, child, next);
    }
    for (size_t j = interior; j-- > 0;) {
        if (parent[j] >= 0 && longest[parent[j]] != (int64_t)j)
            push((int64_t)j, parent, child, next);
    }
}

void pma_symbolic_postorder(size_t n, size_t nb, const int64_t *parent, const int64_t *count,
                            int64_t *scratch, int64_t *order)
{
    const size_t interior = n - nb;
    int64_t *child = scratch, *next = scratch + n;
    size_t placed = 0;
    for (size_t j = 0; j < n; j++)
        child[j] = order[j] = -1;
    list_children(interior, parent, count, child, next, order);
    /* the trees of the interior end where a parent is an interface dof, or where there is none;
     * `order` has served its other purpose */
    for (size_t j = 0; j < interior; j++) {
        if (parent[j] < 0 || (size_t)parent[j] >= interior)
            placed = number_subtree((int64_t)j, child, next, placed, parent, order);
    }
    for (size_t j = interior; j < n; j++)
        order[j] = (int64_t)j;
}

/* ---- the length of the columns (Gilbert, Ng, Peyton 1994) ------------------------------------ */

/* The whole forest, in a postorder in which siblings ascend. */
static void number_forest(size_t n, const int64_t *parent, int64_t *child, int64_t *next,
                          int64_t *order)
{
    size_t placed = 0;
    for (size_t j = 0; j < n; j++)
        child[j] = -1;
    for (size_t j = n; j-- > 0;) {
        if (parent[j] >= 0)
            push((int64_t)j, parent, child, next);
    }
    for (size_t j = 0; j < n; j++) {
        if (parent[j] < 0)
            placed = number_subtree((int64_t)j, child, next, placed, parent, order);
    }
}

/* Row i of R has entries in the columns of a subtree, whose leaves are among those of row i of the
 * matrix. Columns come in postorder; of row i there are so far: */
typedef struct {
    int64_t *leaf;     /* n: the last leaf, or -1 */
    int64_t *first;    /* n: of each column, the place of its first descendant in the postorder */
    int64_t *ancestor; /* n: of each column, one that is above it, as far as columns came */
} row_subtrees;

/* Column j has an entry in row i of the matrix: one more in R if it is a leaf, less what is common
 * to the paths from it and from the leaf before, which begins at their lowest common ancestor. */
static void count_leaf(const row_subtrees *t, int64_t i, int64_t j, int64_t *count)
{
    const int64_t before = t->leaf[i];
    if (before >= 0 && t->first[before] >= t->first[j])
        return; /* it is above the leaf before */
    t->leaf[i] = j;
    count[j]++;
    if (before < 0)
        return;
    int64_t common = before, above;
    while (common != t->ancestor[common])
        common = t->ancestor[common];
    for (int64_t k = before; k != common; k = above) {
        above = t->ancestor[k];
        t->ancestor[k] = common;
    }
    count[common]--;
}

/* count (n) := what is left when the entries of each column are taken from those of its parent */
static void count_differences(size_t n, const int64_t *ptr, const int32_t *index,
                              const int64_t *parent, const int64_t *order, const row_subtrees *t,
                              int64_t *count)
{
    for (size_t j = 0; j < n; j++)
        t->first[j] = t->leaf[j] = -1;
    for (size_t k = 0; k < n; k++) {
        const int64_t j = order[k];
        count[j] = t->first[j] < 0; /* the diagonal; of another column it is counted below it */
        for (int64_t i = j; i >= 0 && t->first[i] < 0; i = parent[i])
            t->first[i] = (int64_t)k;
        t->ancestor[j] = j;
    }
    for (size_t k = 0; k < n; k++) {
        const int64_t j = order[k];
        for (int64_t l = ptr[j]; l < ptr[j + 1]; l++) {
            if (index[l] > j)
                count_leaf(t, index[l], j, count);
        }
        if (parent[j] < 0)
            continue;
        count[parent[j]]--; /* the diagonal of j is not in its parent */
        t->ancestor[j] = parent[j];
    }
}

void pma_symbolic_count(size_t n, const int64_t *ptr, const int32_t *index, int64_t *parent,
                        int64_t *scratch, int64_t *count)
{
    int64_t *order = scratch;
    const row_subtrees t = {
        .leaf = scratch + n, .first = scratch + 2 * n, .ancestor = scratch + 3 * n};
    find_parents(n, ptr, index, parent, t.ancestor);
    number_forest(n, parent, t.leaf, t.first, order);
    count_differences(n, ptr, index, parent, order, &t, count);
    for (size_t j = 0; j < n; j++) {
        if (parent[j] >= 0)
            count[parent[j]] += count[j];
        const int64_t most = (int64_t)(n - j);
        count[j] = (count[j] < 1 ? 1 : count[j] > most ? most : count[j]) - 1;
    }
}

/* ---- supernodes ----------------------------------------------------------------------------- */

/* Entries of a panel with this width and this many rows below. */
static int64_t panel_entries(int64_t width, int64_t below)
{
    return width * (width + 1) / 2 + width * below;
}

/* Are this many zeros in a panel cheaper than the indices they save? */
static bool worth_joining(int64_t width, int64_t zeros, int64_t entries)
{
    if (width > PMA_WIDEST)
        return false;
    if (zeros == 0 || width <= 4)
        return true;
    const double share = (double)zeros / (double)entries;
    return (width <= 16 && share < 0.6) || (width <= 48 && share < 0.1) || share < 0.05;
}

/* Columns are taken one by one; the supernode that ends just before may join the new one, and so
 * on down. Its pattern below is part of the pattern of the column it is an update to. */
size_t pma_symbolic_supernodes(size_t n, size_t nb, const int64_t *parent, const int64_t *count,
                               int64_t *zeros, int64_t *first)
{
    size_t s = 0;
    for (size_t j = 0; j < n; j++) {
        int64_t begin = (int64_t)j, own_zeros = 0;
        while (s > 0 && parent[begin - 1] >= begin && parent[begin - 1] <= (int64_t)j &&
               begin != (int64_t)(n - nb)) {
            const int64_t before = begin - first[s - 1], width = (int64_t)j + 1 - first[s - 1];
            const int64_t entries = panel_entries(width, count[j]);
            const int64_t both = panel_entries(before, count[begin - 1]) +
                                 panel_entries((int64_t)j + 1 - begin, count[j]);
            const int64_t all_zeros = entries - both + zeros[s - 1] + own_zeros;
            if (!worth_joining(width, all_zeros, entries))
                break;
            own_zeros = all_zeros;
            begin = first[--s];
        }
        first[s] = begin;
        zeros[s] = own_zeros;
        s++;
    }
    first[s] = (int64_t)n;
    return s;
}

void pma_symbolic_lay_out(size_t supernodes, const int64_t *first, const int64_t *count,
                          int64_t *row_ptr, int64_t *start)
{
    row_ptr[0] = start[0] = 0;
    for (size_t s = 0; s < supernodes; s++) {
        const int64_t width = first[s + 1] - first[s], below = count[first[s + 1] - 1];
        row_ptr[s + 1] = row_ptr[s] + below;
        start[s + 1] = start[s] + width * (width + below);
    }
}

/* The rows of one supernode as they are found: `have` of at most `room`. */
typedef struct {
    int32_t *rows;
    int64_t have, room, last, s;
    int64_t *mark;
} found;

/* Adds what of a list lies beyond column `last` and is not marked yet; false when it is full. */
static bool add_rows(found *f, const int32_t *list, int64_t length)
{
    for (int64_t k = 0; k < length; k++) {
        if (list[k] <= f->last || f->mark[list[k]] == f->s)
            continue;
        if (f->have == f->room)
            return false;
        f->mark[list[k]] = f->s;
        f->rows[f->have++] = list[k];
    }
    return true;
}

pma_status pma_symbolic_rows(size_t n, const int64_t *ptr, const int32_t *index, size_t supernodes,
                             const int64_t *first, const int64_t *row_ptr, int64_t *owner,
                             int64_t *mark, int64_t *child, int64_t *next, int32_t *rows)
{
    for (size_t j = 0; j < n; j++)
        mark[j] = -1;
    for (size_t s = 0; s < supernodes; s++) {
        child[s] = -1;
        for (int64_t j = first[s]; j < first[s + 1]; j++)
            owner[j] = (int64_t)s;
    }
    for (size_t s = 0; s < supernodes; s++) {
        const int64_t last = first[s + 1] - 1;
        found f = {.rows = rows + row_ptr[s],
                   .room = row_ptr[s + 1] - row_ptr[s],
                   .last = last,
                   .s = (int64_t)s,
                   .mark = mark};
        bool fits = add_rows(&f, index + ptr[first[s]], ptr[last + 1] - ptr[first[s]]);
        for (int64_t c = child[s]; c >= 0 && fits; c = next[c])
            fits = add_rows(&f, rows + row_ptr[c], row_ptr[c + 1] - row_ptr[c]);
        if (!fits || f.have < f.room)
            return PMA_BAD_INDEX;
        qsort(f.rows, (size_t)f.have, sizeof *f.rows, pma_ascending);
        if (f.have > 0) { /* this supernode is an update to the one that owns its first row */
            next[s] = child[owner[f.rows[0]]];
            child[owner[f.rows[0]]] = (int64_t)s;
        }
    }
    return PMA_OK;
}

/* ---- what is to be done for a factor --------------------------------------------------------- */

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
    a->update = pma_memory_allocate(p->count + 2, sizeof *a->update);
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
    a->source = pma_memory_allocate(2 * count + 1, sizeof *a->source);
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
    task *list;    /* tasks */
} survey;

static size_t parent_of(const survey *v, size_t s)
{
    const pma_panels *p = v->p;
    return pma_panels_rows(p, s) > 0 ? (size_t)v->owner[p->rows[p->row_ptr[s]]] : p->count;
}

static double update_cost(const survey *v, const pma_agenda *a, size_t k)
{
    const pma_panels *p = v->p;
    const size_t d = a->source[k], row = a->row[k];
    size_t target;
    const size_t end = end_of_update(p, d, row, v->owner, &target);
    return (double)(end - row) * (double)(pma_panels_rows(p, d) - row) *
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
            v->cost[s] += update_cost(v, a, k);
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

static pma_status list_tasks(const pma_panels *p, const int64_t *owner, size_t workers,
                             pma_agenda *a)
{
    const pma_array arrays[] = {
        PMA_ARRAY(survey, cost, p->count), PMA_ARRAY(survey, below, p->count),
        PMA_ARRAY(survey, low, p->count),  PMA_ARRAY(survey, task, p->count),
        PMA_ARRAY(survey, list, p->count), {0}};
    survey *v = pma_object_create(sizeof *v, arrays);
    a->first = pma_memory_allocate(2 * p->count + 1, sizeof *a->first);
    if (!v || !a->first) {
        pma_memory_release(v);
        return PMA_NO_MEMORY;
    }
    v->p = p;
    v->owner = owner;
    const double total = add_up(v, a);
    a->tasks = cut(v, workers == 1 ? 2.0 * total : total / (double)(TASKS * workers), v->list);
    find_rests(v, a, a->tasks, v->list);
    qsort(v->list, a->tasks, sizeof *v->list, most_first);
    a->last = a->first + p->count;
    for (size_t t = 0; t < a->tasks; t++) {
        a->first[t] = v->list[t].first;
        a->last[t] = v->list[t].last;
    }
    pma_memory_release(v);
    return PMA_OK;
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
    pma_memory_release(a->update);
    pma_memory_release(a->source);
    pma_memory_release(a->first);
    *a = (pma_agenda){.tasks = 0};
}
