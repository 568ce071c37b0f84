/* visit.c - a substep is closed and the next one opened in one visit.
 *
 * Down the tree of the factor the nodes are swept backward, corrected and predicted; up again they
 * get their forces and are swept forward. A node is swept both ways while it is in the cache, with
 * all that is below it in between: what a backward sweep needs is above, and so are the unknowns
 * that a row of K couples with, unless they are below. */
#include <stdlib.h>

#include "member/inside.h"

/* ---- which subdomains ------------------------------------------------------------------------ */

/* Nodes of a tree in postorder: those below a node are the ones before it, from `low` on. */
typedef struct {
    const pma_tree *tree;
    size_t n;
    size_t *of;  /* n: node of each unknown */
    size_t *low; /* count+1 */
} lineage;

static bool are_related(const lineage *l, size_t i, size_t j)
{
    const size_t a = l->of[i], b = l->of[j];
    return (l->low[a] <= b && b <= a) || (l->low[b] <= a && a <= b);
}

static void find_lineage(lineage *l)
{
    const pma_tree *T = l->tree;
    for (size_t t = 0; t <= T->count; t++) {
        l->low[t] = T->child[t] == PMA_NO_NODE ? t : l->low[T->child[t]];
        for (size_t i = T->column[t]; i < (t < T->count ? T->column[t + 1] : l->n); i++)
            l->of[i] = t;
    }
}

static bool rows_are_related(const lineage *l, const pma_matrix *A)
{
    for (size_t i = 0; i < A->n; i++) {
        for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++) {
            if (!are_related(l, i, (size_t)A->index[k]))
                return false;
        }
    }
    return true;
}

static bool strips_are_related(const lineage *l, const pma_strips *S)
{
    for (size_t s = 0; s < S->count; s++) {
        for (int64_t i = S->first[s]; i < S->first[s + 1]; i++) {
            for (int64_t k = S->ptr[s]; k < S->ptr[s + 1]; k++) {
                if (!are_related(l, (size_t)i, (size_t)S->index[k]))
                    return false;
            }
        }
    }
    return true;
}

static bool is_related(const lineage *l, const pma_matrix *A)
{
    switch (A->form) {
    case PMA_ZERO:
    case PMA_DIAGONAL:
        return true;
    case PMA_SPARSE:
        return rows_are_related(l, A);
    case PMA_STRIPS:
        return strips_are_related(l, &A->strips);
    case PMA_IN_LANES:
        return is_related(l, A->each);
    default:
        return false;
    }
}

pma_status pma_visit_find(const pma_subdomain *s, bool *fuses)
{
    const pma_parts *p = &s->parts;
    const pma_factor *f = &p->single.factor;
    *fuses = false;
    if (!pma_factor_tree(f) || s->extrapolates || p->springs.total > 0 || p->mean)
        return PMA_OK;
    const pma_tree *T = pma_factor_tree(f);
    lineage l = {.tree = T, .n = f->each ? f->each->n : f->n};
    l.of = calloc(l.n + T->count + 1, sizeof *l.of);
    if (!l.of)
        return PMA_NO_MEMORY;
    l.low = l.of + l.n;
    find_lineage(&l);
    *fuses = is_related(&l, &p->K) && is_related(&l, &p->C);
    free(l.of);
    return PMA_OK;
}

/* ---- a visit --------------------------------------------------------------------------------- */

/* Both substeps, and what is known of them. */
typedef struct {
    pma_subdomain *s;
    const pma_operator *op;
    const pma_substep *opened;
    const pma_state *x, *from, *to; /* at the end of `closed`; at both ends of `opened` */
    bool finite;
} visit;

/* (8), (9) of the one substep, (5), (6) of the other */
static void turn(visit *v, size_t begin, size_t end)
{
    const pma_subdomain *s = v->s;
    v->finite = s->update->correct(&v->op->step, begin, end, v->x) && v->finite;
    s->update->predict(&v->op->step, begin, end, v->from, v->to);
}

static void go_down(visit *v, size_t node)
{
    const pma_factor *f = &v->op->factor;
    pma_factor_close_node(f, node, v->x->w, v->s->work);
    turn(v, pma_factor_node(f, node), pma_factor_node(f, node + 1));
}

static void go_up(visit *v, size_t node)
{
    const pma_factor *f = &v->op->factor;
    pma_substep_add_forces(v->s, v->opened, pma_factor_node(f, node), pma_factor_node(f, node + 1));
    pma_factor_open_node(f, node, v->to->w, v->s->work);
}

/* All nodes, in an order in which a parent is before its children and after them. */
static void go_through(visit *v)
{
    const pma_tree *T = pma_factor_tree(&v->op->factor);
    size_t node = T->child[T->count];
    while (node != T->count) {
        go_down(v, node);
        if (T->child[node] != PMA_NO_NODE) {
            node = T->child[node];
            continue;
        }
        go_up(v, node);
        while (T->sibling[node] == PMA_NO_NODE && T->parent[node] != T->count) {
            node = T->parent[node];
            go_up(v, node);
        }
        node = T->sibling[node] != PMA_NO_NODE ? T->sibling[node] : T->count;
    }
}

static pma_status fuse(visit *v, const double *lam)
{
    pma_subdomain *s = v->s;
    const size_t n = s->parts.n, border = n - s->parts.nb;
    double *wf_b = pma_levels_free_velocity(&s->levels, v->opened->j + 1);
    const pma_status status = pma_substep_load(s, v->opened);
    if (status != PMA_OK)
        return status;
    pma_substep_load_interface(s, lam);
    pma_factor_close_part(&v->op->factor, n, n, s->closing, v->x->w, s->work);
    turn(v, border, n);
    go_through(v);
    pma_substep_add_forces(s, v->opened, border, n);
    pma_factor_open_part(&v->op->factor, n, n, v->to->w, wf_b, s->work);
    pma_substep_free_velocity(s, v->opened);
    return v->finite ? PMA_OK : PMA_NOT_FINITE;
}

pma_status pma_visit_substeps(pma_subdomain *s, const pma_substep *closed,
                              const pma_substep *opened, const double *lam)
{
    if (!s->fuses || closed->twice != opened->twice) {
        const pma_status status = pma_substep_close(s, closed, lam);
        return status == PMA_OK ? pma_substep_open(s, opened) : status;
    }
    visit v = {.s = s,
               .op = pma_operator_of(s, closed->twice),
               .opened = opened,
               .x = pma_levels_at(&s->levels, closed->j + 1),
               .from = pma_levels_origin(&s->levels, opened),
               .to = pma_levels_at(&s->levels, opened->j + 1),
               .finite = true};
    return fuse(&v, lam);
}
