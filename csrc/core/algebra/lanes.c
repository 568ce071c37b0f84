#include "algebra/lanes.h"

#include <string.h>

#include "algebra/loops.h"

enum { PIECE = 256 }; /* rows at a time, so that what is read again stays in the cache */

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* ---- product -------------------------------------------------------------------------------- */

static void subtract_dense(const pma_matrix *A, size_t begin, size_t end, const double *x,
                           double *y)
{
    for (size_t i = begin; i < end; i += PIECE)
        pma_kernel_best()->subtract_lanes(A->values + i, A->n, least(PIECE, end - i), A->n, x,
                                          y + i * PMA_LANES);
}

static void subtract_strips(const pma_strips *S, size_t begin, size_t end, const double *x,
                            double *y)
{
    const pma_kernel *kernel = pma_kernel_best();
    double product[PMA_STRIP_ROWS * PMA_LANES];
    for (size_t s = pma_strips_at(S, begin); s < S->count && (size_t)S->first[s] < end; s++) {
        const size_t first = (size_t)S->first[s], last = (size_t)S->first[s + 1];
        kernel->multiply_strip_lanes(S->values + S->start[s], last - first,
                                     (size_t)(S->ptr[s + 1] - S->ptr[s]), S->index + S->ptr[s], x,
                                     product);
        const size_t to = least(last, end) * PMA_LANES;
        for (size_t k = (first > begin ? first : begin) * PMA_LANES; k < to; k++)
            y[k] -= product[k - first * PMA_LANES];
    }
}

void pma_lanes_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
                             double *y)
{
    if (A->form == PMA_DENSE) {
        subtract_dense(A, begin, end, x, y);
        return;
    }
    if (A->form == PMA_STRIPS) {
        subtract_strips(&A->strips, begin, end, x, y);
        return;
    }
    if (A->form != PMA_ZERO)
        pma_loops_best()->subtract(A, begin, end, x, y);
}

void pma_lanes_subtract(const pma_matrix *A, const double *x, double *y)
{
    pma_lanes_subtract_rows(A, 0, A->n, x, y);
}

/* ---- sweeps, x[0] being unknown `first` ----------------------------------------------------- */

void pma_lanes_eliminate(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    if (first == last || f->form == PMA_DIAGONAL)
        return;
    if (f->form == PMA_DENSE) {
        pma_kernel_best()->eliminate_lanes(f->values + first * f->n + first, f->n, f->n - first,
                                           last - first, x);
    } else if (f->form == PMA_PANELS) {
        pma_panels_eliminate(&f->panels, PMA_LANES, first, last, x, work);
    } else {
        pma_loops_best()->eliminate(f, first, last, x);
    }
}

void pma_lanes_substitute(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    if (first == last)
        return;
    if (f->form == PMA_DIAGONAL) {
        pma_loops_best()->scale(f, first, last, x);
    } else if (f->form == PMA_DENSE) {
        pma_loops_best()->scale(f, first, last, x);
        pma_kernel_best()->substitute_lanes(f->values + f->Q + first * f->n + first, f->n,
                                            f->n - first, last - first, x);
    } else if (f->form == PMA_PANELS) {
        pma_panels_substitute(&f->panels, f->inverse, PMA_LANES, first, last, x, work);
    } else {
        pma_loops_best()->substitute(f, first, last, x);
    }
}

/* ---- as forms ------------------------------------------------------------------------------- */

pma_matrix pma_lanes_matrix(const pma_matrix *each)
{
    const pma_form form = each->form == PMA_ZERO ? PMA_ZERO : PMA_IN_LANES;
    return (pma_matrix){.form = form, .n = each->n * PMA_LANES, .each = each};
}

pma_link pma_lanes_link(const pma_link *each)
{
    return (pma_link){.p = each->p * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

pma_factor pma_lanes_factor(const pma_factor *each)
{
    return (pma_factor){
        .form = PMA_IN_LANES, .n = each->n * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

void pma_lanes_interface(const pma_factor *f, double *xb, double *work)
{
    const pma_factor lanes = pma_lanes_factor(f);
    pma_factor_interface(&lanes, xb, work);
}

void pma_lanes_open(const pma_factor *f, double *x, double *xb, double *work)
{
    const pma_factor lanes = pma_lanes_factor(f);
    pma_factor_open(&lanes, x, xb, work);
}

void pma_lanes_close(const pma_factor *f, const double *fb, double *x, double *work)
{
    const pma_factor lanes = pma_lanes_factor(f);
    pma_factor_close(&lanes, fb, x, work);
}

void pma_lanes_solve(const pma_factor *f, double *x, double *work)
{
    const pma_factor lanes = pma_lanes_factor(f);
    pma_factor_solve(&lanes, x, work);
}

/* ---- links ---------------------------------------------------------------------------------- */

void pma_lanes_add(const pma_link *L, const double *lam, double *xb)
{
    pma_loops_best()->add(L, lam, xb);
}

void pma_lanes_gather(const pma_link *L, double scale, const double *xb, double *jump)
{
    pma_loops_best()->gather(L, scale, xb, jump);
}

/* ---- apart ---------------------------------------------------------------------------------- */

void pma_lanes_split(size_t n, const double *x, size_t count, double *const *out)
{
    for (size_t i = 0; i < n; i++) {
        for (size_t l = 0; l < count; l++)
            out[l][i] = x[i * PMA_LANES + l];
    }
}
