#include "factor/numeric.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/lists.h"
#include "memory.h"
#include "object.h"

/* A pivot below this part of its diagonal entry has lost all digits.                      (F11) */
#define LOST (64.0 * DBL_EPSILON)

/* Subtracted from a diagonal entry, this multiple of it leaves half of the digits.        (F11) */
#define GROWTH 1e8

/* A band of at most this many entries below the diagonal is factored by loops of its own, where it
 * has not many more entries than the panels: calls of BLAS for a few columns each take longer. */
enum { NARROW = 32 };

static size_t entries_of(const pma_numeric_parts *parts)
{
    return (size_t)parts->ptr[parts->n];
}

static bool is_diagonal(const pma_numeric_parts *parts)
{
    return entries_of(parts) == parts->n;
}

/* How far from the diagonal a row has entries; the pattern is symmetric. */
static size_t width_of(const pma_numeric_parts *parts)
{
    size_t width = 0;
    for (size_t i = 0; i < parts->n; i++) {
        const size_t first = (size_t)parts->index[parts->ptr[i]];
        width = i - first > width ? i - first : width;
    }
    return width;
}

static pma_form form_of(const pma_numeric_parts *parts)
{
    if (is_diagonal(parts))
        return PMA_DIAGONAL;
    const size_t width = width_of(parts), panels = (size_t)parts->panels.start[parts->panels.count];
    return width <= NARROW && parts->n * (width + 1) <= 2 * panels ? PMA_BAND : PMA_PANELS;
}

/* ---- making --------------------------------------------------------------------------------- */

static pma_status check_row(const pma_numeric_parts *parts, size_t i)
{
    bool diagonal = false;
    for (int64_t k = parts->ptr[i]; k < parts->ptr[i + 1]; k++) {
        if (k > parts->ptr[i] && parts->index[k] <= parts->index[k - 1])
            return PMA_BAD_INDEX;
        diagonal = diagonal || (size_t)parts->index[k] == i;
    }
    return diagonal ? PMA_OK : PMA_BAD_INDEX;
}

static pma_status check(const pma_numeric_parts *parts)
{
    const pma_matrix pattern = {
        .form = PMA_SPARSE, .n = parts->n, .ptr = parts->ptr, .index = parts->index};
    pma_status status = pma_matrix_check(&pattern);
    for (size_t i = 0; i < parts->n && status == PMA_OK; i++)
        status = check_row(parts, i);
    if (status != PMA_OK || is_diagonal(parts))
        return status;
    if (!parts->panels.first)
        return PMA_BAD_INDEX;
    PMA_TRY(pma_panels_check(&parts->panels, parts->n, parts->nb));
    return pma_panels_check_owners(&parts->panels, parts->n, parts->owner);
}

pma_status pma_numeric_create(const pma_numeric_parts *parts, pma_numeric *out)
{
    *out = (pma_numeric){.values = NULL};
    PMA_TRY(check(parts));
    const pma_form form = form_of(parts);
    const size_t n = parts->n, width = form == PMA_BAND ? width_of(parts) : 0;
    const size_t size =
        form == PMA_PANELS ? (size_t)parts->panels.start[parts->panels.count] : n * width;
    const size_t Q = parts->unsymmetric ? size : 0;
    const pma_array arrays[] = {PMA_ARRAY(pma_numeric, values, entries_of(parts)),
                                PMA_ARRAY(pma_numeric, factored, entries_of(parts)),
                                PMA_ARRAY(pma_numeric, inverse, n),
                                PMA_ARRAY(pma_numeric, numbers, size + Q),
                                PMA_ARRAY(pma_numeric, limits, form == PMA_BAND ? 2 * n : 0),
                                {0}};
    out->block = pma_object_fill(out, arrays);
    if (!out->block)
        return PMA_NO_MEMORY;
    out->parts = *parts;
    for (size_t i = 0; i < n; i++)
        out->inverse[i] = 1.0;
    out->parts.panels.values = out->numbers;
    out->parts.panels.Q = Q;
    out->factor = (pma_factor){.form = form,
                               .n = n,
                               .nb = parts->nb,
                               .inverse = out->inverse,
                               .values = out->numbers,
                               .width = width,
                               .Q = Q,
                               .panels = out->parts.panels};
    if (form != PMA_PANELS)
        return PMA_OK;
    const pma_status status =
        pma_elimination_create(&out->parts.panels, n, parts->owner, &parts->blas,
                               pma_most(parts->crew.workers, 1), &out->elimination);
    if (status != PMA_OK)
        pma_numeric_destroy(out);
    return status;
}

void pma_numeric_destroy(pma_numeric *f)
{
    pma_memory_release(f->block);
    pma_elimination_destroy(f->elimination);
    *f = (pma_numeric){.values = NULL};
}

/* ---- numbers -------------------------------------------------------------------------------- */

static bool never(void *ctx)
{
    (void)ctx;
    return false;
}

static pma_status invert(pma_numeric *f, size_t *column)
{
    for (size_t i = 0; i < f->parts.n; i++) {
        *column = i;
        if (!(fabs(f->values[i]) > DBL_MIN))
            return PMA_NOT_DEFINITE;
        f->inverse[i] = 1.0 / f->values[i];
    }
    return PMA_OK;
}

/* The lower triangle by columns, without the diagonal, which goes to `inverse`; the least pivots
 * and the most that may be subtracted from them to `limits`. Unsymmetric: the upper triangle by
 * rows too. Row j of a symmetric matrix is its column j. */
static void fill_band(pma_numeric *f)
{
    const pma_numeric_parts *parts = &f->parts;
    const size_t n = parts->n, width = f->factor.width;
    double *R = f->numbers, *Q = R + f->factor.Q;
    memset(R, 0, (f->factor.Q + n * width) * sizeof *R);
    for (size_t j = 0; j < n; j++) {
        int64_t k = parts->ptr[j + 1] - 1;
        for (; (size_t)parts->index[k] > j; k--)
            Q[j * width + (size_t)parts->index[k] - j - 1] = f->values[k];
        f->inverse[j] = f->values[k];
        f->limits[j] = LOST * fabs(f->values[k]);
        f->limits[n + j] = GROWTH * fabs(f->values[k]);
        for (k = f->factor.Q > 0 ? k - 1 : -1; k >= parts->ptr[j]; k--) {
            const size_t i = (size_t)parts->index[k];
            R[i * width + j - i - 1] = f->values[k];
        }
    }
}

/* A_ik -= A_ij A_kj / D_j for i >= k > j, then R_kj = A_kj / D_j; `rows`, or the first of which
 * too much is subtracted                                                                (F11) */
static size_t eliminate_column(double *column, double *diagonal, size_t rows, size_t width,
                               double inverse, const double *most)
{
    for (size_t k = 0; k < rows; k++) {
        const double r = column[k] * inverse, product = r * column[k];
        double *below = column + (k + 1) * width - (k + 1);
        const size_t end = r == 0.0 ? 0 : rows; /* a band is seldom full */
        if (!(fabs(product) <= most[k]))
            return k;
        diagonal[k] -= product;
#pragma omp simd
        for (size_t i = k + 1; i < end; i++)
            below[i] -= r * column[i];
        column[k] = r;
    }
    return rows;
}

/* D_j+1 = A_j+1,j+1 - A_j+1,j^2 / D_j: only a division and a difference wait for the pivot
 * before */
static pma_status factor_chain(pma_numeric *f, size_t *column)
{
    const size_t n = f->parts.n;
    double *below = f->numbers, *inverse = f->inverse, pivot = inverse[0], product = 0.0;
    for (size_t j = 0; j < n; j++) {
        *column = j;
        if (!(fabs(pivot) > f->limits[j] && fabs(product) <= f->limits[n + j]))
            return PMA_NOT_DEFINITE;
        product = j + 1 < n ? below[j] * below[j] / pivot : 0.0;
        const double next = j + 1 < n ? inverse[j + 1] - product : 0.0;
        inverse[j] = 1.0 / pivot;
        below[j] *= inverse[j];
        pivot = next;
    }
    return PMA_OK;
}

/* A_ik -= A_ij A_jk / D_j and A_ki -= A_kj A_ji / D_j for i >= k > j, then R_kj = A_kj / D_j and
 * Q_kj = A_jk / D_j; `rows`, or the first of which too much is subtracted               (F11) */
static size_t eliminate_pair(double *R, double *Q, double *diagonal, size_t rows, size_t width,
                             double inverse, const double *most)
{
    for (size_t k = 0; k < rows; k++)
        R[k] *= inverse;
    for (size_t k = 0; k < rows; k++) {
        const double q = Q[k], r = R[k], product = r * q;
        double *r_below = R + (k + 1) * width - (k + 1), *q_below = Q + (k + 1) * width - (k + 1);
        if (!(fabs(product) <= most[k]))
            return k;
        diagonal[k] -= product;
#pragma omp simd
        for (size_t i = k + 1; i < rows; i++) {
            r_below[i] -= R[i] * q;
            q_below[i] -= Q[i] * r;
        }
    }
    for (size_t k = 0; k < rows; k++)
        Q[k] *= inverse;
    return rows;
}

static pma_status factor_band(pma_numeric *f, size_t *column)
{
    const size_t n = f->parts.n, width = f->factor.width;
    double *R = f->numbers, *Q = R + f->factor.Q;
    fill_band(f);
    if (width == 1 && Q == R)
        return factor_chain(f, column);
    for (size_t j = 0; j < n; j++) {
        *column = j;
        if (!(fabs(f->inverse[j]) > f->limits[j]))
            return PMA_NOT_DEFINITE;
        const double inverse = f->inverse[j] = 1.0 / f->inverse[j];
        const size_t rows = n - 1 - j < width ? n - 1 - j : width;
        double *r = R + j * width, *q = Q + j * width, *diagonal = f->inverse + j + 1;
        const double *most = f->limits + n + j + 1;
        const size_t good = Q == R ? eliminate_column(r, diagonal, rows, width, inverse, most)
                                   : eliminate_pair(r, q, diagonal, rows, width, inverse, most);
        *column = j + 1 + good;
        if (good < rows)
            return PMA_NOT_DEFINITE;
    }
    return PMA_OK;
}

static pma_status factor(pma_numeric *f, size_t *column)
{
    const pma_numeric_parts *parts = &f->parts;
    if (f->factor.form == PMA_DIAGONAL)
        return invert(f, column);
    if (f->factor.form == PMA_BAND)
        return factor_band(f, column);
    const pma_panels_input input = {.n = parts->n,
                                    .ptr = parts->ptr,
                                    .index = parts->index,
                                    .values = f->values,
                                    .lost = LOST,
                                    .growth = GROWTH,
                                    .indefinite = true};
    const pma_crew *crew = &parts->crew;
    const pma_patience patience = {.stop = never, .rest = crew->rest};
    if (crew->workers == 0)
        return pma_elimination_run(f->elimination, &input, f->inverse, &patience, column);
    pma_elimination_begin(f->elimination, &input, f->inverse, &patience);
    crew->work(crew->ctx, f->elimination);
    return pma_elimination_end(f->elimination, column);
}

pma_status pma_numeric_factor(pma_numeric *f, size_t *column)
{
    assert(f->values && column);
    const size_t size = entries_of(&f->parts) * sizeof *f->values;
    if (f->is_factored && memcmp(f->factored, f->values, size) == 0)
        return PMA_OK;
    const pma_status status = factor(f, column);
    f->is_factored = status == PMA_OK;
    if (f->is_factored) {
        memcpy(f->factored, f->values, size);
        f->made++;
    }
    return status;
}

size_t pma_numeric_entry(const pma_numeric_parts *parts, size_t row, size_t column)
{
    const int64_t end = parts->ptr[row + 1];
    const int64_t k = pma_position_of(parts->index, parts->ptr[row], end, column);
    return k < end && (size_t)parts->index[k] == column ? (size_t)k : SIZE_MAX;
}

void pma_numeric_multiply(const pma_numeric *f, const double *x, double *y)
{
    for (size_t i = 0; i < f->parts.n; i++) {
        double sum = 0.0;
        for (int64_t k = f->parts.ptr[i]; k < f->parts.ptr[i + 1]; k++)
            sum += f->values[k] * x[f->parts.index[k]];
        y[i] += sum;
    }
}

/* ---- the compliance of the interface --------------------------------------------------------- */

/* Constraints taken together, so that what belongs to them stays in the cache. */
enum { TOGETHER = 128 };

/* X (nb x count), D^-1 X and what a supernode subtracts (nb x TOGETHER each); Y like X, if it is
 * another */
size_t pma_numeric_compliance_scratch(const pma_numeric *f, size_t count)
{
    const pma_blas *blas = &f->parts.blas;
    const size_t nb = f->parts.nb, some = pma_least(count, TOGETHER);
    if (count < PMA_NUMERIC_MANY || f->factor.form != PMA_PANELS || !blas->dgemm ||
        nb * nb * some < blas->from)
        return 0;
    return nb * ((f->factor.Q > 0 ? 2 : 1) * count + 2 * some);
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

void pma_numeric_compliance(const pma_numeric *f, const pma_link *L, const size_t *column,
                            size_t count, double scale, double *G, double *scratch)
{
    const size_t nb = f->parts.nb, together = pma_least(count, TOGETHER);
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
        eliminate(f, 0, pma_least(count - c, TOGETHER), X + c * nb, subtracted);
        if (Y != X)
            eliminate(f, f->factor.Q, pma_least(count - c, TOGETHER), Y + c * nb, subtracted);
    }
    int rows = (int)nb, all = (int)count;
    double zero = 0.0; /* BLAS sees G by columns: those are its rows, Y^T D^-1 X */
    for (size_t c = 0; c < count; c += TOGETHER) {
        int some = (int)pma_least(count - c, TOGETHER);
        for (size_t k = 0; k < (size_t)some; k++) {
            for (size_t i = 0; i < nb; i++)
                scaled[k * nb + i] = inverse[i] * Y[(c + k) * nb + i];
        }
        f->parts.blas.dgemm("T", "N", &all, &some, &rows, &scale, X, &rows, scaled, &rows, &zero,
                            G + c * count, &all);
    }
}
