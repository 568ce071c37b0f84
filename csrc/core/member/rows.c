/* rows.c - a substep in ranges of rows, for several threads. */
#include "member/inside.h"

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

bool pma_rows_divide(const pma_subdomain *s)
{
    const pma_parts *p = &s->parts;
    return p->single.factor.form == PMA_DIAGONAL && !p->doubled && !s->restores;
}

void pma_rows_predict(pma_subdomain *s, const pma_substep *step, size_t begin, size_t end)
{
    s->update->predict(&s->parts.single.step, begin, end, pma_levels_at(&s->levels, step->j),
                       pma_levels_at(&s->levels, step->j + 1));
}

void pma_rows_open_interface(pma_subdomain *s, const pma_substep *step)
{
    const size_t n = s->parts.n;
    pma_factor_open_part(&s->parts.single.factor, n, n, pma_levels_at(&s->levels, step->j + 1)->w,
                         pma_levels_free_velocity(&s->levels, step->j + 1), s->work);
    pma_substep_free_velocity(s, step);
}

/* (14) on the interface */
void pma_rows_close_interface(pma_subdomain *s, const pma_substep *step, const double *lam)
{
    const size_t n = s->parts.n;
    pma_substep_load_interface(s, lam);
    pma_factor_close_part(&s->parts.single.factor, n, n, s->closing,
                          pma_levels_at(&s->levels, step->j + 1)->w, s->work);
}

/* (14) inside, (8), (9) */
bool pma_rows_correct(pma_subdomain *s, const pma_substep *step, size_t begin, size_t end)
{
    const pma_operator *op = &s->parts.single;
    const pma_state *x = pma_levels_at(&s->levels, step->j + 1);
    const size_t inside = least(end, s->parts.n - s->parts.nb);
    pma_factor_close_part(&op->factor, begin, inside, s->closing, x->w, s->work);
    return s->update->correct(&op->step, begin, end, x);
}
