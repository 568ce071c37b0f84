#include "algebra/block.h"

#include <string.h>

/* Constraints taken together, so that what belongs to them stays in the cache. */
enum { TOGETHER = 128 };

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* X (nb x count), D^-1 X and what a supernode subtracts (nb x TOGETHER each); Y like X, if it is
 * another */
size_t pma_block_scratch(const pma_numeric *f, size_t count)
{
    if (count < PMA_BLOCK_MANY || f->factor.form != PMA_PANELS)
        return 0;
    return f->parts.nb * ((f->factor.Q > 0 ? 2 : 1) * count + 2 * least(count, TOGETHER));
}

/* X := R_bb^-1 X for the columns given, nb rows each; with the panels of Q, where they begin */
static void eliminate(const pma_numeric *f, size_t panels, size_t columns, double *X,
                      double *subtracted)
{
    const pma_panels *p = &f->parts.panels;
    const size_t begin = f->parts.n - f->parts.nb;
    int k = (int)columns, ld = (int)f->parts.nb;
    double one = 1.0, zero = 0.0;
    for (size_t s = 0; s < p->count; s++) {
        if ((size_t)p->first[s] < begin)
            continue;
        int width = (int)(p->first[s + 1] - p->first[s]);
        int below = (int)(p->row_ptr[s + 1] - p->row_ptr[s]), height = width + below;
        double *panel = p->values + panels + p->start[s], *own = X + ((size_t)p->first[s] - begin);
        const int32_t *rows = p->rows + p->row_ptr[s];
        f->parts.blas.dtrsm("L", "L", "N", "U", &width, &k, &one, panel, &height, own, &ld);
        if (below == 0)
            continue;
        f->parts.blas.dgemm("N", "N", &below, &k, &width, &one, panel + width, &height, own, &ld,
                            &zero, subtracted, &below);
        for (size_t c = 0; c < columns; c++) {
            for (int i = 0; i < below; i++)
                X[c * f->parts.nb + ((size_t)rows[i] - begin)] -=
                    subtracted[c * (size_t)below + (size_t)i];
        }
    }
}

void pma_block_compliance(const pma_numeric *f, const pma_link *L, const size_t *column,
                          size_t count, double scale, double *G, double *scratch)
{
    const size_t nb = f->parts.nb, together = least(count, TOGETHER);
    const double *inverse = f->inverse + (f->parts.n - nb);
    double *X = scratch, *scaled = X + nb * count, *subtracted = scaled + nb * together;
    double *Y = f->factor.Q > 0 ? subtracted + nb * together : X;
    memset(X, 0, nb * count * sizeof *X);
    for (size_t i = 0; i < nb; i++) {
        for (int64_t k = L->ptr[i]; k < L->ptr[i + 1]; k++)
            X[column[k] * nb + i] += L->values[k];
    }
    if (Y != X)
        memcpy(Y, X, nb * count * sizeof *X);
    for (size_t c = 0; c < count; c += TOGETHER) {
        eliminate(f, 0, least(count - c, TOGETHER), X + c * nb, subtracted);
        if (Y != X)
            eliminate(f, f->factor.Q, least(count - c, TOGETHER), Y + c * nb, subtracted);
    }
    int rows = (int)nb, all = (int)count;
    double zero = 0.0; /* BLAS sees G by columns: those are its rows, Y^T D^-1 X */
    for (size_t c = 0; c < count; c += TOGETHER) {
        int some = (int)least(count - c, TOGETHER);
        for (size_t k = 0; k < (size_t)some; k++) {
            for (size_t i = 0; i < nb; i++)
                scaled[k * nb + i] = inverse[i] * Y[(c + k) * nb + i];
        }
        f->parts.blas.dgemm("T", "N", &all, &some, &rows, &scale, X, &rows, scaled, &rows, &zero,
                            G + c * count, &all);
    }
}
