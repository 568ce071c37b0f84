#include "algebra/loops.h"

#include "algebra/kernel.h"
#include "algebra/processors.h"

/* One register of AVX2, two of SSE2 or NEON; PMA_LANES numbers are two of them. */
typedef double four __attribute__((vector_size(32), aligned(8), may_alias));

enum { HALVES = PMA_LANES / 4 };

/* clang-format off: attributes are long, and a name begins its line */

/* ---- one unknown ---------------------------------------------------------------------------- */

__attribute__((always_inline)) static inline const four *lanes_at(const double *x, size_t i)
{
    return (const four *)(x + i * PMA_LANES);
}

__attribute__((always_inline)) static inline void load(const double *x, size_t i, four *y)
{
    y[0] = lanes_at(x, i)[0];
    y[1] = lanes_at(x, i)[1];
}

__attribute__((always_inline)) static inline void store(const four *y, double *x, size_t i)
{
    four *to = (four *)(x + i * PMA_LANES);
    to[0] = y[0];
    to[1] = y[1];
}

__attribute__((always_inline)) static inline void copy(const four *x, four *y)
{
    y[0] = x[0];
    y[1] = x[1];
}

/* y -= a x, and y += a x */
__attribute__((always_inline)) static inline void subtract_scaled(double a, const four *x, four *y)
{
    y[0] -= a * x[0];
    y[1] -= a * x[1];
}

__attribute__((always_inline)) static inline void add_scaled(double a, const four *x, four *y)
{
    y[0] += a * x[0];
    y[1] += a * x[1];
}

/* ---- products ------------------------------------------------------------------------------- */

__attribute__((always_inline)) static inline void
subtract_diagonal(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    four yi[HALVES];
    for (size_t i = begin; i < end; i++) {
        load(y, i, yi);
        subtract_scaled(A->values[i], lanes_at(x, i), yi);
        store(yi, y, i);
    }
}

__attribute__((always_inline)) static inline void
subtract_band(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    four yi[HALVES];
    for (size_t i = begin; i < end; i++) {
        load(y, i, yi);
        subtract_scaled(A->values[i], lanes_at(x, i), yi);
        for (size_t d = 1; d <= A->width; d++) {
            const double *above = A->values + d * A->n, *below = above + A->below;
            if (i + d < A->n)
                subtract_scaled(above[i], lanes_at(x, i + d), yi);
            if (i >= d)
                subtract_scaled(below[i - d], lanes_at(x, i - d), yi);
        }
        store(yi, y, i);
    }
}

__attribute__((always_inline)) static inline void
subtract_sparse(const pma_matrix *A, size_t begin, size_t end, const double *x, double *y)
{
    for (size_t i = begin; i < end; i++) {
        four sum[HALVES] = {{0.0}}, yi[HALVES];
        for (int64_t k = A->ptr[i]; k < A->ptr[i + 1]; k++)
            add_scaled(A->values[k], lanes_at(x, (size_t)A->index[k]), sum);
        load(y, i, yi);
        yi[0] -= sum[0];
        yi[1] -= sum[1];
        store(yi, y, i);
    }
}

__attribute__((always_inline)) static inline void subtract(const pma_matrix *A, size_t begin,
                                                           size_t end, const double *x, double *y)
{
    if (A->form == PMA_DIAGONAL)
        subtract_diagonal(A, begin, end, x, y);
    else if (A->form == PMA_BAND)
        subtract_band(A, begin, end, x, y);
    else
        subtract_sparse(A, begin, end, x, y);
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* Entries of a column of a band below the diagonal: fewer at the end. */
__attribute__((always_inline)) static inline size_t rows_of_band(const pma_factor *f, size_t j)
{
    return f->n - 1 - j < f->width ? f->n - 1 - j : f->width;
}

/* y = x_j / D_j, x[0] being unknown `first` */
__attribute__((always_inline)) static inline void
load_divided(const pma_factor *f, size_t j, const double *x, size_t first, four *y)
{
    y[0] = lanes_at(x, j - first)[0] * f->inverse[j];
    y[1] = lanes_at(x, j - first)[1] * f->inverse[j];
}

/* The next unknown is kept in registers, as in the sweeps of one vector. */
__attribute__((always_inline)) static inline void eliminate_band(const pma_factor *f, size_t first,
                                                                 size_t last, double *x)
{
    four xj[HALVES], below[HALVES];
    load(x, 0, xj);
    for (size_t j = first; j < last && j + 1 < f->n; j++) {
        const double *column = f->values + j * f->width;
        const size_t rows = rows_of_band(f, j);
        for (size_t k = 1; k < rows; k++) {
            load(x, j + 1 + k - first, below);
            subtract_scaled(column[k], xj, below);
            store(below, x, j + 1 + k - first);
        }
        load(x, j + 1 - first, below);
        subtract_scaled(column[0], xj, below);
        store(below, x, j + 1 - first);
        copy(below, xj);
    }
}

__attribute__((always_inline)) static inline void substitute_band(const pma_factor *f, size_t first,
                                                                  size_t last, double *x)
{
    const double *Q = f->values + f->Q;
    four next[HALVES] = {{0.0}}, xj[HALVES];
    if (last < f->n)
        load(x, last - first, next);
    for (size_t j = last; j-- > first;) {
        const double *column = Q + j * f->width;
        const size_t rows = rows_of_band(f, j);
        load_divided(f, j, x, first, xj);
        for (size_t k = 1; k < rows; k++)
            subtract_scaled(column[k], lanes_at(x, j + 1 + k - first), xj);
        if (rows > 0)
            subtract_scaled(column[0], next, xj);
        store(xj, x, j - first);
        copy(xj, next);
    }
}

__attribute__((always_inline)) static inline void
eliminate_sparse(const pma_factor *f, size_t first, size_t last, double *x)
{
    four xj[HALVES], below[HALVES];
    for (size_t j = first; j < last; j++) {
        load(x, j - first, xj);
        for (int64_t k = f->ptr[j]; k < f->ptr[j + 1]; k++) {
            const size_t i = (size_t)f->index[k] - first;
            load(x, i, below);
            subtract_scaled(f->values[k], xj, below);
            store(below, x, i);
        }
    }
}

/* The next unknown comes first, and the others are summed up before. */
__attribute__((always_inline)) static inline void
substitute_sparse(const pma_factor *f, size_t first, size_t last, double *x)
{
    const double *Q = f->values + f->Q;
    for (size_t j = last; j-- > first;) {
        four sum[HALVES] = {{0.0}}, xj[HALVES];
        int64_t k = f->ptr[j];
        const int64_t end = f->ptr[j + 1];
        load_divided(f, j, x, first, xj);
        if (k < end && (size_t)f->index[k] == j + 1)
            subtract_scaled(Q[k++], lanes_at(x, j + 1 - first), xj);
        for (; k < end; k++)
            add_scaled(Q[k], lanes_at(x, (size_t)f->index[k] - first), sum);
        xj[0] -= sum[0];
        xj[1] -= sum[1];
        store(xj, x, j - first);
    }
}

__attribute__((always_inline)) static inline void eliminate(const pma_factor *f, size_t first,
                                                            size_t last, double *x)
{
    if (f->form == PMA_BAND)
        eliminate_band(f, first, last, x);
    else
        eliminate_sparse(f, first, last, x);
}

__attribute__((always_inline)) static inline void substitute(const pma_factor *f, size_t first,
                                                             size_t last, double *x)
{
    if (f->form == PMA_BAND)
        substitute_band(f, first, last, x);
    else
        substitute_sparse(f, first, last, x);
}

__attribute__((always_inline)) static inline void scale(const pma_factor *f, size_t first,
                                                        size_t last, double *x)
{
    four xj[HALVES];
    for (size_t j = first; j < last; j++) {
        load_divided(f, j, x, first, xj);
        store(xj, x, j - first);
    }
}

/* ---- links ---------------------------------------------------------------------------------- */

__attribute__((always_inline)) static inline void add(const pma_link *L, const double *lam,
                                                      double *xb)
{
    four xj[HALVES];
    for (size_t j = 0; j < L->nb; j++) {
        load(xb, j, xj);
        for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++)
            add_scaled(L->values[k], lanes_at(lam, (size_t)L->index[k]), xj);
        store(xj, xb, j);
    }
}

__attribute__((always_inline)) static inline void gather(const pma_link *L, double scale,
                                                         const double *xb, double *jump)
{
    four xj[HALVES], row[HALVES];
    for (size_t j = 0; j < L->nb; j++) {
        xj[0] = scale * lanes_at(xb, j)[0];
        xj[1] = scale * lanes_at(xb, j)[1];
        for (int64_t k = L->ptr[j]; k < L->ptr[j + 1]; k++) {
            load(jump, (size_t)L->index[k], row);
            add_scaled(L->values[k], xj, row);
            store(row, jump, (size_t)L->index[k]);
        }
    }
}

/* clang-format on */

/* ---- for each kind of processor ------------------------------------------------------------- */

PMA_COMPILED(void, subtract,
             (const pma_matrix *A, size_t begin, size_t end, const double *x, double *y),
             subtract(A, begin, end, x, y);)

PMA_COMPILED(void, eliminate, (const pma_factor *f, size_t first, size_t last, double *x),
             eliminate(f, first, last, x);)

PMA_COMPILED(void, substitute, (const pma_factor *f, size_t first, size_t last, double *x),
             substitute(f, first, last, x);)

PMA_COMPILED(void, scale, (const pma_factor *f, size_t first, size_t last, double *x),
             scale(f, first, last, x);)

PMA_COMPILED(void, add, (const pma_link *L, const double *lam, double *xb), add(L, lam, xb);)

PMA_COMPILED(void, gather, (const pma_link *L, double scale, const double *xb, double *jump),
             gather(L, scale, xb, jump);)

#define TABLE(kind)                      \
    {                                    \
        .subtract = subtract_##kind,     \
        .eliminate = eliminate_##kind,   \
        .substitute = substitute_##kind, \
        .scale = scale_##kind,           \
        .add = add_##kind,               \
        .gather = gather_##kind,         \
    }

static const pma_loops PLAIN = TABLE(plain), AVX2 = TABLE(avx2);

const pma_loops *pma_loops_plain(void)
{
    return &PLAIN;
}

const pma_loops *pma_loops_best(void)
{
    return pma_has_avx2() ? &AVX2 : &PLAIN;
}

/* ---- by any form ---------------------------------------------------------------------------- */

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

void pma_loops_subtract_rows(const pma_matrix *A, size_t begin, size_t end, const double *x,
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

void pma_loops_subtract(const pma_matrix *A, const double *x, double *y)
{
    pma_loops_subtract_rows(A, 0, A->n, x, y);
}

/* ---- sweeps, x[0] being unknown `first` ----------------------------------------------------- */

void pma_loops_eliminate(const pma_factor *f, size_t first, size_t last, double *x, double *work)
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

void pma_loops_substitute(const pma_factor *f, size_t first, size_t last, double *x, double *work)
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

/* ---- links ---------------------------------------------------------------------------------- */

void pma_loops_add(const pma_link *L, const double *lam, double *xb)
{
    pma_loops_best()->add(L, lam, xb);
}

void pma_loops_gather(const pma_link *L, double scale, const double *xb, double *jump)
{
    pma_loops_best()->gather(L, scale, xb, jump);
}
