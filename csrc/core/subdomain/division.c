/* division.c - a substep of a large subdomain, divided among several workers.
 *
 * With a diagonal Mbar no row waits for another: every worker has a range of them. With a factor
 * that is swept by the nodes of a tree, every worker has branches of it; the trunk above them is
 * swept by one, after them when a substep is opened and before them when it is closed. Ranges and
 * branches are fixed, so that they stay in the caches of one core. */
#include <stdlib.h>

#include "algebra/lists.h"
#include "subdomain/inside.h"

/* ---- which subdomains, and in which branches ------------------------------------------------- */

/* Diagonal Mbar, linear, single steps: no row waits for another. */
static bool is_in_ranges(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->evaluates;
}

/* All sweeps of its steps go through one tree. */
static bool is_in_branches(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const pma_tree *T = pma_factor_tree(&p->single.factor);
    return T && !s->evaluates && !p->mean &&
           (!p->doubled || pma_factor_tree(&p->twice.factor) == T);
}

static bool has_branches(const pma_division *d)
{
    return d->branches.workers > 0;
}

/* A division of `workers` branches in place of what s has, which stays if there is no memory. */
static pma_status find_branches(pma_subdomain *s, size_t workers)
{
    const pma_factor *f = &s->parts.single.factor;
    pma_branches branches;
    PMA_TRY(pma_branches_create(pma_factor_tree(f), workers, &branches));
    pma_division *d = calloc(1, sizeof *d);
    double *fronts = calloc((workers - 1) * pma_factor_front(f) + 1, sizeof *fronts);
    if (!d || !fronts) {
        pma_branches_destroy(&branches);
        free(d);
        free(fronts);
        return PMA_NO_MEMORY;
    }
    const size_t trunk = s->division ? s->division->trunk : branches.trunk_entries;
    *d = (pma_division){.branches = branches, .fronts = fronts, .trunk = trunk};
    pma_division_destroy(s);
    s->division = d;
    return PMA_OK;
}

pma_status pma_division_find(pma_subdomain *s)
{
    if (is_in_branches(s))
        return find_branches(s, 2);
    if (!is_in_ranges(s))
        return PMA_OK;
    s->division = calloc(1, sizeof *s->division);
    return s->division ? PMA_OK : PMA_NO_MEMORY;
}

pma_status pma_division_prepare(pma_subdomain *s, size_t workers)
{
    const pma_division *d = s->division;
    return has_branches(d) && d->branches.workers != workers ? find_branches(s, workers) : PMA_OK;
}

void pma_division_destroy(pma_subdomain *s)
{
    if (!s->division)
        return;
    pma_branches_destroy(&s->division->branches);
    free(s->division->fronts);
    free(s->division);
}

static const pma_division *begin(pma_subdomain *s, const pma_substep *step,
                                 const pma_workers *workers)
{
    pma_division *d = s->division;
    d->op = pma_operator_at(s, step);
    d->step = step;
    d->from = pma_levels_origin(&s->levels, step);
    d->x = pma_levels_at(&s->levels, step->j + 1);
    d->workers = workers;
    return d;
}

/* ---- what a worker has ----------------------------------------------------------------------- */

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    const pma_workers *workers = s->division->workers;
    return workers->share(workers->ctx, work, s);
}

/* The first of its range of rows. */
static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->division->workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

static double *front_of(const pma_subdomain *s, size_t worker)
{
    const size_t front = pma_factor_front(&s->division->op->factor);
    return worker == 0 ? NULL : s->division->fronts + (worker - 1) * front;
}

/* The first node of a branch, all of which follow one another up to its root. */
static size_t lowest_of(const pma_subdomain *s, size_t root)
{
    const pma_tree *T = pma_factor_tree(&s->division->op->factor);
    while (T->child[root] != PMA_NO_NODE)
        root = T->child[root];
    return root;
}

/* ---- open ----------------------------------------------------------------------------------- */

/* (5), (6) */
static bool predict(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    s->update->predict(&d->op->step, begin_of(s, worker), begin_of(s, worker + 1), d->from, d->x);
    return true;
}

/* (11) */
static bool add_forces(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    pma_substep_add_forces(s, s->division->step, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

/* (11), (F2) */
static void open_node(const pma_subdomain *s, size_t node, double *front)
{
    const pma_factor *f = &s->division->op->factor;
    pma_substep_add_forces(s, s->division->step, pma_factor_node(f, node),
                           pma_factor_node(f, node + 1));
    pma_factor_open_node(f, node, s->division->x->w, front, s->work);
}

static bool open_branches(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_branches *b = &s->division->branches;
    for (size_t i = b->begin[worker]; i < b->begin[worker + 1]; i++) {
        for (size_t node = lowest_of(s, b->root[i]); node <= b->root[i]; node++)
            open_node(s, node, front_of(s, worker));
    }
    return true;
}

pma_status pma_division_open(pma_subdomain *s, const pma_substep *step, const pma_workers *workers)
{
    const size_t n = s->parts.n;
    PMA_TRY(pma_substep_load(s, step));
    const pma_division *d = begin(s, step, workers);
    (void)share(s, predict); /* of all rows, before K ut of any */
    (void)share(s, has_branches(d) ? open_branches : add_forces);
    for (size_t i = 0; i < d->branches.trunk_count; i++)
        open_node(s, d->branches.trunk[i], NULL);
    if (has_branches(d))
        pma_substep_add_forces(s, step, n - s->parts.nb, n);
    pma_factor_open_border(&d->op->factor, d->x->w,
                           pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
    return PMA_OK;
}

/* ---- close ---------------------------------------------------------------------------------- */

/* (14) inside, (8), (9) */
static bool close_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_division *d = s->division;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = pma_least(end, s->parts.n - s->parts.nb);
    if (begin < inside)
        pma_factor_divide(&d->op->factor, begin, inside, d->x->w);
    return s->update->correct(&d->op->step, begin, end, d->x);
}

static bool close_node(const pma_subdomain *s, size_t node, double *front)
{
    const pma_division *d = s->division;
    const pma_factor *f = &d->op->factor;
    pma_factor_close_node(f, node, d->x->w, front, s->work);
    return s->update->correct(&d->op->step, pma_factor_node(f, node), pma_factor_node(f, node + 1),
                              d->x);
}

static bool close_branches(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_branches *b = &s->division->branches;
    bool finite = true;
    for (size_t i = b->begin[worker]; i < b->begin[worker + 1]; i++) {
        for (size_t node = b->root[i] + 1, low = lowest_of(s, b->root[i]); node-- > low;)
            finite = close_node(s, node, front_of(s, worker)) && finite;
    }
    return finite;
}

pma_status pma_division_close(pma_subdomain *s, const pma_substep *step, const double *lam,
                              const pma_workers *workers)
{
    const pma_division *d = begin(s, step, workers);
    const pma_state *x = d->x;
    bool finite = true;
    pma_substep_load_interface(s, lam);
    pma_factor_close_border(&d->op->factor, s->closing, x->w, s->work);
    if (has_branches(d))
        finite = s->update->correct(&d->op->step, s->parts.n - s->parts.nb, s->parts.n, x);
    for (size_t i = d->branches.trunk_count; i-- > 0;)
        finite = close_node(s, d->branches.trunk[i], NULL) && finite;
    finite = share(s, has_branches(d) ? close_branches : close_range) && finite;
    return finite ? pma_substep_observe(s, step, lam) : PMA_NOT_FINITE;
}
