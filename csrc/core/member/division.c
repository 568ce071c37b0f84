/* division.c - a substep of a large subdomain, divided among several workers.
 *
 * With a diagonal Mbar no row waits for another: every worker has a range of them. With a factor
 * that is swept by the nodes of a tree, every worker has branches of it; the trunk above them is
 * swept by one, after them when a substep is opened and before them when it is closed. Ranges and
 * branches are fixed, so that they stay in the caches of one core. */
#include <stdlib.h>

#include "algebra/lists.h"
#include "member/subdomain_struct.h"

/* ---- which subdomains, and in which branches ------------------------------------------------- */

bool pma_division_is_in_ranges(const pma_subdomain *s)
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

pma_status pma_division_find(pma_subdomain *s)
{
    s->branched = is_in_branches(s);
    const pma_status status = s->branched ? pma_division_prepare(s, 2) : PMA_OK;
    s->trunk = s->branches.trunk_entries;
    return status;
}

pma_status pma_division_prepare(pma_subdomain *s, size_t workers)
{
    if (s->branches.workers == workers)
        return PMA_OK;
    const pma_factor *f = &s->parts.single.factor;
    pma_branches branches;
    PMA_TRY(pma_branches_create(pma_factor_tree(f), workers, &branches));
    double *fronts = calloc((workers - 1) * pma_factor_front(f) + 1, sizeof *fronts);
    if (!fronts) {
        pma_branches_destroy(&branches);
        return PMA_NO_MEMORY;
    }
    pma_division_destroy(s);
    s->branches = branches;
    s->fronts = fronts;
    return PMA_OK;
}

void pma_division_destroy(pma_subdomain *s)
{
    pma_branches_destroy(&s->branches);
    free(s->fronts);
    s->fronts = NULL;
}

/* ---- what a worker has ----------------------------------------------------------------------- */

static bool share(pma_subdomain *s, bool (*work)(void *self, size_t worker))
{
    const pma_workers *workers = s->divided.workers;
    return workers->share(workers->ctx, work, s);
}

/* The first of its range of rows. */
static size_t begin_of(const pma_subdomain *s, size_t worker)
{
    const size_t n = s->parts.n, workers = s->divided.workers->count;
    return worker < workers ? worker * (n / workers) : n;
}

static double *front_of(const pma_subdomain *s, size_t worker)
{
    const size_t front = pma_factor_front(&s->divided.op->factor);
    return worker == 0 ? NULL : s->fronts + (worker - 1) * front;
}

/* The first node of a branch, all of which follow one another up to its root. */
static size_t lowest_of(const pma_subdomain *s, size_t root)
{
    const pma_tree *T = pma_factor_tree(&s->divided.op->factor);
    while (T->child[root] != PMA_NO_NODE)
        root = T->child[root];
    return root;
}

/* ---- open ----------------------------------------------------------------------------------- */

/* (5), (6) */
static bool predict(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_divided *d = &s->divided;
    s->update->predict(&d->op->step, begin_of(s, worker), begin_of(s, worker + 1), d->from, d->x);
    return true;
}

/* (11) */
static bool add_forces(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    pma_substep_add_forces(s, s->divided.step, begin_of(s, worker), begin_of(s, worker + 1));
    return true;
}

/* (11), (F2) */
static void open_node(const pma_subdomain *s, size_t node, double *front)
{
    const pma_factor *f = &s->divided.op->factor;
    pma_substep_add_forces(s, s->divided.step, pma_factor_node(f, node),
                           pma_factor_node(f, node + 1));
    pma_factor_open_node(f, node, s->divided.x->w, front, s->work);
}

static bool open_branches(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_branches *b = &s->branches;
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
    s->divided = (pma_divided){.op = pma_operator_of(s, step->twice),
                               .step = step,
                               .from = pma_levels_origin(&s->levels, step),
                               .x = pma_levels_at(&s->levels, step->j + 1),
                               .workers = workers};
    (void)share(s, predict); /* of all rows, before K ut of any */
    (void)share(s, s->branched ? open_branches : add_forces);
    for (size_t i = 0; i < s->branches.trunk_count; i++)
        open_node(s, s->branches.trunk[i], NULL);
    if (s->branched)
        pma_substep_add_forces(s, step, n - s->parts.nb, n);
    pma_factor_open_border(&s->divided.op->factor, s->divided.x->w,
                           pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
    return PMA_OK;
}

/* ---- close ---------------------------------------------------------------------------------- */

/* (14) inside, (8), (9) */
static bool close_range(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_divided *d = &s->divided;
    const size_t begin = begin_of(s, worker), end = begin_of(s, worker + 1);
    const size_t inside = pma_least(end, s->parts.n - s->parts.nb);
    if (begin < inside)
        pma_factor_divide(&d->op->factor, begin, inside, d->x->w);
    return s->update->correct(&d->op->step, begin, end, d->x);
}

static bool close_node(const pma_subdomain *s, size_t node, double *front)
{
    const pma_divided *d = &s->divided;
    const pma_factor *f = &d->op->factor;
    pma_factor_close_node(f, node, d->x->w, front, s->work);
    return s->update->correct(&d->op->step, pma_factor_node(f, node), pma_factor_node(f, node + 1),
                              d->x);
}

static bool close_branches(void *self, size_t worker)
{
    const pma_subdomain *s = self;
    const pma_branches *b = &s->branches;
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
    const pma_operator *op = pma_operator_of(s, step->twice);
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    bool finite = true;
    s->divided = (pma_divided){.op = op, .step = step, .x = x, .workers = workers};
    pma_substep_load_interface(s, lam);
    pma_factor_close_border(&op->factor, s->closing, x->w, s->work);
    if (s->branched)
        finite = s->update->correct(&op->step, s->parts.n - s->parts.nb, s->parts.n, x);
    for (size_t i = s->branches.trunk_count; i-- > 0;)
        finite = close_node(s, s->branches.trunk[i], NULL) && finite;
    finite = share(s, s->branched ? close_branches : close_range) && finite;
    return finite ? pma_substep_observe(s, step, lam) : PMA_NOT_FINITE;
}
