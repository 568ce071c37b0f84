#include "member/subdomain.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "member/update.h"

/* An own step that is closed, two that are opened and the node before; or for single steps two
 * macro steps with two stored velocities each. */
enum { MOST_WORKS = 4 };

/* Nodes inside a macro step live in `work`, in turn; the present is changed by commit alone, so
 * that whatever ends a macro step early leaves the state of the last whole one. */
struct pma_subdomain {
    pma_parts parts;
    pma_load load;
    pma_state present;  /* own node 0 */
    pma_state previous; /* own node -1, for the double step */
    pma_state work[MOST_WORKS]; /* own nodes 1, 2, ..., see slot_of */
    const pma_update *update;
    size_t reach, slab;         /* of the matrices; rows of a step taken at a time */
    size_t works, first;        /* how many of them there are, and where they begin */
    size_t opened;              /* steps towards the own nodes up to this one have been opened */
    pma_state response;         /* (M3), if ramped */
    pma_response stored;
    double *vf_present;         /* nb: stored free velocity of node 0 */
    double *vf_work[MOST_WORKS]; /* nb: of nodes 1, 2, ... */
    double *vf_previous;        /* nb: of node -1; no step reads it, but it is part of a state */
    double *link, *closing;     /* nb: scratch of what may be asked during a step, and of a step */
    double *link_work, *link_aside; /* having looked ahead: scratch of a factor, for the same */
    double *vs;                 /* n: extrapolated velocity (R1); only where it is needed */
    double *before;             /* scratch: springs before they move */
    int code;                   /* what a function that failed returned */
    pma_energy *energy;         /* of a run that asks for it, else NULL */
    double *block, *block_ahead;
};

/* ---- making ----------------------------------------------------------------------------- */

static pma_status check_operator(const pma_parts *parts, const pma_operator *op)
{
    if (op->factor.n != parts->n || op->factor.nb != parts->nb)
        return PMA_BAD_SIZE;
    return pma_factor_check(&op->factor);
}

static pma_status check_parts(const pma_parts *parts)
{
    pma_status status = PMA_OK;
    if (parts->n == 0 || parts->nb > parts->n || parts->substeps == 0 ||
        parts->substeps > PMA_MOST_SUBSTEPS)
        return PMA_BAD_SIZE;
    if (parts->K.n != parts->n || parts->C.n != parts->n || parts->link.nb != parts->nb)
        return PMA_BAD_SIZE;
    if ((status = pma_matrix_check(&parts->K)) || (status = pma_matrix_check(&parts->C)))
        return status;
    if (parts->restoring.function && parts->restoring.n != parts->n)
        return PMA_BAD_SIZE;
    if (parts->D_r.form != PMA_ZERO && parts->D_r.n != parts->n)
        return PMA_BAD_SIZE;
    if (parts->K_r.form != PMA_ZERO && parts->K_r.n != parts->n)
        return PMA_BAD_SIZE;
    if ((status = pma_restoring_check(&parts->restoring)) ||
        (status = pma_springs_check(&parts->springs, parts->n)) ||
        (status = pma_matrix_check(&parts->D_r)) || (status = pma_matrix_check(&parts->K_r)))
        return status;
    if ((status = pma_link_check(&parts->link)) || (status = check_operator(parts, &parts->single)))
        return status;
    return parts->doubled ? check_operator(parts, &parts->twice) : PMA_OK;
}

/* Does a step ask for the velocity extrapolated from its beginning? */
static bool extrapolates(const pma_parts *parts)
{
    return parts->restoring.function || parts->lagged || parts->D_r.form != PMA_ZERO;
}

static size_t most(size_t a, size_t b)
{
    return a > b ? a : b;
}

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

static size_t reach_of(const pma_parts *p)
{
    const size_t matrices = most(pma_matrix_reach(&p->K), pma_matrix_reach(&p->C));
    const size_t factors = p->doubled ? pma_factor_reach(&p->twice.factor) : 0;
    return most(matrices, most(factors, pma_factor_reach(&p->single.factor)));
}

/* Rows that fit into the first cache with all they need, and the furthest reach that leaves the
 * rest in the second. */
enum { SLAB = 128, NARROW = 4096 };

/* Restoring forces want all predictors at once. */
static size_t slab_of(const pma_parts *p, size_t reach)
{
    const bool linear = !extrapolates(p) && p->springs.total == 0;
    return reach <= NARROW && reach < p->n / 2 && linear ? SLAB : p->n;
}

static double *take(double **next, size_t count)
{
    double *taken = *next;
    *next += count;
    return taken;
}

/* Numbers that the springs remember of a node. */
static size_t spring_numbers(const pma_parts *parts)
{
    return PMA_SPRING_FIELDS * parts->springs.total;
}

static pma_state take_state(double **next, const pma_parts *parts)
{
    const size_t n = parts->n;
    pma_state s;
    s.u = take(next, n);
    s.v = take(next, n);
    s.w = take(next, n);
    s.a = take(next, n);
    s.springs = take(next, spring_numbers(parts));
    return s;
}

static void lay_out(pma_subdomain *s)
{
    const size_t n = s->parts.n, nb = s->parts.nb;
    double *next = s->block;
    s->present = take_state(&next, &s->parts);
    for (size_t i = 0; i < s->works; i++)
        s->work[i] = take_state(&next, &s->parts);
    if (s->parts.doubled)
        s->previous = take_state(&next, &s->parts);
    if (s->parts.ramped)
        s->response = take_state(&next, &s->parts);
    s->vf_present = take(&next, nb);
    s->vf_work[0] = take(&next, nb);
    s->vf_work[1] = take(&next, nb);
    s->link = take(&next, nb);
    s->closing = take(&next, nb);
    s->vf_previous = take(&next, nb);
    s->vs = take(&next, extrapolates(&s->parts) ? n : 0);
    s->before = take(&next, spring_numbers(&s->parts));
}

pma_status pma_subdomain_create(const pma_parts *parts, pma_subdomain **out)
{
    *out = NULL;
    const pma_status status = check_parts(parts);
    if (status != PMA_OK)
        return status;
    const size_t works = parts->doubled && parts->substeps > 1 ? 2 : 1;
    const size_t states = 1 + works + (parts->doubled ? 1 : 0) + (parts->ramped ? 1 : 0);
    const size_t extrapolated = extrapolates(parts) ? parts->n : 0;
    const size_t remembered = spring_numbers(parts);
    /* at most 5 (4 n + 3 springs) + n + 6 nb + 3 springs doubles: no overflow below these */
    if (parts->n > SIZE_MAX / (64 * sizeof(double)) ||
        parts->springs.total > SIZE_MAX / (64 * sizeof(double)))
        return PMA_NO_MEMORY;
    pma_subdomain *s = calloc(1, sizeof *s);
    if (!s)
        return PMA_NO_MEMORY;
    s->parts = *parts;
    s->update = pma_update_best();
    s->works = works;
    s->reach = reach_of(parts);
    s->slab = slab_of(parts, s->reach);
    s->block = calloc(states * (4 * parts->n + remembered) + extrapolated + 6 * parts->nb +
                          remembered,
                      sizeof(double));
    if (!s->block) {
        free(s);
        return PMA_NO_MEMORY;
    }
    lay_out(s);
    s->load = (pma_load){.kind = PMA_LOAD_NONE, .n = parts->n};
    *out = s;
    return PMA_OK;
}

void pma_subdomain_destroy(pma_subdomain *s)
{
    pma_subdomain_end_energy(s);
    if (s) {
        free(s->block);
        free(s->block_ahead);
    }
    free(s);
}

static size_t height_of(const pma_operator *op)
{
    return op->factor.form == PMA_PANELS ? pma_panels_most_height(&op->factor.panels) : 0;
}

pma_status pma_subdomain_look_ahead(pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const size_t works = !p->doubled ? 2 : p->substeps > 1 ? 4 : 3;
    const size_t single = height_of(&p->single), twice = p->doubled ? height_of(&p->twice) : 0;
    const size_t height = single > twice ? single : twice;
    if (s->block_ahead)
        return PMA_OK;
    /* two states and 2 nb + n + n doubles at most, fewer than there are already */
    const size_t state = 4 * p->n + spring_numbers(p);
    s->block_ahead = calloc((works - s->works) * state + 2 * p->nb + height + p->n,
                            sizeof(double));
    if (!s->block_ahead)
        return PMA_NO_MEMORY;
    double *next = s->block_ahead;
    for (size_t i = s->works; i < works; i++)
        s->work[i] = take_state(&next, p);
    s->vf_work[2] = take(&next, p->nb);
    s->vf_work[3] = take(&next, p->nb);
    s->link_work = take(&next, height);
    s->link_aside = take(&next, p->n);
    s->works = works;
    return PMA_OK;
}

const pma_parts *pma_subdomain_parts(const pma_subdomain *s)
{
    return &s->parts;
}

void pma_subdomain_set_load(pma_subdomain *s, pma_load load)
{
    assert(load.n == s->parts.n);
    s->load = load;
    s->opened = 0;
}

const pma_load *pma_subdomain_load(const pma_subdomain *s)
{
    return &s->load;
}

/* A function of the caller's takes at least as long as reading this many entries: so the schedule
 * asks whether to stop after each call of a slow one. */
enum { CALL_ENTRIES = 20000 };

/* A spring reads and writes about as many numbers. */
enum { SPRING_ENTRIES = 16 };

size_t pma_subdomain_entries(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    const size_t call = p->restoring.function ? CALL_ENTRIES : 0;
    const size_t springs = SPRING_ENTRIES * p->springs.total;
    return call + springs + 2 * pma_factor_entries(&p->single.factor) + pma_matrix_entries(&p->K) +
           pma_matrix_entries(&p->C) + pma_matrix_entries(&p->D_r) + 12 * p->n;
}

/* ---- where a node lives ----------------------------------------------------------------- */

static const pma_operator *operator_of(const pma_subdomain *s, bool twice)
{
    return twice ? &s->parts.twice : &s->parts.single;
}

/* Single steps are made in place: a macro step has one slot, the next one another if there are two.
 * Double steps need the node before, so their nodes take turns. */
static size_t slot_of(const pma_subdomain *s, size_t j)
{
    if (s->works == 1)
        return 0;
    return (s->first + (s->parts.doubled ? j - 1 : j > s->parts.substeps)) % s->works;
}

const pma_state *pma_subdomain_at(const pma_subdomain *s, size_t j)
{
    return j == 0 ? &s->present : &s->work[slot_of(s, j)];
}

/* Where the stored free velocity of own node j > 0 is: that of the node before is needed too. */
static size_t free_velocity_slot(const pma_subdomain *s, size_t j)
{
    const size_t slot = slot_of(s, j), substeps = s->parts.substeps;
    if (s->parts.doubled && s->works > 1)
        return slot;
    return 2 * slot + (j > substeps ? j - substeps - 1 : j - 1) % 2;
}

static double *free_velocity_at(const pma_subdomain *s, size_t j)
{
    return j == 0 ? s->vf_present : s->vf_work[free_velocity_slot(s, j)];
}

/* The state a step towards own node j + 1 starts from. */
static const pma_state *origin(const pma_subdomain *s, size_t j, bool twice)
{
    if (!twice)
        return pma_subdomain_at(s, j);
    return j == 0 ? &s->previous : pma_subdomain_at(s, j - 1);
}

/* The interface dofs are the last of a vector over all dofs. */
static double *interface_of(const pma_subdomain *s, double *x)
{
    return x + (s->parts.n - s->parts.nb);
}

/* ---- the verbs -------------------------------------------------------------------------- */

/* link (nb) := S^-1 L_b^T lam. With other scratch than the steps have, when one may be under way in
 * another thread. */
static void solve_link(pma_subdomain *s, const pma_operator *op, const double *lam)
{
    pma_factor factor = op->factor;
    if (s->block_ahead) {
        factor.work = s->link_work;
        factor.path.aside = s->link_aside;
    }
    memset(s->link, 0, s->parts.nb * sizeof(double));
    pma_link_load(&s->parts.link, lam, s->link);
    pma_factor_interface(&factor, s->link);
}

void pma_subdomain_compliance(pma_subdomain *s, bool twice, const double *lam, double *out)
{
    const pma_operator *op = operator_of(s, twice);
    solve_link(s, op, lam);
    pma_link_gather(&s->parts.link, op->step.al2, s->link, out);
}

/* (R1)  vs = v + h w */
static void extrapolate(double h, size_t n, const pma_state *from, double *vs)
{
    const double *v = from->v, *w = from->w;
    for (size_t i = 0; i < n; i++)
        vs[i] = v[i] + h * w[i];
}

/* y -= r(ut, vs, t1) */
static pma_status ask(pma_subdomain *s, const pma_state *to, double t1)
{
    const pma_restoring *restoring = &s->parts.restoring;
    if (!restoring->function)
        return PMA_OK;
    const pma_status status =
        pma_restoring_subtract(restoring, t1, to->u, s->vs, to->w, &s->code);
    if (status == PMA_OK && s->energy)
        pma_energy_restore(s->energy, restoring->order, pma_restoring_last(restoring));
    return status;
}

/* y -= r(ut) of the springs, and what they dissipate on the way: their work but for (H5) */
static void pull_and_tell(pma_subdomain *s, const pma_state *from, const pma_state *to)
{
    const pma_springs *springs = &s->parts.springs;
    const double *begin = pma_energy_is_first(s->energy) ? s->present.springs : from->springs;
    memcpy(s->before, begin, spring_numbers(&s->parts) * sizeof(double));
    pma_springs_subtract(springs, to->u, from->springs, to->springs, to->w);
    pma_energy_slip(s->energy, pma_springs_work(springs, s->before, to->springs) +
                                   pma_springs_energy(springs, s->before) -
                                   pma_springs_energy(springs, to->springs));
}

/* y -= r(ut, vs, t1) + D_r (vt - vs); vs is then used up                                  (R3) */
static pma_status restore(pma_subdomain *s, const pma_state *from, const pma_state *to, double t1)
{
    const pma_parts *p = &s->parts;
    if (s->energy && p->springs.total > 0)
        pull_and_tell(s, from, to);
    else
        pma_springs_subtract(&p->springs, to->u, from->springs, to->springs, to->w);
    const pma_status status = ask(s, to, t1);
    if (status != PMA_OK || p->D_r.form == PMA_ZERO)
        return status;
    for (size_t i = 0; i < p->n; i++)
        s->vs[i] = to->v[i] - s->vs[i];
    pma_matrix_subtract(&p->D_r, s->vs, to->w);
    return PMA_OK;
}

pma_status pma_subdomain_ask(pma_subdomain *s, double t1, int64_t step)
{
    const pma_status status = pma_load_ask(&s->load, t1, &s->code);
    if (status == PMA_OK && s->energy)
        pma_load_add(&s->load, t1, step, pma_energy_open(s->energy));
    return status;
}

/* (11)  F(t1) - C vt - K ut; lagged: C vs (R4) */
static void add_forces(const pma_subdomain *s, const pma_state *to, double t1, int64_t step,
                       size_t begin, size_t end)
{
    const pma_parts *p = &s->parts;
    pma_load_add_rows(&s->load, t1, step, begin, end, to->w);
    pma_matrix_subtract_rows(&p->C, begin, end, p->lagged ? s->vs : to->v, to->w);
    pma_matrix_subtract_rows(&p->K, begin, end, to->u, to->w);
}

/* The free problem (13) up to its acceleration on the interface, slab by slab: where matrices and
 * factor are narrow, what one stage leaves is still in the cache for the next, and is computed
 * while a sweep waits for its last unknown. */
static pma_status solve_free(pma_subdomain *s, const pma_operator *op, const pma_state *from,
                             const pma_state *to, double *wf_b, double t1, int64_t step)
{
    const pma_parts *p = &s->parts;
    size_t predicted = 0;

    pma_status status = pma_subdomain_ask(s, t1, step);
    if (status != PMA_OK)
        return status;

    /* (R1) */
    if (extrapolates(p))
        extrapolate(op->step.h, p->n, from, s->vs);

    for (size_t begin = 0; begin < p->n && status == PMA_OK; begin += s->slab) {
        const size_t end = least(begin + s->slab, p->n), ahead = least(end + s->reach, p->n);

        /* (5), (6) */
        s->update->predict(&op->step, predicted, ahead, from, to);
        predicted = ahead;

        add_forces(s, to, t1, step, begin, end);

        /* (R3), where there is something to it in all rows at once */
        if (s->slab == p->n)
            status = restore(s, from, to, t1);

        /* (F2), (F3) */
        if (status == PMA_OK)
            pma_factor_open_part(&op->factor, begin, end, to->w, wf_b);
    }
    return status;
}

/* (F3)  vf_b = vt_b + al2 wf_b with wf_b in vf: the step towards own node j is open */
static void settle_free_velocity(pma_subdomain *s, const pma_operator *op, size_t j)
{
    double *vf = free_velocity_at(s, j);
    const double *vt = interface_of(s, pma_subdomain_at(s, j)->v);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] = vt[i] + op->step.al2 * vf[i];
    s->opened = j;
}

pma_status pma_subdomain_open(pma_subdomain *s, size_t j, bool twice, double t1, int64_t step)
{
    const pma_operator *op = operator_of(s, twice);
    const pma_state *from = origin(s, j, twice), *to = pma_subdomain_at(s, j + 1);
    const pma_status status =
        solve_free(s, op, from, to, free_velocity_at(s, j + 1), t1, step);
    if (status == PMA_OK)
        settle_free_velocity(s, op, j + 1);
    return status;
}

int pma_subdomain_code(const pma_subdomain *s)
{
    return s->code;
}

pma_status pma_subdomain_force(pma_subdomain *s, double t, double *F)
{
    const pma_status status = pma_load_ask(&s->load, t, &s->code);
    memset(F, 0, s->parts.n * sizeof(double));
    if (status == PMA_OK)
        pma_load_add(&s->load, t, 0, F);
    return status;
}

pma_status pma_subdomain_restore(pma_subdomain *s, double t, const double *u, const double *v,
                                 double *r)
{
    const pma_parts *p = &s->parts;
    pma_status status = PMA_OK;
    memset(r, 0, p->n * sizeof(double));
    memset(s->before, 0, spring_numbers(p) * sizeof(double));
    pma_springs_subtract(&p->springs, u, s->before, s->before, r);
    if (p->restoring.function)
        status = pma_restoring_subtract(&p->restoring, t, u, v, r, &s->code);
    for (size_t i = 0; i < p->n; i++)
        r[i] = 0.0 - r[i]; /* no negative zeros */
    return status;
}

/* (F4) and (F5) with L^T Lam in s->closing, (8), (9), slab by slab from the last rows on; true when
 * every new value is finite */
static bool sweep_back(const pma_subdomain *s, const pma_operator *op, const pma_state *x)
{
    bool finite = true;
    for (size_t end = s->parts.n, begin; end > 0; end = begin) {
        begin = end > s->slab ? end - s->slab : 0;
        pma_factor_close_part(&op->factor, begin, end, s->closing, x->w);
        finite = s->update->correct(&op->step, begin, end, x) && finite;
    }
    return finite;
}

/* L^T Lam of the step that is closed */
static void load_interface(pma_subdomain *s, const double *lam)
{
    memset(s->closing, 0, s->parts.nb * sizeof(double));
    pma_link_load(&s->parts.link, lam, s->closing);
}

void pma_subdomain_close_energy(pma_subdomain *s, size_t j, bool twice, const double *lam)
{
    const pma_state *x = pma_subdomain_at(s, j);
    if (s->energy && s->parts.ramped)
        pma_energy_know(s->energy, x->u, x->v);
    else if (s->energy)
        pma_energy_close(s->energy, x->u, x->v, lam, twice);
}

pma_status pma_subdomain_close(pma_subdomain *s, size_t j, bool twice, const double *lam)
{
    /* (14), (8), (9)  w = Mbar^-1 (g + L^T Lam) */
    load_interface(s, lam);
    if (!sweep_back(s, operator_of(s, twice), pma_subdomain_at(s, j)))
        return PMA_NOT_FINITE;
    pma_subdomain_close_energy(s, j, twice, lam);
    return PMA_OK;
}

/* ---- the same in ranges of rows ------------------------------------------------------------ */

bool pma_subdomain_divides(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !extrapolates(p) &&
           p->springs.total == 0;
}

void pma_subdomain_predict_rows(const pma_subdomain *s, size_t j, size_t begin, size_t end)
{
    s->update->predict(&s->parts.single.step, begin, end, pma_subdomain_at(s, j),
                       pma_subdomain_at(s, j + 1));
}

void pma_subdomain_force_rows(const pma_subdomain *s, size_t j, double t1, int64_t step,
                              size_t begin, size_t end)
{
    add_forces(s, pma_subdomain_at(s, j + 1), t1, step, begin, end);
}

void pma_subdomain_open_interface(pma_subdomain *s, size_t j)
{
    const pma_operator *op = &s->parts.single;
    const size_t n = s->parts.n;
    pma_factor_open_part(&op->factor, n, n, pma_subdomain_at(s, j + 1)->w,
                         free_velocity_at(s, j + 1));
    settle_free_velocity(s, op, j + 1);
}

void pma_subdomain_close_interface(pma_subdomain *s, size_t j, const double *lam)
{
    const size_t n = s->parts.n;
    load_interface(s, lam);
    pma_factor_close_part(&s->parts.single.factor, n, n, s->closing, pma_subdomain_at(s, j)->w);
}

bool pma_subdomain_correct_rows(const pma_subdomain *s, size_t j, size_t begin, size_t end)
{
    const pma_operator *op = &s->parts.single;
    const pma_state *x = pma_subdomain_at(s, j);
    const size_t inside = least(end, s->parts.n - s->parts.nb);
    pma_factor_close_part(&op->factor, begin, inside, s->closing, x->w);
    return s->update->correct(&op->step, begin, end, x);
}

/* ---- energy ------------------------------------------------------------------------------- */

pma_status pma_subdomain_begin_energy(pma_subdomain *s, pma_matrix M, const double *load,
                                      const double *lam)
{
    const pma_energy_parts parts = {.n = s->parts.n,
                                    .nb = s->parts.nb,
                                    .ahead = s->parts.ramped ? s->parts.substeps : 1,
                                    .M = M,
                                    .K = s->parts.K,
                                    .C = s->parts.C,
                                    .link = s->parts.link};
    pma_energy *energy;
    const pma_status status = pma_energy_create(&parts, &energy);
    if (status != PMA_OK)
        return status;
    s->opened = 0; /* the energy is to be told of every step that is opened */
    pma_energy_begin(energy, s->present.u, s->present.v, load, lam);
    pma_subdomain_end_energy(s);
    s->energy = energy;
    return PMA_OK;
}

void pma_subdomain_end_energy(pma_subdomain *s)
{
    if (!s)
        return;
    pma_energy_destroy(s->energy);
    s->energy = NULL;
}

bool pma_subdomain_has_energy(const pma_subdomain *s)
{
    return s->energy;
}

void pma_subdomain_add_works(pma_subdomain *s, size_t j, const double *lam, const double *dlam)
{
    const double share = (double)j / (double)s->parts.substeps;
    pma_energy_add(s->energy, s->response.u, s->response.v, lam, dlam, share);
}

void pma_subdomain_tell_energy(const pma_subdomain *s, size_t j, double *out)
{
    const pma_state *x = pma_subdomain_at(s, j);
    pma_energy_tell(s->energy, x->u, x->v, out);
    out[PMA_STRAIN] += pma_springs_energy(&s->parts.springs, x->springs);
}

/* ---- macro coupling ------------------------------------------------------------------------- */

void pma_subdomain_set_response(pma_subdomain *s, pma_response response)
{
    s->stored = response;
}

bool pma_subdomain_is_stored(const pma_subdomain *s)
{
    return s->stored.count > 0;
}

void pma_subdomain_hold(pma_subdomain *s, bool twice, const double *lam)
{
    const pma_operator *op = operator_of(s, twice);
    double *vf = free_velocity_at(s, 1);
    solve_link(s, op, lam);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] += op->step.al2 * s->link[i];
}

void pma_subdomain_respond(pma_subdomain *s, size_t j, const double *lam)
{
    const pma_operator *op = &s->parts.single;
    const pma_state *x = &s->response;
    const double share = (double)j / (double)s->parts.substeps;
    double *w_b = interface_of(s, x->w);
    if (j == 1)
        memset(x->u, 0, 4 * s->parts.n * sizeof(double)); /* all four: they lie in a row */

    /* (R1), (5), (6) */
    if (s->parts.lagged)
        extrapolate(op->step.h, s->parts.n, x, s->vs);
    s->update->predict(&op->step, 0, s->parts.n, x, x);

    /* -(C + D_r) vt - (K + K_r) ut; lagged: C vs (R4) */
    pma_matrix_subtract(&s->parts.C, s->parts.lagged ? s->vs : x->v, x->w);
    pma_matrix_subtract(&s->parts.K, x->u, x->w);
    pma_matrix_subtract(&s->parts.D_r, x->v, x->w);
    pma_matrix_subtract(&s->parts.K_r, x->u, x->w);

    /* (12)  w = Mbar^-1 (g + (j / substeps) L_b^T lam), (8), (9) */
    memset(s->link, 0, s->parts.nb * sizeof(double));
    pma_link_load(&s->parts.link, lam, s->link);
    for (size_t i = 0; i < s->parts.nb; i++)
        w_b[i] += share * s->link[i];
    pma_factor_solve(&op->factor, x->w);
    s->update->correct(&op->step, 0, s->parts.n, x);
}

const pma_state *pma_subdomain_response(const pma_subdomain *s)
{
    return &s->response;
}

static void add_to(size_t n, double scale, const double *x, double *y)
{
#pragma omp simd
    for (size_t i = 0; i < n; i++)
        y[i] += scale * x[i];
}

/* x (n) += sum over the conditions of lam times one of the four fields of U, in pieces of x that
 * stay in the cache while U is read */
static void add_stored(const pma_subdomain *s, size_t field, const double *lam, double *x)
{
    enum { PIECE = 512 };
    const size_t n = s->parts.n;
    for (size_t i = 0; i < n; i += PIECE) {
        const size_t size = n - i < PIECE ? n - i : PIECE;
        for (size_t k = 0; k < s->stored.count; k++)
            add_to(size, lam[s->stored.rows[k]], s->stored.values + (4 * k + field) * n + i, x + i);
    }
}

static bool is_finite(size_t n, const double *x)
{
    double zero = 0.0;
#pragma omp simd reduction(+ : zero)
    for (size_t i = 0; i < n; i++)
        zero += 0.0 * x[i];
    return zero == 0.0;
}

pma_status pma_subdomain_add_response(pma_subdomain *s, const double *lam)
{
    const pma_state *x = pma_subdomain_at(s, s->parts.substeps), *r = &s->response;
    double *const total[4] = {x->u, x->v, x->w, x->a};
    const double *const own[4] = {r->u, r->v, r->w, r->a};
    bool finite = true;
    for (size_t field = 0; field < 4; field++) {
        if (pma_subdomain_is_stored(s))
            add_stored(s, field, lam, total[field]);
        else
            add_to(s->parts.n, 1.0, own[field], total[field]);
        finite = is_finite(s->parts.n, total[field]) && finite;
    }
    return finite ? PMA_OK : PMA_NOT_FINITE;
}

pma_status pma_subdomain_ramp(pma_subdomain *s, const double *lam, double *end, double *mean)
{
    const pma_link *L = &s->parts.link;
    const double *v_b = interface_of(s, s->response.v);
    const double share = 1.0 / (double)s->parts.substeps;
    for (size_t j = 1; j <= s->parts.substeps; j++) {
        pma_subdomain_respond(s, j, lam);
        pma_link_gather(L, share, v_b, mean);
    }
    pma_link_gather(L, 1.0, v_b, end);
    return is_finite(4 * s->parts.n, s->response.u) ? PMA_OK : PMA_NOT_FINITE;
}

/* ---- velocities on the interface --------------------------------------------------------- */

void pma_subdomain_free_velocity(const pma_subdomain *s, size_t j, double theta, double scale,
                                 double *jump)
{
    const pma_link *L = &s->parts.link;
    if (theta < 1.0)
        pma_link_gather(L, scale * (1.0 - theta), free_velocity_at(s, j), jump);
    pma_link_gather(L, scale * theta, free_velocity_at(s, j + 1), jump);
}

void pma_subdomain_total_velocity(const pma_subdomain *s, size_t j, double *jump)
{
    const pma_state *x = pma_subdomain_at(s, j);
    pma_link_gather(&s->parts.link, 1.0, interface_of(s, x->v), jump);
}

void pma_subdomain_total_displacement(const pma_subdomain *s, size_t j, double *jump)
{
    const pma_state *x = pma_subdomain_at(s, j);
    pma_link_gather(&s->parts.link, 1.0, interface_of(s, x->u), jump);
}

bool pma_subdomain_free_is_finite(const pma_subdomain *s, size_t j)
{
    const double *vf = free_velocity_at(s, j);
    for (size_t i = 0; i < s->parts.nb; i++) {
        if (!isfinite(vf[i]))
            return false;
    }
    return true;
}

/* ---- start and commit --------------------------------------------------------------------- */

/* vf := v_b - al2 S^-1 L_b^T lam: the free velocity that, with lam, gives this total velocity */
static void store_free_velocity(pma_subdomain *s, bool twice, const double *v, const double *lam,
                                double *vf)
{
    const pma_operator *op = operator_of(s, twice);
    solve_link(s, op, lam);
    const double *v_b = v + (s->parts.n - s->parts.nb);
    for (size_t i = 0; i < s->parts.nb; i++)
        vf[i] = v_b[i] - op->step.al2 * s->link[i];
}

void pma_subdomain_start(pma_subdomain *s, const double *u, const double *v, const double *w,
                         const double *lam)
{
    const size_t bytes = s->parts.n * sizeof(double);
    double *scratch = s->present.a, *springs = s->present.springs;
    memset(springs, 0, spring_numbers(&s->parts) * sizeof(double));
    pma_springs_subtract(&s->parts.springs, u, springs, springs, scratch);
    memcpy(s->present.u, u, bytes);
    memcpy(s->present.v, v, bytes);
    memcpy(s->present.w, w, bytes);
    memcpy(s->present.a, w, bytes);
    s->opened = 0;
    store_free_velocity(s, false, v, lam, s->vf_present); /* (S2) */
}

void pma_subdomain_rebase(pma_subdomain *s, size_t j, const double *lam)
{
    store_free_velocity(s, true, pma_subdomain_at(s, j)->v, lam, free_velocity_at(s, j)); /* (S3) */
}

pma_nodes pma_subdomain_nodes(pma_subdomain *s)
{
    s->opened = 0;
    return (pma_nodes){.present = s->present,
                       .vf = s->vf_present,
                       .previous = s->previous,
                       .vf_previous = s->vf_previous};
}

static void swap_states(pma_state *a, pma_state *b)
{
    const pma_state kept = *a;
    *a = *b;
    *b = kept;
}

static void swap_pointers(double **a, double **b)
{
    double *kept = *a;
    *a = *b;
    *b = kept;
}

void pma_subdomain_commit(pma_subdomain *s)
{
    const size_t last = s->parts.substeps;
    if (s->parts.doubled && last > 1) {
        swap_states(&s->previous, &s->work[slot_of(s, last - 1)]);
        swap_pointers(&s->vf_previous, &s->vf_work[free_velocity_slot(s, last - 1)]);
    } else if (s->parts.doubled) {
        swap_states(&s->previous, &s->present);
        swap_pointers(&s->vf_previous, &s->vf_present);
    }
    swap_states(&s->present, &s->work[slot_of(s, last)]);
    swap_pointers(&s->vf_present, &s->vf_work[free_velocity_slot(s, last)]);
    s->first = slot_of(s, last + 1);
    s->opened = s->opened > last ? s->opened - last : 0;
}

size_t pma_subdomain_opened(const pma_subdomain *s)
{
    return s->opened;
}

void pma_subdomain_discard(pma_subdomain *s)
{
    s->opened = 0;
}
