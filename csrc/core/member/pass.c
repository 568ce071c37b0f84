/* pass.c - several substeps of an explicit subdomain in one pass over K, by a wave over its tiles.
 *
 * Every row takes the operations of substep.c and response.c in their order, so that results are
 * bitwise identical. Predictors are in s->predicted as well, in turn in its two halves: what a
 * neighbour reads is still there when the tile has gone on to its next substep. */
#include <string.h>

#include "member/inside.h"

static size_t most(size_t a, size_t b)
{
    return a > b ? a : b;
}

bool pma_pass_divides(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->responds && pma_rows_divide(s) && !p->shoots && p->substeps > 1 &&
           (p->C.form == PMA_ZERO || p->C.form == PMA_DIAGONAL) && p->D_r.form == PMA_ZERO &&
           p->K_r.form == PMA_ZERO;
}

/* Functions are evaluated for one substep at a time, and energies see all rows of a time level. */
size_t pma_pass_depth(const pma_subdomain *s)
{
    const bool whole = s->energy || s->load.kind == PMA_LOAD_CALLED;
    if (s->tiles.count == 0 || whole)
        return 1;
    return s->tiles.depth < PMA_MOST_PASS ? s->tiles.depth : PMA_MOST_PASS;
}

static double *predicted(const pma_subdomain *s, size_t k)
{
    return s->predicted + k % 2 * s->parts.n;
}

void pma_pass_predict(const pma_subdomain *s, size_t k, size_t begin, size_t end,
                      const double *push, const pma_state *from, const pma_state *to)
{
    const double h = s->parts.single.step.h;
    s->update->predict(&s->parts.single.step, begin, end, from, to);
    for (size_t i = begin; push && i < end; i++) {
        to->u[i] += 0.5 * h * h * push[i];
        to->v[i] += h * push[i];
    }
    memcpy(predicted(s, k) + begin, to->u + begin, (end - begin) * sizeof(double));
}

void pma_pass_add_forces(const pma_subdomain *s, size_t k, size_t begin, size_t end,
                         const pma_state *x)
{
    pma_matrix_subtract_rows(&s->parts.C, begin, end, x->v, x->w);
    pma_matrix_subtract_rows(&s->parts.K, begin, end, predicted(s, k), x->w);
}

bool pma_pass_correct(const pma_subdomain *s, size_t begin, size_t end, const pma_state *x)
{
    const pma_operator *op = &s->parts.single;
    for (size_t i = begin; i < end; i++)
        x->w[i] *= op->factor.inverse[i];
    return s->update->correct(&op->step, begin, end, x);
}

/* ---- free macro run (M2) -------------------------------------------------------------------- */

typedef struct {
    pma_subdomain *s;
    const pma_substep *steps;
    size_t count;
} free_pass;

/* (11), the free velocity (F3), and closed */
static bool finish_free(pma_subdomain *s, const pma_substep *step, size_t k, size_t begin,
                        size_t end)
{
    const pma_parts *p = &s->parts;
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    const double al2 = p->single.step.al2, *inverse = p->single.factor.inverse;
    const size_t interior = p->n - p->nb;
    double *vf = pma_levels_free_velocity(&s->levels, step->j + 1);
    pma_load_add_rows(&s->load, step->t1, step->number, begin, end, x->w);
    pma_pass_add_forces(s, k, begin, end, x);
    for (size_t i = most(begin, interior); i < end; i++) {
        vf[i - interior] = x->v[i] + al2 * (x->w[i] * inverse[i]);
        x->w[i] += s->closing[i - interior];
    }
    return pma_pass_correct(s, begin, end, x);
}

static bool free_stage(void *context, size_t k, size_t begin, size_t end)
{
    const free_pass *pass = context;
    const pma_levels *levels = &pass->s->levels;
    const bool finite = k == 0 || finish_free(pass->s, &pass->steps[k - 1], k - 1, begin, end);
    if (k < pass->count) {
        const size_t j = pass->steps[k].j;
        pma_pass_predict(pass->s, k, begin, end, NULL, pma_levels_at(levels, j),
                         pma_levels_at(levels, j + 1));
    }
    return finite;
}

pma_status pma_pass_run(pma_subdomain *s, const pma_substep *steps, size_t count, const double *lam)
{
    free_pass pass = {s, steps, count};
    pma_substep_load_interface(s, lam);
    const bool finite = pma_tiles_advance(&s->tiles, count, free_stage, &pass);
    s->levels.opened = steps[count - 1].j + 1;
    return finite ? PMA_OK : PMA_NOT_FINITE;
}
