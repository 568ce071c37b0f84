#include "member/energy.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* A double step ends two nodes after it began, and may be opened one node before that. */
enum { KEPT = 4 };

/* The displacement of a node, the forces that act there, and the works up to it. */
typedef struct {
    double *u, *load, *damping; /* n each: u, F, C v + r */
    double *pull;               /* nb: L_b^T Lam */
    double slip;                /* dissipated by springs in the step that ends here */
    double dissipated, external, interface;
} energy_node;

struct pma_energy {
    pma_energy_parts parts;
    size_t kept;
    energy_node *nodes;      /* node k, counted from the beginning, in nodes[k % kept] */
    size_t opened, closed;
    double *product;         /* n: scratch */
    double *block;
};

/* ---- making ----------------------------------------------------------------------------- */

static void lay_out(pma_energy *e)
{
    const size_t n = e->parts.n, nb = e->parts.nb;
    double *next = e->block;
    for (size_t k = 0; k < e->kept; k++) {
        energy_node *at = &e->nodes[k];
        at->u = next;
        at->load = next + n;
        at->damping = next + 2 * n;
        at->pull = next + 3 * n;
        next += 3 * n + nb;
    }
    e->product = next;
}

pma_status pma_energy_create(const pma_energy_parts *parts, pma_energy **out)
{
    *out = NULL;
    if (parts->M.n != parts->n || parts->K.n != parts->n || parts->C.n != parts->n ||
        parts->nb > parts->n || parts->link.nb != parts->nb)
        return PMA_BAD_SIZE;
    const pma_status status = pma_matrix_check(&parts->M);
    if (status != PMA_OK)
        return status;
    const size_t kept = parts->ahead + KEPT;
    /* at most (4 * kept + 1) n doubles: no overflow below this n */
    if (parts->n > SIZE_MAX / (8 * kept * sizeof(double)))
        return PMA_NO_MEMORY;
    pma_energy *e = calloc(1, sizeof *e);
    if (!e)
        return PMA_NO_MEMORY;
    e->parts = *parts;
    e->kept = kept;
    e->nodes = calloc(kept, sizeof *e->nodes);
    e->block = calloc(kept * (3 * parts->n + parts->nb) + parts->n, sizeof(double));
    if (!e->nodes || !e->block) {
        pma_energy_destroy(e);
        return PMA_NO_MEMORY;
    }
    lay_out(e);
    *out = e;
    return PMA_OK;
}

void pma_energy_destroy(pma_energy *e)
{
    if (e) {
        free(e->nodes);
        free(e->block);
    }
    free(e);
}

/* ---- works ------------------------------------------------------------------------------ */

static energy_node *node_at(pma_energy *e, size_t k)
{
    return &e->nodes[k % e->kept];
}

/* out (n) := A x, but for the sign of its zeros */
static void multiply(const pma_matrix *A, const double *x, double *out)
{
    memset(out, 0, A->n * sizeof(double));
    pma_matrix_subtract(A, x, out);
    for (size_t i = 0; i < A->n; i++)
        out[i] = -out[i];
}

static void add(size_t n, const double *x, double *y)
{
    for (size_t i = 0; i < n; i++)
        y[i] += x[i];
}

/* u, C v and L_b^T Lam of a node; F and r were told when the step towards it was opened */
static void fill_node(const pma_energy *e, energy_node *at, const double *u, const double *v,
                      const double *lam)
{
    memcpy(at->u, u, e->parts.n * sizeof(double));
    multiply(&e->parts.C, v, e->product);
    add(e->parts.n, e->product, at->damping);
    memset(at->pull, 0, e->parts.nb * sizeof(double));
    pma_link_load(&e->parts.link, lam, at->pull);
}

/* (B2)  (u1 - u0) . (q0 + q1) / 2 */
static double work(size_t n, const double *u0, const double *u1, const double *q0,
                   const double *q1)
{
    double sum = 0.0;
    for (size_t i = 0; i < n; i++)
        sum += (u1[i] - u0[i]) * (q0[i] + q1[i]);
    return 0.5 * sum;
}

/* x . A x / 2 */
static double half_square(pma_energy *e, const pma_matrix *A, const double *x)
{
    double sum = 0.0;
    multiply(A, x, e->product);
    for (size_t i = 0; i < A->n; i++)
        sum += x[i] * e->product[i];
    return 0.5 * sum;
}

void pma_energy_begin(pma_energy *e, const double *u, const double *v, const double *load,
                      const double *lam)
{
    energy_node *at = node_at(e, 0);
    e->opened = 0;
    e->closed = 0;
    memcpy(at->load, load, e->parts.n * sizeof(double));
    memset(at->damping, 0, e->parts.n * sizeof(double));
    fill_node(e, at, u, v, lam);
    at->dissipated = 0.0;
    at->external = 0.0;
    at->interface = 0.0;
}

double *pma_energy_open(pma_energy *e)
{
    energy_node *to = node_at(e, ++e->opened);
    memset(to->load, 0, e->parts.n * sizeof(double));
    memset(to->damping, 0, e->parts.n * sizeof(double));
    to->slip = 0.0;
    return to->load;
}

void pma_energy_slip(pma_energy *e, double dissipated)
{
    node_at(e, e->opened)->slip = dissipated;
}

bool pma_energy_is_first(const pma_energy *e)
{
    return e->opened == 1;
}

void pma_energy_restore(pma_energy *e, const int64_t *order, const double *r)
{
    double *to = node_at(e, e->opened)->damping, *first = node_at(e, 0)->damping;
    for (size_t i = 0; i < e->parts.n; i++)
        to[i] = r[order[i]];
    if (e->opened == 1)
        add(e->parts.n, to, first);
}

/* (B3)  W1 = W0 + dW, of the step to the node that is closed next */
static void close_node(pma_energy *e, bool twice)
{
    const size_t n = e->parts.n, inner = n - e->parts.nb;
    const energy_node *from = node_at(e, e->closed - (twice && e->closed > 0 ? 1 : 0));
    energy_node *to = node_at(e, ++e->closed);
    to->dissipated = from->dissipated + work(n, from->u, to->u, from->damping, to->damping);
    to->dissipated += to->slip;
    to->external = from->external + work(n, from->u, to->u, from->load, to->load);
    to->interface = from->interface + work(e->parts.nb, from->u + inner, to->u + inner, from->pull,
                                           to->pull);
}

void pma_energy_close(pma_energy *e, const double *u, const double *v, const double *lam,
                      bool twice)
{
    fill_node(e, node_at(e, e->closed + 1), u, v, lam);
    close_node(e, twice);
}

void pma_energy_know(pma_energy *e, const double *u, const double *v)
{
    energy_node *at = node_at(e, e->opened);
    memcpy(at->u, u, e->parts.n * sizeof(double));
    multiply(&e->parts.C, v, e->product);
    add(e->parts.n, e->product, at->damping);
}

void pma_energy_add(pma_energy *e, const double *u, const double *v, const double *lam,
                    const double *dlam, double share)
{
    energy_node *to = node_at(e, e->closed + 1);
    add(e->parts.n, u, to->u);
    multiply(&e->parts.C, v, e->product);
    add(e->parts.n, e->product, to->damping);

    /* L_b^T (lam + share dlam) */
    memset(to->pull, 0, e->parts.nb * sizeof(double));
    pma_link_load(&e->parts.link, dlam, to->pull);
    for (size_t i = 0; i < e->parts.nb; i++)
        to->pull[i] *= share;
    pma_link_load(&e->parts.link, lam, to->pull);
    close_node(e, false);
}

void pma_energy_tell(pma_energy *e, const double *u, const double *v, double *out)
{
    const energy_node *at = node_at(e, e->closed);
    out[PMA_KINETIC] = half_square(e, &e->parts.M, v); /* (B1) */
    out[PMA_STRAIN] = half_square(e, &e->parts.K, u);
    out[PMA_DISSIPATED] = at->dissipated;
    out[PMA_EXTERNAL] = at->external;
    out[PMA_INTERFACE_WORK] = at->interface;
}
