/* visit.c - a substep is closed and the next one opened in one visit.
 *
 * Down the tree of the factor the nodes are swept backward, corrected and predicted; up again they
 * get their forces and are swept forward. A node is swept both ways while it is in the cache, with
 * all that is below it in between: what a backward sweep needs is above, and so are the unknowns
 * that a row of K couples with, unless they are below. So subtrees can also be visited by several
 * workers, once what is above them was swept backward; it is swept forward when they are done. */
#include <stdlib.h>

#include "algebra/lists.h"
#include "member/subdomain_struct.h"

/* ---- which subdomains, and by how many workers ----------------------------------------------- */

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

static pma_status find_relations(const pma_subdomain *s, bool *related)
{
    const pma_factor *f = &s->parts.single.factor;
    lineage l = {.tree = pma_factor_tree(f), .n = f->each ? f->each->n : f->n};
    l.of = calloc(l.n + l.tree->count + 1, sizeof *l.of);
    if (!l.of)
        return PMA_NO_MEMORY;
    l.low = l.of + l.n;
    find_lineage(&l);
    *related = is_related(&l, &s->parts.K) && is_related(&l, &s->parts.C);
    free(l.of);
    return PMA_OK;
}

pma_status pma_visit_find(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const pma_tree *T = pma_factor_tree(&p->single.factor);
    if (!T || s->restores || p->mean || (p->doubled && pma_factor_tree(&p->twice.factor) != T))
        return PMA_OK;
    pma_status status = find_relations(s, &s->fuses);
    if (status != PMA_OK || !s->fuses)
        return status;
    status = pma_visit_divide(s, 2);
    s->trunk = s->branches.trunk_entries;
    return status == PMA_OK ? pma_visit_divide(s, 1) : status;
}

pma_status pma_visit_divide(pma_subdomain *s, size_t workers)
{
    if (s->branches.workers == workers)
        return PMA_OK;
    const pma_factor *f = &s->parts.single.factor;
    pma_branches branches;
    const pma_status status = pma_branches_create(pma_factor_tree(f), workers, &branches);
    if (status != PMA_OK)
        return status;
    double *fronts = calloc((workers - 1) * pma_factor_front(f) + 1, sizeof *fronts);
    if (!fronts) {
        pma_branches_destroy(&branches);
        return PMA_NO_MEMORY;
    }
    pma_visit_destroy(s);
    s->branches = branches;
    s->fronts = fronts;
    return PMA_OK;
}

void pma_visit_destroy(pma_subdomain *s)
{
    pma_branches_destroy(&s->branches);
    free(s->fronts);
    s->fronts = NULL;
}

/* ---- a visit: trunk down, branches, trunk up ------------------------------------------------- */

/* (8), (9) of the one substep, (5), (6) of the other; true when all that is new is finite */
static bool turn(const pma_subdomain *s, size_t begin, size_t end)
{
    const pma_visit *v = &s->visit;
    const bool finite = !v->closed || s->update->correct(&v->op->step, begin, end, v->x);
    if (v->opened)
        s->update->predict(&v->op->step, begin, end, v->from, v->to);
    return finite;
}

static bool go_down(const pma_subdomain *s, size_t node, double *front)
{
    const pma_visit *v = &s->visit;
    const pma_factor *f = &v->op->factor;
    if (v->closed)
        pma_factor_close_node(f, node, v->x->w, front, s->work);
    return turn(s, pma_factor_node(f, node), pma_factor_node(f, node + 1));
}

static void go_up(const pma_subdomain *s, size_t node, double *front)
{
    const pma_visit *v = &s->visit;
    const pma_factor *f = &v->op->factor;
    if (!v->opened)
        return;
    pma_substep_add_forces(s, v->opened, pma_factor_node(f, node), pma_factor_node(f, node + 1));
    pma_factor_open_node(f, node, v->to->w, front, s->work);
}

/* Children are visited from the first on and, in every other visit, from the last on: of what a
 * visit reads, the next one finds in the caches what was read last. */
static size_t first_child(const pma_tree *T, size_t node, bool reversed)
{
    return reversed && T->child[node] != PMA_NO_NODE ? node - 1 : T->child[node];
}

static size_t next_child(const pma_tree *T, size_t node, bool reversed)
{
    return reversed ? T->previous[node] : T->sibling[node];
}

/* A subtree, in an order in which a parent is before its children and after them. */
static bool go_through(const pma_subdomain *s, size_t root, double *front)
{
    const pma_tree *T = pma_factor_tree(&s->visit.op->factor);
    const bool reversed = s->visit.reversed;
    bool finite = true;
    for (size_t node = root, next;; node = next) {
        finite = go_down(s, node, front) && finite;
        while (T->child[node] != PMA_NO_NODE) {
            node = first_child(T, node, reversed);
            finite = go_down(s, node, front) && finite;
        }
        go_up(s, node, front);
        while (node != root && (next = next_child(T, node, reversed)) == PMA_NO_NODE) {
            node = T->parent[node];
            go_up(s, node, front);
        }
        if (node == root)
            return finite;
    }
}

static pma_visit make_visit(const pma_subdomain *s, const pma_substep *closed,
                            const pma_substep *opened, const double *lam,
                            const pma_workers *workers)
{
    const pma_substep *step = closed ? closed : opened;
    return (pma_visit){.op = pma_operator_of(s, step->twice),
                       .closed = closed,
                       .opened = opened,
                       .lam = lam,
                       .workers = workers,
                       .x = closed ? pma_levels_at(&s->levels, closed->j + 1) : NULL,
                       .from = opened ? pma_levels_origin(&s->levels, opened) : NULL,
                       .to = opened ? pma_levels_at(&s->levels, opened->j + 1) : NULL,
                       .reversed = !s->visit.reversed};
}

/* The trunk down; true when every new value is finite */
static bool begin(pma_subdomain *s)
{
    const size_t n = s->parts.n;
    if (s->visit.closed) {
        pma_substep_load_interface(s, s->visit.lam);
        pma_factor_close_part(&s->visit.op->factor, n, n, s->closing, s->visit.x->w, s->work);
    }
    bool finite = turn(s, n - s->parts.nb, n);
    for (size_t i = s->branches.trunk_count; i-- > 0;)
        finite = go_down(s, s->branches.trunk[i], NULL) && finite;
    return finite;
}

/* The branches of a worker */
static bool go(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_branches *b = &s->branches;
    double *front =
        worker == 0 ? NULL : s->fronts + (worker - 1) * pma_factor_front(&s->visit.op->factor);
    bool finite = true;
    const size_t begin = b->begin[worker], end = b->begin[worker + 1];
    for (size_t k = 0; k < end - begin; k++) {
        const size_t i = s->visit.reversed ? end - 1 - k : begin + k;
        finite = go_through(s, b->root[i], front) && finite;
    }
    return finite;
}

static bool go_all(pma_subdomain *s)
{
    bool finite = true;
    if (s->visit.workers)
        return s->visit.workers->share(s->visit.workers->ctx, go, s);
    for (size_t w = 0; w < s->branches.workers; w++)
        finite = go(s, w) && finite;
    return finite;
}

/* The trunk up */
static void end(pma_subdomain *s)
{
    const pma_visit *v = &s->visit;
    const size_t n = s->parts.n;
    for (size_t i = 0; i < s->branches.trunk_count; i++)
        go_up(s, s->branches.trunk[i], NULL);
    if (!v->opened)
        return;
    pma_substep_add_forces(s, v->opened, n - s->parts.nb, n);
    pma_factor_open_part(&v->op->factor, n, n, v->to->w,
                         pma_levels_free_velocity(&s->levels, v->opened->j + 1), s->work);
    pma_substep_free_velocity(s, v->opened);
}

/* Steps of one operator */
static pma_status visit(pma_subdomain *s, const pma_substep *closed, const pma_substep *opened,
                        const double *lam, const pma_workers *workers)
{
    const pma_status status = opened ? pma_substep_load(s, opened) : PMA_OK;
    if (status != PMA_OK)
        return status;
    s->visit = make_visit(s, closed, opened, lam, workers);
    bool finite = begin(s);
    finite = go_all(s) && finite;
    if (!finite)
        return PMA_NOT_FINITE;
    end(s);
    return closed ? pma_substep_observe(s, closed, lam) : PMA_OK;
}

pma_status pma_visit_advance(pma_subdomain *s, const pma_substep *closed, const pma_substep *opened,
                             const double *lam, const pma_workers *workers)
{
    if (!closed || !opened || closed->twice == opened->twice)
        return visit(s, closed, opened, lam, workers);
    const pma_status status = visit(s, closed, NULL, lam, workers);
    return status == PMA_OK ? visit(s, NULL, opened, lam, workers) : status;
}

/* ---- one substep of a large explicit subdomain, in ranges of its rows ------------------------
 *
 * With a diagonal Mbar no row waits for another, but K ut needs all of ut: two stages open a
 * substep, one closes it, and what concerns the interface is done by one worker. The ranges are
 * fixed, so that rows stay in the caches of one core. */

bool pma_visit_is_in_ranges(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->restores;
}

static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->visit.workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    return s->visit.workers->share(s->visit.workers->ctx, work, s);
}

/* ---- open ----------------------------------------------------------------------------------- */

/* (5), (6) */
static bool predict(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_visit *v = &s->visit;
    s->update->predict(&v->op->step, begin_of(s, worker), begin_of(s, worker + 1), v->from, v->to);
    return true;
}

/* (11) */
static bool add_forces(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    pma_substep_add_forces(s, s->visit.opened, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

static pma_status open_ranges(pma_subdomain *s, const pma_substep *step)
{
    const size_t n = s->parts.n;
    const pma_status status = pma_substep_load(s, step);
    if (status != PMA_OK)
        return status;
    (void)share(s, predict);
    (void)share(s, add_forces);
    pma_factor_open_part(&s->visit.op->factor, n, n, s->visit.to->w,
                         pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
    return PMA_OK;
}

/* ---- close ---------------------------------------------------------------------------------- */

/* (14) inside, (8), (9) */
static bool correct(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_visit *v = &s->visit;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = pma_least(end, s->parts.n - s->parts.nb);
    pma_factor_close_part(&v->op->factor, begin, inside, s->closing, v->x->w, s->work);
    return s->update->correct(&v->op->step, begin, end, v->x);
}

/* (14) on the interface, then in all ranges */
static pma_status close_ranges(pma_subdomain *s, const pma_substep *step)
{
    const size_t n = s->parts.n;
    pma_substep_load_interface(s, s->visit.lam);
    pma_factor_close_part(&s->visit.op->factor, n, n, s->closing, s->visit.x->w, s->work);
    return share(s, correct) ? pma_substep_observe(s, step, s->visit.lam) : PMA_NOT_FINITE;
}

pma_status pma_visit_advance_ranges(pma_subdomain *s, const pma_substep *closed,
                                    const pma_substep *opened, const double *lam,
                                    const pma_workers *workers)
{
    s->visit = make_visit(s, closed, opened, lam, workers);
    const pma_status status = closed ? close_ranges(s, closed) : PMA_OK;
    return opened && status == PMA_OK ? open_ranges(s, opened) : status;
}
