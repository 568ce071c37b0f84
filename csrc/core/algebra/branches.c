#include "algebra/branches.h"

#include <stdbool.h>
#include <stdlib.h>

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

static int ascending(const void *a, const void *b)
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
static size_t divide(division *d, size_t trunk)
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
    size_t best = 0, least = divide(d, 0);
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
    qsort(d->list, d->count, sizeof *d->list, ascending);
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
    division d = {.tree = T, .workers = workers};
    *out = (pma_branches){.workers = workers};
    out->root = calloc(2 * T->count + workers + 2, sizeof *out->root);
    d.list = calloc(T->count + 1, sizeof *d.list);
    d.weight = calloc(T->count + 1 + workers, sizeof *d.weight);
    if (!out->root || !d.list || !d.weight) {
        free(d.list);
        free(d.weight);
        pma_branches_destroy(out);
        return PMA_NO_MEMORY;
    }
    d.load = d.weight + T->count + 1;
    d.trunk = out->trunk = out->root + T->count;
    out->begin = out->trunk + T->count;
    for (size_t t = 0; t < T->count; t++) {
        d.weight[t] += T->entries[t];
        d.weight[T->parent[t]] += d.weight[t];
    }
    divide(&d, best_trunk(&d));
    write_down(&d, out);
    free(d.list);
    free(d.weight);
    return PMA_OK;
}

void pma_branches_destroy(pma_branches *b)
{
    free(b->root);
    *b = (pma_branches){0};
}
