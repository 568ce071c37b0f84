#include "observe/energy.h"

#include <assert.h>
#include <string.h>

#include "memory.h"
#include "object.h"
#include "observe/ring.h"

/* The displacement at a time level, the forces that act there, and the works up to it. */
typedef struct {
    double *u, *load, *damping; /* n each: u, F, C v + r and what else is dissipated */
    double *pull;               /* nb: L_b^T Lam */
    double *springs;            /* what they remember */
    struct {
        double dissipated, external, interface, contact;
    } works;
    double potential; /* of internal forces; known at macro time levels */
} level;

struct pma_energy {
    pma_energy_parts parts;
    level *levels;
    pma_ring ring;         /* of them */
    bool begun;            /* a macro step has been committed since the beginning */
    double *start_damping; /* n: C v + f at the beginning */
    double *start_load;    /* n: F at the beginning, without what depends on the motion */
    bool knows_functions;  /* both with what restoring functions gave there */
    double start_potential;
    double start_stored;    /* T + U there, without that potential */
    bool has_new_chain;     /* (B14) holds in this macro step, at time level 1 */
    double *first_velocity; /* n: at time level 1, of a double step that is completed later */
    bool conserves;         /* E* is asked for, */
    double weight;          /* ... with this multiple of K beside M */
    double *product;        /* n: scratch */
    double *numbers;        /* of all levels */
};

/* ---- making --------------------------------------------------------------------------------- */

/* u, load, damping, pull and springs of a level, which are one array */
static size_t level_size(const pma_energy_parts *parts)
{
    return 3 * parts->n + parts->nb + pma_springs_numbers(parts->springs);
}

static level take_level(const pma_energy *e, size_t number)
{
    const size_t n = e->parts.n;
    double *x = e->numbers + number * level_size(&e->parts);
    return (level){.u = x,
                   .load = x + n,
                   .damping = x + 2 * n,
                   .pull = x + 3 * n,
                   .springs = x + 3 * n + e->parts.nb};
}

pma_status pma_energy_create(const pma_energy_parts *parts, pma_energy **out)
{
    const size_t n = parts->n;
    const pma_ring ring = pma_ring_of(parts->substeps, parts->doubled, parts->has_responses);
    const size_t levels = ring.kept + 2;
    const pma_array arrays[] = {
        PMA_ARRAY(pma_energy, levels, levels),
        PMA_ARRAY(pma_energy, ring.at, levels),
        PMA_ARRAY(pma_energy, start_damping, n),
        PMA_ARRAY(pma_energy, start_load, n),
        PMA_ARRAY(pma_energy, first_velocity, parts->doubled && parts->has_responses ? n : 0),
        PMA_ARRAY(pma_energy, product, n),
        {offsetof(pma_energy, numbers), levels, level_size(parts) * sizeof(double)},
        {0}};
    *out = NULL;
    if (parts->M.n != n || parts->K.n != n || parts->C.n != n || parts->nb > n ||
        parts->link.nb != parts->nb || (parts->skew.form != PMA_ZERO && parts->skew.n != n))
        return PMA_BAD_SIZE;
    PMA_TRY(pma_matrix_check(&parts->M));
    PMA_TRY(pma_matrix_check(&parts->skew));
    pma_energy *e = pma_object_create(sizeof *e, arrays);
    if (!e)
        return PMA_NO_MEMORY;
    e->parts = *parts;
    for (size_t k = 0; k < levels; k++)
        e->levels[k] = take_level(e, k);
    pma_ring_fill(&e->ring, &ring, e->levels, sizeof *e->levels);
    *out = e;
    return PMA_OK;
}

void pma_energy_destroy(pma_energy *e)
{
    pma_memory_release(e);
}

/* ---- works ---------------------------------------------------------------------------------- */

/* Where the works of the substep to time level j + 1 are counted from. */
static const level *origin(const pma_energy *e, size_t j, bool twice)
{
    return twice && (j > 0 || e->begun) ? pma_ring_before(&e->ring, j) : pma_ring_at(&e->ring, j);
}

static void add(size_t n, const double *x, double *y)
{
    for (size_t i = 0; i < n; i++)
        y[i] += x[i];
}

/* r of the substep closed last, and the external load in it. Where they are not known at the
 * beginning, since they are evaluated once per substep, they count there as those of the first. */
static void take_restoring(pma_energy *e, const pma_substep *step, level *to)
{
    const pma_restoring *restoring = e->parts.restoring;
    if (!restoring->function)
        return;
    const double *r = pma_restoring_last(restoring), *f = restoring->load;
    double *load = e->product;
    for (size_t i = 0; i < e->parts.n; i++) {
        const size_t k = (size_t)restoring->order[i];
        load[i] = f ? f[k] : 0.0;
        to->damping[i] = f ? r[k] + f[k] : r[k];
    }
    add(e->parts.n, load, to->load);
    if (step->j > 0 || e->begun || e->knows_functions)
        return;
    level *present = pma_ring_at(&e->ring, 0);
    memcpy(present->damping, e->start_damping, e->parts.n * sizeof(double));
    memcpy(present->load, e->start_load, e->parts.n * sizeof(double));
    add(e->parts.n, to->damping, present->damping);
    add(e->parts.n, load, present->load);
}

/* f and its potential, as evaluated last */
static void take_internal(const pma_energy *e, level *to)
{
    if (e->parts.internal)
        add(e->parts.n, e->parts.internal, to->damping);
    to->potential = e->parts.potential ? *e->parts.potential : 0.0;
}

/* q += C v + (K - K^T) / 2 u */
static void add_damping(pma_energy *e, const pma_state *x, double *q)
{
    pma_matrix_multiply(&e->parts.C, x->v, e->product);
    add(e->parts.n, e->product, q);
    if (e->parts.skew.form == PMA_ZERO)
        return;
    pma_matrix_multiply(&e->parts.skew, x->u, e->product);
    add(e->parts.n, e->product, q);
}

/* u, springs, F and C v + r + f at the end of a substep; L_b^T Lam is not known in a free run */
static void fill_level(pma_energy *e, const pma_substep *step, const pma_state *x, level *to)
{
    memcpy(to->u, x->u, e->parts.n * sizeof(double));
    memcpy(to->springs, x->springs, pma_springs_numbers(e->parts.springs) * sizeof(double));
    memset(to->load, 0, e->parts.n * sizeof(double));
    memset(to->damping, 0, e->parts.n * sizeof(double));
    pma_load_add(e->parts.load, step->t1, step->number, to->load);
    take_restoring(e, step, to);
    take_internal(e, to);
    add_damping(e, x, to->damping);
}

static void fill_pull(const pma_energy *e, const double *lam, level *to)
{
    pma_link_load(&e->parts.link, lam, to->pull);
}

/* (B2)  (u1 - u0) . (q0 + q1) / 2 */
static double work(size_t n, const double *u0, const double *u1, const double *q0, const double *q1)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += (u1[i] - u0[i]) * (q0[i] + q1[i]);
    return 0.5 * sum;
}

/* What the springs dissipate: their work but for (H5) */
static double slip(const pma_springs *springs, const double *from, const double *to)
{
    return pma_springs_work(springs, from, to) + pma_springs_energy(springs, from) -
           pma_springs_energy(springs, to);
}

/* (B3)  W1 = W0 + dW */
static void sum_up(const pma_energy *e, const level *from, level *to)
{
    const size_t n = e->parts.n, inner = n - e->parts.nb;
    to->works.dissipated =
        from->works.dissipated + work(n, from->u, to->u, from->damping, to->damping);
    if (e->parts.springs->total > 0)
        to->works.dissipated += slip(e->parts.springs, from->springs, to->springs);
    to->works.external = from->works.external + work(n, from->u, to->u, from->load, to->load);
    to->works.interface = from->works.interface +
                          work(e->parts.nb, from->u + inner, to->u + inner, from->pull, to->pull);
    to->works.contact = from->works.contact;
}

/* T + U without the potential of internal forces, which the work of these takes off again  (B6) */
static double stored(pma_energy *e, const level *at, const double *v)
{
    return 0.5 * pma_matrix_square(&e->parts.M, v, e->product) +
           0.5 * pma_matrix_square(&e->parts.K, at->u, e->product) +
           pma_springs_energy(e->parts.springs, at->springs);
}

/* (B14)  Is this the double step whose chain has no sums? */
static bool begins_chain(const pma_energy *e, bool twice, size_t j)
{
    return twice && j == 1 && !e->begun && e->parts.implicit;
}

/* W^interface such that (B4) is zero at the first level of the chain, with velocity v */
static void begin_chain(pma_energy *e, level *to, const double *v)
{
    e->has_new_chain = true;
    to->works.interface = stored(e, to, v) - e->start_stored + to->works.dissipated -
                          to->works.external - to->works.contact;
}

void pma_energy_begin(pma_energy *e, const pma_state *x, const double *load, const double *lam,
                      const double *functions)
{
    const size_t n = e->parts.n;
    level *at = pma_ring_at(&e->ring, 0);
    e->begun = false;
    e->has_new_chain = false;
    e->knows_functions = functions;
    memcpy(at->u, x->u, e->parts.n * sizeof(double));
    memcpy(at->springs, x->springs, pma_springs_numbers(e->parts.springs) * sizeof(double));
    memcpy(at->load, load, e->parts.n * sizeof(double));
    memset(at->damping, 0, e->parts.n * sizeof(double));
    take_internal(e, at);
    add_damping(e, x, at->damping);
    memcpy(e->start_damping, at->damping, e->parts.n * sizeof(double));
    memcpy(e->start_load, load, e->parts.n * sizeof(double));
    for (size_t i = 0; functions && i < n; i++) {
        at->damping[i] += functions[i];
        at->load[i] += functions[n + i];
    }
    e->start_potential = at->potential;
    e->start_stored = stored(e, at, x->v);
    fill_pull(e, lam, at);
    memset(&at->works, 0, sizeof at->works);
}

const pma_energy_parts *pma_energy_get_parts(const pma_energy *e)
{
    return &e->parts;
}

static void copy_level(const pma_energy *e, const level *from, level *to)
{
    memcpy(to->u, from->u, level_size(&e->parts) * sizeof(double));
    to->works = from->works;
    to->potential = from->potential;
}

void pma_energy_follow(pma_energy *e, const pma_energy *from)
{
    copy_level(e, pma_ring_at(&from->ring, 0), pma_ring_at(&e->ring, 0));
    copy_level(e, pma_ring_before(&from->ring, 0), pma_ring_before(&e->ring, 0));
    memcpy(e->start_damping, from->start_damping, e->parts.n * sizeof(double));
    memcpy(e->start_load, from->start_load, e->parts.n * sizeof(double));
    e->start_potential = from->start_potential;
    e->start_stored = from->start_stored;
    e->knows_functions = from->knows_functions;
    e->begun = from->begun;
}

/* ---- what a later run goes on with ----------------------------------------------------------- */

enum { SUMS = 5 };

size_t pma_energy_size(const pma_energy *e)
{
    return 2 * (level_size(&e->parts) + SUMS);
}

bool pma_energy_keep(const pma_energy *e, double *out)
{
    const level *const levels[] = {pma_ring_at(&e->ring, 0), pma_ring_before(&e->ring, 0)};
    const size_t size = level_size(&e->parts);
    for (size_t k = 0; k < 2 && e->begun; k++) {
        const level *at = levels[k];
        const double sums[SUMS] = {at->works.dissipated, at->works.external, at->works.interface,
                                   at->works.contact, at->potential};
        memcpy(out, at->u, size * sizeof(double));
        memcpy(out + size, sums, sizeof sums);
        out += size + SUMS;
    }
    return e->begun;
}

void pma_energy_resume(pma_energy *e, const double *in)
{
    level *const levels[] = {pma_ring_at(&e->ring, 0), pma_ring_before(&e->ring, 0)};
    const size_t size = level_size(&e->parts);
    const double *zero = in + size; /* the works at the present */
    for (size_t k = 0; k < 2; k++) {
        level *at = levels[k];
        const double *sums = in + size;
        memcpy(at->u, in, size * sizeof(double));
        at->works.dissipated = sums[0] - zero[0];
        at->works.external = sums[1] - zero[1];
        at->works.interface = sums[2] - zero[2];
        at->works.contact = sums[3] - zero[3];
        at->potential = sums[4];
        in += size + SUMS;
    }
    e->start_potential = levels[0]->potential;
    e->begun = true;
}

/* ---- works of substeps ----------------------------------------------------------------------- */

void pma_energy_close(pma_energy *e, const pma_substep *step, const pma_state *x, const double *lam)
{
    assert(lam || e->parts.link.p == 0);
    level *to = pma_ring_at(&e->ring, step->j + 1);
    fill_level(e, step, x, to);
    fill_pull(e, lam, to);
    sum_up(e, origin(e, step->j, step->twice), to);
    if (begins_chain(e, step->twice, step->j + 1))
        begin_chain(e, to, x->v);
}

void pma_energy_close_free(pma_energy *e, const pma_substep *step, const pma_state *x)
{
    fill_level(e, step, x, pma_ring_at(&e->ring, step->j + 1));
    if (begins_chain(e, step->twice, step->j + 1))
        memcpy(e->first_velocity, x->v, e->parts.n * sizeof(double));
}

void pma_energy_advance_response(pma_energy *e, size_t j, bool twice, const pma_state *r,
                                 const double *lam, const double *dlam)
{
    assert(j >= 1 && e->parts.has_responses);
    const double share = (double)j / (double)e->parts.substeps;
    level *to = pma_ring_at(&e->ring, j);
    add(e->parts.n, r->u, to->u);
    add_damping(e, r, to->damping);

    /* L_b^T (lam + share dlam) */
    fill_pull(e, dlam, to);
    for (size_t i = 0; i < e->parts.nb; i++)
        to->pull[i] *= share;
    pma_link_add(&e->parts.link, lam, to->pull);
    sum_up(e, origin(e, j - 1, twice), to);
    if (begins_chain(e, twice, j)) {
        add(e->parts.n, r->v, e->first_velocity);
        begin_chain(e, to, e->first_velocity);
    }
}

void pma_energy_hold(pma_energy *e, bool twice, const double *lam)
{
    assert(!twice || e->parts.doubled);
    fill_pull(e, lam, twice ? pma_ring_before(&e->ring, 0) : pma_ring_at(&e->ring, 0));
}

void pma_energy_add_work(pma_energy *e, size_t j, double work)
{
    level *at = pma_ring_at(&e->ring, j);
    at->works.contact += work;
    if (e->has_new_chain && j == 1)
        at->works.interface -= work;
}

void pma_energy_commit(pma_energy *e)
{
    pma_ring_commit(&e->ring);
    e->begun = true;
    e->has_new_chain = false;
}

void pma_energy_conserve(pma_energy *e, double weight)
{
    e->conserves = true;
    e->weight = weight;
}

/* (M9) */
static double conserved(pma_energy *e, const pma_state *x)
{
    const pma_matrix *M = &e->parts.M, *K = &e->parts.K;
    double sum = 0.5 * pma_matrix_square(M, x->w, e->product);
    sum += 0.5 * pma_matrix_square(K, x->v, e->product);
    if (e->weight != 0.0)
        sum += e->weight * (0.5 * pma_matrix_square(K, x->w, e->product));
    return sum;
}

/* F . u */
static double potential_of_load(const pma_energy *e, const level *at)
{
    double sum = 0.0;
    for (size_t i = 0; i < e->parts.n; i++)
        sum += at->load[i] * at->u[i];
    return sum;
}

void pma_energy_at(pma_energy *e, size_t j, const pma_state *x, double *out)
{
    const level *at = pma_ring_at(&e->ring, j);
    out[PMA_KINETIC] = 0.5 * pma_matrix_square(&e->parts.M, x->v, e->product); /* (B1) */
    out[PMA_STRAIN] = 0.5 * pma_matrix_square(&e->parts.K, x->u, e->product);
    out[PMA_STRAIN] += pma_springs_energy(e->parts.springs, x->springs) + at->potential;
    out[PMA_DISSIPATED] = at->works.dissipated - (at->potential - e->start_potential);
    out[PMA_EXTERNAL] = at->works.external;
    out[PMA_INTERFACE_WORK] = at->works.interface;
    out[PMA_CONTACT_WORK] = at->works.contact;
    out[PMA_CONSERVED] = e->conserves
                             ? conserved(e, x)
                             : out[PMA_KINETIC] + out[PMA_STRAIN] - potential_of_load(e, at);
}
