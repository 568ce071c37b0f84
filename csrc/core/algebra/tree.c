#include "algebra/tree.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static size_t rows_of(const pma_tree *T, size_t node)
{
    return T->update[node + 1] - T->update[node];
}

static size_t columns_of(const pma_tree *T, size_t node)
{
    return T->column[node + 1] - T->column[node];
}

/* ---- making --------------------------------------------------------------------------------- */

/* What is known of the supernodes of the interior, `count` of them. */
typedef struct {
    const pma_panels *p;
    size_t interior, count; /* columns, supernodes */
    size_t *owner;          /* interior: supernode of each column */
    size_t *parent;         /* count: supernode, or `count` */
    size_t *low, *size;     /* count: first and number of the supernodes of its subtree */
    size_t *entries;        /* count: of the subtree */
    size_t *node;           /* count: that each is in */
    size_t *mark;           /* n: the node whose rows were seen last */
    size_t *block;
} survey;

static pma_status create_survey(const pma_panels *p, size_t n, size_t nb, survey *v)
{
    size_t count = 0;
    while (count < p->count && (size_t)p->first[count] < n - nb)
        count++;
    *v = (survey){.p = p, .interior = n - nb, .count = count};
    v->block = calloc(2 * n + 5 * count + 1, sizeof *v->block);
    if (!v->block)
        return PMA_NO_MEMORY;
    v->owner = v->block;
    v->mark = v->owner + n;
    v->parent = v->mark + n;
    v->low = v->parent + count;
    v->size = v->low + count;
    v->entries = v->size + count;
    v->node = v->entries + count;
    return PMA_OK;
}

static void survey_subtrees(const survey *v)
{
    const pma_panels *p = v->p;
    for (size_t s = 0; s < v->count; s++) {
        v->low[s] = s;
        for (size_t j = (size_t)p->first[s]; j < (size_t)p->first[s + 1]; j++)
            v->owner[j] = s;
    }
    for (size_t s = 0; s < v->count; s++) {
        const bool root =
            p->row_ptr[s] == p->row_ptr[s + 1] || (size_t)p->rows[p->row_ptr[s]] >= v->interior;
        v->parent[s] = root ? v->count : v->owner[p->rows[p->row_ptr[s]]];
        v->size[s]++;
        v->entries[s] += (size_t)(p->start[s + 1] - p->start[s]);
        if (root)
            continue;
        const size_t parent = v->parent[s];
        v->low[parent] = v->low[s] < v->low[parent] ? v->low[s] : v->low[parent];
        v->size[parent] += v->size[s];
        v->entries[parent] += v->entries[s];
    }
}

/* A subtree that can be a node: small, and without a gap. */
static bool is_whole(const survey *v, size_t s, size_t entries)
{
    return v->entries[s] <= entries && v->low[s] + v->size[s] == s + 1;
}

/* The last supernode of the largest such subtree that begins with s; s itself above them. */
static size_t last_of(const survey *v, size_t s, size_t entries)
{
    size_t last = s;
    while (is_whole(v, last, entries) && v->parent[last] < v->count &&
           v->low[v->parent[last]] == s && is_whole(v, v->parent[last], entries))
        last = v->parent[last];
    return last;
}

/* Nodes from the first columns on; siblings that are small enough together are one. Returns their
 * number, the first column of each in `column`. */
static size_t divide(const survey *v, size_t entries, size_t *column)
{
    size_t count = 0, have = 0, parent = v->count;
    for (size_t s = 0, last; s < v->count; s = last + 1) {
        last = last_of(v, s, entries);
        const size_t more = v->entries[last];
        const bool joins = count > 0 && is_whole(v, last, entries) && v->parent[last] == parent &&
                           have + more <= entries;
        if (!joins) {
            column[count++] = (size_t)v->p->first[s];
            have = 0;
        }
        have = is_whole(v, last, entries) ? have + more : entries + 1;
        parent = v->parent[last];
        for (size_t k = s; k <= last; k++)
            v->node[k] = count - 1;
    }
    column[count] = v->interior;
    return count;
}

static int ascending(const void *a, const void *b)
{
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

/* The rows of a node below its columns, in `row` if that is given; their number. */
static size_t list_rows(const survey *v, const pma_tree *T, size_t node, size_t begin, size_t end,
                        int32_t *row)
{
    const pma_panels *p = v->p;
    const size_t seen = 2 * node + (row ? 2 : 1); /* each node is listed twice */
    size_t count = 0;
    for (int64_t k = p->row_ptr[begin]; k < p->row_ptr[end]; k++) {
        const int32_t i = p->rows[k];
        if ((size_t)i < T->column[node + 1] || v->mark[i] == seen)
            continue;
        v->mark[i] = seen;
        if (row)
            row[count] = i;
        count++;
    }
    if (row)
        qsort(row, count, sizeof *row, ascending);
    return count;
}

/* The supernode after the last one of a node. */
static size_t end_of(const survey *v, size_t node, size_t begin)
{
    while (begin < v->count && v->node[begin] == node)
        begin++;
    return begin;
}

static void link_nodes(const survey *v, pma_tree *T)
{
    for (size_t t = 0; t <= T->count; t++)
        T->parent[t] = T->child[t] = T->sibling[t] = PMA_NO_NODE;
    for (size_t s = v->count; s-- > 0;) {
        const size_t t = v->node[s];
        if (T->parent[t] != PMA_NO_NODE)
            continue; /* its last supernode has a parent outside */
        T->parent[t] = v->parent[s] == v->count ? T->count : v->node[v->parent[s]];
        T->sibling[t] = T->child[T->parent[t]];
        T->child[T->parent[t]] = t;
    }
}

/* (columns or rows of the parent) PMA_BAD_INDEX when a row is neither */
static pma_status place_rows(pma_tree *T, size_t t)
{
    const size_t parent = T->parent[t], first = T->column[parent];
    const bool is_border = parent == T->count;
    const size_t columns = is_border ? 0 : columns_of(T, parent);
    size_t k = is_border ? 0 : T->update[parent];
    for (size_t i = T->update[t]; i < T->update[t + 1]; i++) {
        const size_t row = (size_t)T->row[i];
        if (row < first)
            return PMA_BAD_INDEX;
        if (is_border || row < first + columns) {
            T->into[i] = (int32_t)(row - first);
            continue;
        }
        while (k < T->update[parent + 1] && (size_t)T->row[k] < row)
            k++;
        if (k == T->update[parent + 1] || (size_t)T->row[k] != row)
            return PMA_BAD_INDEX;
        T->into[i] = (int32_t)(columns + k - T->update[parent]);
    }
    return PMA_OK;
}

/* Rows below a node are those of its front, which follow its columns. */
static void number_rows(const survey *v, pma_tree *T, size_t s)
{
    const pma_panels *p = v->p;
    const size_t t = v->node[s], end = T->column[t + 1];
    size_t k = T->update[t];
    for (int64_t i = p->row_ptr[s]; i < p->row_ptr[s + 1]; i++) {
        const int32_t row = p->rows[i];
        if ((size_t)row < end) {
            T->rows[i] = row;
            continue;
        }
        while (T->row[k] < row)
            k++;
        T->rows[i] = (int32_t)(end + k - T->update[t]);
    }
}

static pma_status fill(const survey *v, pma_tree *T)
{
    size_t begin = 0;
    pma_status status = PMA_OK;
    link_nodes(v, T);
    for (size_t t = 0; t < T->count; t++) {
        const size_t end = end_of(v, t, begin), rows = columns_of(T, t) + rows_of(T, t);
        list_rows(v, T, t, begin, end, T->row + T->update[t]);
        T->most_rows = rows > T->most_rows ? rows : T->most_rows;
        begin = end;
    }
    for (size_t t = 0; t < T->count && status == PMA_OK; t++)
        status = place_rows(T, t);
    for (size_t s = 0; s < v->count && status == PMA_OK; s++)
        number_rows(v, T, s);
    return status;
}

/* In one block: T, the numbers of each node, the rows. */
static pma_tree *allocate(const survey *v, size_t count, const size_t *column)
{
    const size_t numbers = 5 * (count + 1);
    pma_tree *T = calloc(1, sizeof *T);
    size_t *block = calloc(numbers, sizeof *block);
    if (!T || !block) {
        free(T);
        free(block);
        return NULL;
    }
    T->count = count;
    T->column = block;
    T->parent = T->column + count + 1;
    T->child = T->parent + count + 1;
    T->sibling = T->child + count + 1;
    T->update = T->sibling + count + 1;
    memcpy(T->column, column, (count + 1) * sizeof *column);
    size_t begin = 0;
    for (size_t t = 0; t < count; t++) {
        const size_t end = end_of(v, t, begin);
        T->update[t + 1] = T->update[t] + list_rows(v, T, t, begin, end, NULL);
        begin = end;
    }
    const size_t rows = (size_t)v->p->row_ptr[v->count];
    T->row = calloc(2 * T->update[count] + rows + 1, sizeof *T->row);
    if (!T->row) {
        pma_tree_destroy(T);
        return NULL;
    }
    T->into = T->row + T->update[count];
    T->rows = T->into + T->update[count];
    T->height = pma_panels_most_height(v->p);
    return T;
}

pma_status pma_tree_create(const pma_panels *p, size_t n, size_t nb, size_t entries, pma_tree **out)
{
    survey v;
    *out = NULL;
    pma_status status = create_survey(p, n, nb, &v);
    if (status != PMA_OK)
        return status;
    size_t *column = calloc(v.count + 1, sizeof *column);
    if (!column) {
        free(v.block);
        return PMA_NO_MEMORY;
    }
    survey_subtrees(&v);
    const size_t count = divide(&v, entries, column);
    if (count > 1) {
        *out = allocate(&v, count, column);
        status = *out ? fill(&v, *out) : PMA_NO_MEMORY;
    }
    free(column);
    free(v.block);
    if (status != PMA_OK) {
        pma_tree_destroy(*out);
        *out = NULL;
    }
    return status;
}

void pma_tree_destroy(pma_tree *T)
{
    if (!T)
        return;
    free(T->column);
    free(T->row);
    free(T);
}

/* ---- sweeps --------------------------------------------------------------------------------- */

size_t pma_tree_front(const pma_tree *T)
{
    return T->height + T->most_rows;
}

size_t pma_tree_updates(const pma_tree *T)
{
    return T->update[T->count];
}

static void add_updates(const pma_tree *T, size_t node, size_t lanes, const double *updates,
                        double *x)
{
    for (size_t c = T->child[node]; c != PMA_NO_NODE; c = T->sibling[c]) {
        for (size_t i = T->update[c]; i < T->update[c + 1]; i++) {
            double *to = x + (size_t)T->into[i] * lanes;
            for (size_t l = 0; l < lanes; l++)
                to[l] += updates[i * lanes + l];
        }
    }
}

void pma_tree_eliminate(const pma_tree *T, const pma_panels *p, size_t node, size_t lanes,
                        double *x, double *front, double *updates)
{
    const size_t begin = T->column[node], columns = columns_of(T, node), rows = rows_of(T, node);
    const size_t own = columns * lanes * sizeof *x, below = rows * lanes * sizeof *x;
    pma_panels numbered = *p;
    double *work = front + T->most_rows * lanes;
    numbered.rows = T->rows;
    memcpy(front, x + begin * lanes, own);
    memset(front + columns * lanes, 0, below);
    add_updates(T, node, lanes, updates, front);
    pma_panels_eliminate(&numbered, lanes, begin, begin + columns, front, work);
    memcpy(x + begin * lanes, front, own);
    memcpy(updates + T->update[node] * lanes, front + columns * lanes, below);
}

void pma_tree_substitute(const pma_tree *T, const pma_panels *p, const double *inverse, size_t node,
                         size_t lanes, double *x, double *front)
{
    const size_t begin = T->column[node], columns = columns_of(T, node), rows = rows_of(T, node);
    const size_t own = columns * lanes * sizeof *x;
    const int32_t *row = T->row + T->update[node];
    pma_panels numbered = *p;
    double *work = front + T->most_rows * lanes, *below = front + columns * lanes;
    numbered.rows = T->rows;
    memcpy(front, x + begin * lanes, own);
    for (size_t i = 0; i < rows; i++) {
        for (size_t l = 0; l < lanes; l++)
            below[i * lanes + l] = x[(size_t)row[i] * lanes + l];
    }
    pma_panels_substitute(&numbered, inverse, lanes, begin, begin + columns, front, work);
    memcpy(x + begin * lanes, front, own);
}

void pma_tree_add_to_border(const pma_tree *T, size_t lanes, const double *updates, double *x)
{
    add_updates(T, T->count, lanes, updates, x + T->column[T->count] * lanes);
}
