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

/* ---- a substep ------------------------------------------------------------------------------ */

static void hold(const naive_member *s, const pma_substep *step, const double *lam, level *to)
{
    double wl[MOST];
    naive_link(s->of, step->twice, lam, wl);
    for (size_t i = 0; i < s->of->n; i++)
        to->vf[i] += al2_of(s->of, step->twice) * wl[i];
}

static void open_substep(naive_member *s, const pma_substep *step, const double *lam)
{
    double F[MOST];
    naive_force(s->of, step->t1, (size_t)step->number, F);
    naive_free(s->of, step->twice, step->t1, F, origin(s, step), &s->levels[place(s, step->j + 1)]);
    if (step->is_free_run && s->of->substeps == 1)
        hold(s, step, lam, &s->levels[place(s, step->j + 1)]);
    s->opened = step->j + 1;
}

static pma_status close_substep(naive_member *s, const pma_substep *step, const double *lam)
{
    level *to = &s->levels[place(s, step->j + 1)];
    naive_close(s->of, step->twice, lam, origin(s, step), to);
    for (size_t i = 0; i < s->of->n; i++) {
        if (!isfinite(to->u[i]) || !isfinite(to->v[i]) || !isfinite(to->a[i]))
            return PMA_NOT_FINITE;
    }
    return PMA_OK;
}

static pma_status advance(void *self, const pma_substep *closed, const pma_substep *opened,
                          const double *lam, const pma_workers *workers)
{
    assert(!workers);
    const pma_status status = closed ? close_substep(self, closed, lam) : PMA_OK;
    if (opened && status == PMA_OK)
        open_substep(self, opened, lam);
    return status;
}

static size_t opened(const void *self)
{
    const naive_member *s = self;
    return s->opened;
}

/* ---- values on the interface ---------------------------------------------------------------- */

static const double *link_velocity(naive_member *s, bool twice, const double *lam)
{
    naive_link(s->of, twice, lam, s->added);
    for (size_t i = 0; i < s->of->n; i++)
        s->added[i] *= al2_of(s->of, twice);
    return s->added;
}

static const double *values(void *self, pma_interface_kind kind, size_t j, bool twice,
                            const double *lam)
{
    naive_member *s = self;
    const size_t interior = s->of->n - s->of->nb;
    if (kind == PMA_LINK_VELOCITY)
        return link_velocity(s, twice, lam) + interior;
    const level *x = &s->levels[place(s, j)];
    return (kind == PMA_VELOCITY ? x->v : kind == PMA_DISPLACEMENT ? x->u : x->vf) + interior;
}

/* ---- time levels ---------------------------------------------------------------------------- */

static void record(void *self, pma_recordable what, size_t j, const double *lam,
                   const pma_selection *selection, size_t row)
{
    const naive_member *s = self;
    const size_t count = selection->count;
    const level *x = what == PMA_RESPONSE ? &s->response : &s->levels[place(s, j)];
    (void)lam;
    for (size_t i = 0; i < count; i++) {
        const size_t k = row * count + i;
        selection->u[k] =
            x->u[selection->position[i]] + (what == PMA_MOTION ? 0.0 : selection->u[k]);
        selection->v[k] =
            x->v[selection->position[i]] + (what == PMA_MOTION ? 0.0 : selection->v[k]);
        selection->w[k] =
            x->w[selection->position[i]] + (what == PMA_MOTION ? 0.0 : selection->w[k]);
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

static pma_status prepare(void *self)
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

static void advance_response(void *self, size_t j, const double *lam, const double *dlam)
{
    naive_member *s = self;
    double grown[CONSTRAINTS];
    (void)lam;
    if (j == 1)
        memset(&s->response, 0, sizeof s->response);
    for (size_t row = 0; row < s->of->p; row++)
        grown[row] = dlam[row] * (double)j / (double)s->of->substeps;
    const level from = s->response;
    naive_link_response(s->of, false, grown, &from, &s->response);
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
    .advance = advance,
    .opened = opened,
    .values = values,
    .record = record,
    .commit = commit,
    .discard = discard,
    .rebase = rebase,
};

pma_member naive_member_of(naive_member *s)
{
    const subdomain *x = s->of;
    s->table = IN_TURN;
    if (s->looks_ahead) {
        s->table.prepare = prepare;
        s->table.is_known = is_known;
    }
    if (x->has_responses) {
        s->table.advance_response = advance_response;
        s->table.add_response = add_response;
        s->table.repeats = repeats;
    }
    return (pma_member){.table = &s->table,
                        .self = s,
                        .link = &s->link,
                        .substeps = x->substeps,
                        .h = x->h,
                        .entries = 4 * x->n * x->n,
                        .doubling = pma_doubling_of(x->doubled, false),
                        .forces = x->restored ? PMA_BY_ANY : PMA_NO_FORCES};
}
