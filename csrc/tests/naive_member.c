/* naive_member.c - see naive_member.h. */
#include "naive_member.h"

#include <assert.h>
#include <math.h>
#include <string.h>

void naive_member_start(naive_member *s, const level *first)
{
    s->present = s->opened = 0;
    s->levels[0] = *first;
}

/* Where time level j is, counted from the present. */
static size_t place(const naive_member *s, size_t j)
{
    assert(s->present + j < LEVELS + AHEAD);
    return s->present + j;
}

/* The level from which a substep starts. */
static const level *origin(const naive_member *s, const pma_substep *step)
{
    return &s->levels[place(s, step->j) - step->twice];
}

/* sum (p) += scale L x */
static void gather(const part *x, double scale, const double *values, double *sum)
{
    for (size_t row = 0; row < x->p; row++)
        sum[row] += scale * constrained(x, row, values);
}

/* ---- a substep ------------------------------------------------------------------------------ */

static pma_status open_substep(void *self, const pma_substep *step)
{
    naive_member *s = self;
    double F[MOST];
    naive_force(s->of, step->t1, (size_t)step->number, F);
    naive_free(s->of, step->twice, step->t1, F, origin(s, step), &s->levels[place(s, step->j + 1)]);
    s->opened = step->j + 1;
    return PMA_OK;
}

static pma_status close_substep(void *self, const pma_substep *step, const double *lam)
{
    naive_member *s = self;
    level *to = &s->levels[place(s, step->j + 1)];
    naive_close(s->of, step->twice, lam, origin(s, step), to);
    for (size_t i = 0; i < s->of->n; i++) {
        if (!isfinite(to->u[i]) || !isfinite(to->v[i]) || !isfinite(to->a[i]))
            return PMA_NOT_FINITE;
    }
    return PMA_OK;
}

static size_t opened(const void *self)
{
    const naive_member *s = self;
    return s->opened;
}

/* ---- values on the interface ---------------------------------------------------------------- */

static void compliance(void *self, bool twice, const double *lam, double *sum)
{
    const naive_member *s = self;
    double wl[MOST];
    naive_link(s->of, twice, lam, wl);
    gather(s->of, al2_of(s->of, twice), wl, sum);
}

static void free_velocity(const void *self, size_t j, double theta, double scale, double *sum)
{
    const naive_member *s = self;
    gather(s->of, scale * (1.0 - theta), s->levels[place(s, j)].vf, sum);
    gather(s->of, scale * theta, s->levels[place(s, j + 1)].vf, sum);
}

static void velocity(const void *self, size_t j, double *sum)
{
    const naive_member *s = self;
    gather(s->of, 1.0, s->levels[place(s, j)].v, sum);
}

static void displacement(const void *self, size_t j, double *sum)
{
    const naive_member *s = self;
    gather(s->of, 1.0, s->levels[place(s, j)].u, sum);
}

static bool is_finite(const void *self, size_t j)
{
    const naive_member *s = self;
    for (size_t i = 0; i < s->of->n; i++) {
        if (!isfinite(s->levels[place(s, j)].vf[i]))
            return false;
    }
    return true;
}

/* ---- time levels ---------------------------------------------------------------------------- */

static void record(const void *self, size_t j, const pma_selection *selection, size_t row)
{
    const naive_member *s = self;
    const level *x = &s->levels[place(s, j)];
    for (size_t i = 0; i < selection->count; i++) {
        selection->u[row * selection->count + i] = x->u[selection->position[i]];
        selection->v[row * selection->count + i] = x->v[selection->position[i]];
        selection->w[row * selection->count + i] = x->w[selection->position[i]];
    }
}

static void commit(void *self)
{
    naive_member *s = self;
    const size_t substeps = s->of->substeps;
    s->present += substeps;
    s->opened = s->opened > substeps ? s->opened - substeps : 0;
}

static void discard(void *self)
{
    naive_member *s = self;
    s->opened = 0;
}

static void rebase(void *self, size_t j, const double *lam)
{
    naive_member *s = self;
    naive_store(s->of, true, lam, &s->levels[place(s, j)]);
}

/* ---- look-ahead: there is room for all time levels ------------------------------------------ */

static pma_status look_ahead(void *self)
{
    (void)self;
    return PMA_OK;
}

static bool is_known(const void *self, const pma_substep *step)
{
    const naive_member *s = self;
    const pma_load *load = &s->of->load;
    return load->kind != PMA_LOAD_TABLE || step->number < (int64_t)load->rows;
}

/* ---- macro coupling ------------------------------------------------------------------------- */

static void hold(void *self, const pma_substep *step, const double *lam)
{
    naive_member *s = self;
    level *to = &s->levels[place(s, step->j + 1)];
    double wl[MOST];
    naive_link(s->of, step->twice, lam, wl);
    for (size_t i = 0; i < s->of->n; i++)
        to->vf[i] += al2_of(s->of, step->twice) * wl[i];
}

static void respond(void *self, size_t j, const double *lam, const double *dlam)
{
    naive_member *s = self;
    double grown[CONSTRAINTS];
    (void)lam;
    if (j == 1)
        memset(&s->response, 0, sizeof s->response);
    for (size_t row = 0; row < s->of->p; row++)
        grown[row] = dlam[row] * (double)j / (double)s->of->substeps;
    const level from = s->response;
    naive_respond(s->of, false, grown, &from, &s->response);
}

static void record_response(const void *self, const pma_selection *selection, size_t row)
{
    const naive_member *s = self;
    const level *x = &s->response;
    for (size_t i = 0; i < selection->count; i++) {
        selection->u[row * selection->count + i] += x->u[selection->position[i]];
        selection->v[row * selection->count + i] += x->v[selection->position[i]];
        selection->w[row * selection->count + i] += x->w[selection->position[i]];
    }
}

static pma_status add_response(void *self, const double *dlam)
{
    naive_member *s = self;
    (void)dlam;
    naive_add(s->of, &s->response, &s->levels[place(s, s->of->substeps)]);
    return PMA_OK;
}

static size_t repeats(const void *self, bool recorded)
{
    const naive_member *s = self;
    (void)recorded;
    return s->of->substeps;
}

/* ---- the member ----------------------------------------------------------------------------- */

static const pma_member_table IN_TURN = {
    .open = open_substep,
    .close = close_substep,
    .opened = opened,
    .compliance = compliance,
    .free_velocity = free_velocity,
    .velocity = velocity,
    .displacement = displacement,
    .is_finite = is_finite,
    .record = record,
    .commit = commit,
    .discard = discard,
    .rebase = rebase,
    .hold = hold,
    .respond = respond,
    .record_response = record_response,
    .add_response = add_response,
    .repeats = repeats,
};

pma_member naive_member_of(naive_member *s)
{
    const part *x = s->of;
    s->table = IN_TURN;
    if (s->looks_ahead) {
        s->table.look_ahead = look_ahead;
        s->table.is_known = is_known;
    }
    return (pma_member){.table = &s->table,
                        .self = s,
                        .p = x->p,
                        .n = x->n,
                        .substeps = x->substeps,
                        .h = x->h,
                        .entries = 4 * x->n * x->n,
                        .doubled = x->doubled,
                        .evaluates = x->restored,
                        .responds = x->responds};
}
