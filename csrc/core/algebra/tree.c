#include "algebra/tree.h"

#include <assert.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/lists.h"
#include "object.h"

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
    size_t n, interior, count; /* unknowns, columns, supernodes */
    size_t *owner;             /* interior: supernode of each column */
    size_t *parent;            /* count: supernode, or `count` */
    size_t *low;               /* count: the first supernode of the subtree */
    size_t *entries;           /* count: of the subtree */
    size_t *open;              /* count: supernodes that have no parent yet, ascending */
    size_t *node;              /* count: that each is in */
    size_t *mark;              /* n: 1 + the node whose rows were listed last */
    size_t *column;            /* count+1: where each node begins */
} survey;

static survey *create_survey(const pma_panels *p, size_t n, size_t nb)
{
    size_t count = 0;
    while (count < p->count && (size_t)p->first[count] < n - nb)
        count++;
    const pma_array arrays[] = {PMA_ARRAY(survey, owner, n),
                                PMA_ARRAY(survey, parent, count),
                                PMA_ARRAY(survey, low, count),
                                PMA_ARRAY(survey, entries, count),
                                PMA_ARRAY(survey, open, count),
                                PMA_ARRAY(survey, node, count),
                                PMA_ARRAY(survey, mark, n),
                                PMA_ARRAY(survey, column, count + 1),
                                {0}};
    survey *v = pma_object_create(sizeof *v, arrays);
    if (!v)
        return NULL;
    v->p = p;
    v->n = n;
    v->interior = n - nb;
    v->count = count;
    return v;
}

/* The supernodes that have the rows of s are above it. */
static void lower_above(const survey *v, size_t s)
{
    const pma_panels *p = v->p;
    for (int64_t k = p->row_ptr[s]; k < p->row_ptr[s + 1]; k++) {
        if ((size_t)p->rows[k] >= v->interior)
            return;
        size_t *low = &v->low[v->owner[p->rows[k]]];
        *low = v->low[s] < *low ? v->low[s] : *low;
    }
}

/* Every subtree without a gap: what lies between its supernodes and belongs further up is taken as
 * part of it, for orders are postorders of mesh nodes, not quite of unknowns. */
static void find_parents(const survey *v)
{
    const pma_panels *p = v->p;
    size_t open = 0;
    for (size_t s = 0; s < v->count; s++) {
        v->low[s] = s;
        for (size_t j = (size_t)p->first[s]; j < (size_t)p->first[s + 1]; j++)
            v->owner[j] = s;
    }
    for (size_t s = 0; s < v->count; s++) {
        v->entries[s] = (size_t)(p->start[s + 1] - p->start[s]);
        while (open > 0 && v->open[open - 1] >= v->low[s]) {
            const size_t child = v->open[--open];
            v->parent[child] = s;
            v->low[s] = v->low[child] < v->low[s] ? v->low[child] : v->low[s];
            v->entries[s] += v->entries[child];
        }
        lower_above(v, s);
        v->open[open++] = s;
    }
    while (open > 0)
        v->parent[v->open[--open]] = v->count;
}

/* The last supernode of the largest subtree of at most some entries that begins with s; s itself if
 * there is none. */
static size_t last_of(const survey *v, size_t s, size_t entries)
{
    size_t last = s;
    while (v->parent[last] < v->count && v->low[v->parent[last]] == s &&
           v->entries[v->parent[last]] <= entries)
        last = v->parent[last];
    return last;
}

/* Is what begins with supernode s to be in the node before it, which ends with s - 1? Siblings that
 * are whole are, and above whole subtrees a parent and its last child. */
static bool joins(const survey *v, size_t s, size_t last, bool whole, bool was_whole)
{
    if (whole)
        return was_whole && v->parent[s - 1] == v->parent[last];
    return !was_whole && v->parent[s - 1] == s;
}

/* Nodes of at most some entries, or of one supernode, from the first columns on. Returns their
 * number, the first column of each in `column`. */
static size_t divide(const survey *v, size_t entries, size_t *column)
{
    size_t count = 0, have = 0;
    bool was_whole = false;
    for (size_t s = 0, last; s < v->count; s = last + 1) {
        const bool whole = v->entries[s] <= entries;
        last = last_of(v, s, entries);
        const size_t more =
            whole ? v->entries[last] : (size_t)(v->p->start[s + 1] - v->p->start[s]);
        if (s == 0 || have + more > entries || !joins(v, s, last, whole, was_whole)) {
            column[count++] = (size_t)v->p->first[s];
            have = 0;
        }
        have += more;
        was_whole = whole;
        for (size_t k = s; k <= last; k++)
            v->node[k] = count - 1;
    }
    column[count] = v->interior;
    return count;
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

/* Rows that are listed once each. */
typedef struct {
    int32_t *row;
    size_t count, room;
} list;

static bool append(const survey *v, const pma_tree *T, size_t node, const int32_t *row,
                   size_t count, list *l)
{
    for (size_t k = 0; k < count; k++) {
        if ((size_t)row[k] < T->column[node + 1] || v->mark[row[k]] == node + 1)
            continue;
        if (l->count == l->room) {
            int32_t *more = realloc(l->row, (2 * l->room + v->n) * sizeof *more);
            if (!more)
                return false;
            l->row = more;
            l->room = 2 * l->room + v->n;
        }
        v->mark[row[k]] = node + 1;
        l->row[l->count++] = row[k];
    }
    return true;
}

/* The rows below the columns of a node, of its supernodes and of its children. */
static bool list_rows(const survey *v, pma_tree *T, size_t node, size_t begin, size_t end, list *l)
{
    const pma_panels *p = v->p;
    const size_t before = l->count;
    bool done = append(v, T, node, p->rows + p->row_ptr[begin],
                       (size_t)(p->row_ptr[end] - p->row_ptr[begin]), l);
    for (size_t c = T->child[node]; c != PMA_NO_NODE && done; c = T->sibling[c]) {
        for (size_t i = T->update[c]; i < T->update[c + 1] && done; i++) {
            const int32_t row = l->row[i]; /* the list may move */
            done = append(v, T, node, &row, 1, l);
        }
    }
    if (done && l->count > before)
        qsort(l->row + before, l->count - before, sizeof *l->row, pma_ascending);
    T->update[node + 1] = l->count;
    return done;
}

static bool list_all(const survey *v, pma_tree *T, list *l)
{
    bool done = true;
    for (size_t t = 0, begin = 0, end; t < T->count && done; t++, begin = end) {
        for (end = begin; end < v->count && v->node[end] == t; end++) {
        }
        done = list_rows(v, T, t, begin, end, l);
        const size_t front = columns_of(T, t) + rows_of(T, t);
        T->most_rows = front > T->most_rows ? front : T->most_rows;
    }
    return done;
}

/* Each is a column of the parent or one of its rows. */
static void place_rows(pma_tree *T, size_t t)
{
    const size_t parent = T->parent[t], first = T->column[parent];
    const size_t columns = parent == T->count ? SIZE_MAX : columns_of(T, parent);
    size_t k = parent == T->count ? 0 : T->update[parent];
    for (size_t i = T->update[t]; i < T->update[t + 1]; i++) {
        const size_t position = (size_t)T->row[i] - first;
        if (position < columns) {
            T->into[i] = (int32_t)position;
            continue;
        }
        while (T->row[k] < T->row[i])
            k++;
        assert(k < T->update[parent + 1] && T->row[k] == T->row[i]);
        T->into[i] = (int32_t)(columns + k - T->update[parent]);
    }
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

static pma_tree *allocate(size_t count, const size_t *column)
{
    const pma_array arrays[] = {PMA_ARRAY(pma_tree, column, count + 1),
                                PMA_ARRAY(pma_tree, parent, count + 1),
                                PMA_ARRAY(pma_tree, child, count + 1),
                                PMA_ARRAY(pma_tree, sibling, count + 1),
                                PMA_ARRAY(pma_tree, entries, count + 1),
                                PMA_ARRAY(pma_tree, update, count + 1),
                                {0}};
    pma_tree *T = pma_object_create(sizeof *T, arrays);
    if (!T)
        return NULL;
    T->count = count;
    memcpy(T->column, column, (count + 1) * sizeof *column);
    return T;
}

static pma_status fill(const survey *v, pma_tree *T)
{
    list l = {.count = 0};
    link_nodes(v, T);
    const bool listed = list_all(v, T, &l);
    T->row = l.row;
    T->into = calloc(l.count + (size_t)v->p->row_ptr[v->count] + 1, sizeof *T->into);
    if (!listed || !T->into)
        return PMA_NO_MEMORY;
    T->rows = T->into + l.count;
    T->height = pma_panels_most_height(v->p);
    for (size_t t = 0; t < T->count; t++)
        place_rows(T, t);
    for (size_t s = 0; s < v->count; s++) {
        number_rows(v, T, s);
        T->entries[v->node[s]] += (size_t)(v->p->start[s + 1] - v->p->start[s]);
    }
    return PMA_OK;
}

pma_status pma_tree_create(const pma_panels *p, size_t n, size_t nb, size_t entries, pma_tree **out)
{
    pma_status status = PMA_OK;
    survey *v = create_survey(p, n, nb);
    *out = NULL;
    if (!v)
        return PMA_NO_MEMORY;
    find_parents(v);
    const size_t count = divide(v, entries, v->column);
    if (count > 1) {
        *out = allocate(count, v->column);
        status = *out ? fill(v, *out) : PMA_NO_MEMORY;
    }
    free(v);
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
    free(T->row);
    free(T->into);
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

/* ---- nodes divided among workers ------------------------------------------------------------- */

/* A subtree that is given to a worker. */
typedef struct {
    size_t node, weight, worker; /* weight: entries of the subtree */
} subtree;

typedef struct {
    const pma_tree *tree;
    size_t workers;
    subtree *list; /* as many as nodes at most */
    size_t count;
    size_t *weight; /* of all nodes */
    size_t *load;   /* of each worker */
    size_t *trunk, trunk_count, trunk_entries;
} division;

static int heaviest_first(const void *a, const void *b)
{
    const subtree *x = a, *y = b;
    if (x->weight != y->weight)
        return x->weight < y->weight ? 1 : -1;
    return (x->node > y->node) - (x->node < y->node);
}

static int by_node(const void *a, const void *b)
{
    const subtree *x = a, *y = b;
    return (x->node > y->node) - (x->node < y->node);
}

static int by_number(const void *a, const void *b)
{
    const size_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static void add_children(division *d, size_t node)
{
    const pma_tree *T = d->tree;
    for (size_t c = T->child[node]; c != PMA_NO_NODE; c = T->sibling[c])
        d->list[d->count++] = (subtree){.node = c, .weight = d->weight[c]};
}

/* The heaviest first, each to the worker with least; the entries that take longest. */
static size_t assign(division *d)
{
    size_t most = 0;
    for (size_t w = 0; w < d->workers; w++)
        d->load[w] = 0;
    qsort(d->list, d->count, sizeof *d->list, heaviest_first);
    for (size_t i = 0; i < d->count; i++) {
        size_t least = 0;
        for (size_t w = 1; w < d->workers; w++)
            least = d->load[w] < d->load[least] ? w : least;
        d->list[i].worker = least;
        d->load[least] += d->list[i].weight;
        most = d->load[least] > most ? d->load[least] : most;
    }
    return d->trunk_entries + most;
}

/* The root of the heaviest subtree, which is the first one, goes to the trunk. */
static bool grow_trunk(division *d)
{
    if (d->count == 0 || d->tree->child[d->list[0].node] == PMA_NO_NODE)
        return false;
    const size_t node = d->list[0].node;
    d->list[0] = d->list[--d->count];
    d->trunk[d->trunk_count++] = node;
    d->trunk_entries += d->tree->entries[node];
    add_children(d, node);
    return true;
}

/* A trunk of this number of nodes, or of as many as there can be. */
static size_t divide_nodes(division *d, size_t trunk)
{
    d->count = d->trunk_count = d->trunk_entries = 0;
    add_children(d, d->tree->count);
    size_t cost = assign(d);
    while (d->trunk_count < trunk && grow_trunk(d))
        cost = assign(d);
    return cost;
}

static size_t best_trunk(division *d)
{
    size_t best = 0, least = divide_nodes(d, 0);
    while (d->trunk_entries < least && grow_trunk(d)) {
        const size_t cost = assign(d);
        if (cost < least) {
            least = cost;
            best = d->trunk_count;
        }
    }
    return best;
}

static void write_down(division *d, pma_branches *out)
{
    size_t next = 0;
    qsort(d->list, d->count, sizeof *d->list, by_node);
    for (size_t w = 0; w < d->workers; w++) {
        out->begin[w] = next;
        for (size_t i = 0; i < d->count; i++) {
            if (d->list[i].worker == w)
                out->root[next++] = d->list[i].node;
        }
    }
    out->begin[d->workers] = next;
    qsort(d->trunk, d->trunk_count, sizeof *d->trunk, by_number);
    out->trunk_count = d->trunk_count;
    out->trunk_entries = d->trunk_entries;
}

pma_status pma_branches_create(const pma_tree *T, size_t workers, pma_branches *out)
{
    const pma_array arrays[] = {PMA_ARRAY(pma_branches, root, T->count),
                                PMA_ARRAY(pma_branches, trunk, T->count),
                                PMA_ARRAY(pma_branches, begin, workers + 1),
                                {0}};
    const pma_array scratch[] = {PMA_ARRAY(division, list, T->count),
                                 PMA_ARRAY(division, weight, T->count + 1),
                                 PMA_ARRAY(division, load, workers),
                                 {0}};
    division *d = pma_object_create(sizeof *d, scratch);
    *out = (pma_branches){.workers = workers};
    out->block = pma_object_fill(out, arrays);
    if (!d || !out->block) {
        free(d);
        pma_branches_destroy(out);
        return PMA_NO_MEMORY;
    }
    d->tree = T;
    d->workers = workers;
    d->trunk = out->trunk;
    for (size_t t = 0; t < T->count; t++) {
        d->weight[t] += T->entries[t];
        d->weight[T->parent[t]] += d->weight[t];
    }
    divide_nodes(d, best_trunk(d));
    write_down(d, out);
    free(d);
    return PMA_OK;
}

void pma_branches_destroy(pma_branches *b)
{
    free(b->block);
    *b = (pma_branches){0};
}
