#include "algebra/factor.h"

#include <assert.h>
#include <string.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"
#include "algebra/lists.h"

pma_status pma_factor_check(const pma_factor *f)
{
    if (f->nb > f->n)
        return PMA_BAD_SIZE;
    if (f->form == PMA_IN_LANES)
        return pma_factor_check(f->each);
    if (f->form == PMA_PANELS)
        return pma_panels_check(&f->panels, f->n, f->nb);
    if (f->form == PMA_BAND)
        return f->width > 0 && f->width < f->n ? PMA_OK : PMA_BAD_SIZE;
    if (f->form != PMA_SPARSE)
        return PMA_OK;
    if (!pma_are_starts(f->n, f->ptr))
        return PMA_BAD_INDEX;
    for (size_t j = 0; j < f->n; j++) {
        int64_t above = (int64_t)j;
        for (int64_t k = f->ptr[j]; k < f->ptr[j + 1]; k++) {
            if (f->index[k] <= above || (size_t)f->index[k] >= f->n)
                return PMA_BAD_INDEX;
            above = f->index[k];
        }
    }
    return PMA_OK;
}

size_t pma_factor_scratch(const pma_factor *f)
{
    if (f->form == PMA_IN_LANES)
        return PMA_LANES * pma_factor_scratch(f->each);
    return f->form == PMA_PANELS ? pma_panels_most_height(&f->panels) : 0;
}

size_t pma_factor_entries(const pma_factor *f)
{
    switch (f->form) {
    case PMA_DENSE:
        return f->n * (f->n + 1) / 2;
    case PMA_BAND:
        return f->n * (f->width + 1);
    case PMA_SPARSE:
        return f->n + (size_t)f->ptr[f->n];
    case PMA_PANELS:
        return (size_t)f->panels.start[f->panels.count];
    case PMA_IN_LANES:
        return pma_factor_entries(f->each);
    default:
        return f->n;
    }
}

static void eliminate_nothing(const pma_factor *f, size_t first, size_t last, double *x,
                              double *work)
{
    (void)f, (void)first, (void)last, (void)x, (void)work;
}

/* Entries of a column of a band below the diagonal: fewer at the end. */
static size_t rows_of_band(const pma_factor *f, size_t j)
{
    return f->n - 1 - j < f->width ? f->n - 1 - j : f->width;
}

PMA_LOOP(divide, (const pma_factor *f, size_t first, size_t last, double *x, double *work), {
    number *own = (number *)x;
    (void)work;
    for (size_t j = first; j < last; j++)
        PMA_SCALE(f->inverse[j], &own[j - first], &own[j - first]);
})

PMA_LOOP(eliminate_wide, (const pma_factor *f, size_t first, size_t last, double *x, double *work),
         {
             number *own = (number *)x;
             number xj = own[0];
             (void)work;
             for (size_t j = first; j < last && j + 1 < f->n; j++) {
                 const double *column = f->values + j * f->width;
                 const size_t rows = rows_of_band(f, j);
                 number *below = own + (j + 1 - first);
                 number next = below[0];
                 PMA_SUBTRACT(column[0], &xj, &next);
                 for (size_t k = 1; k < rows; k++)
                     PMA_SUBTRACT(column[k], &xj, &below[k]);
                 below[0] = next;
                 xj = next;
             }
         })

PMA_LOOP(substitute_wide, (const pma_factor *f, size_t first, size_t last, double *x, double *work),
         {
             const double *Q = f->values + f->Q;
             number *own = (number *)x;
             number next = {0};
             (void)work;
             if (last < f->n)
                 next = own[last - first];
             for (size_t j = last; j-- > first;) {
                 const double *column = Q + j * f->width;
                 const number *below = own + (j + 1 - first);
                 const size_t rows = rows_of_band(f, j);
                 number xj;
                 PMA_SCALE(f->inverse[j], &own[j - first], &xj);
                 for (size_t k = 1; k < rows; k++)
                     PMA_SUBTRACT(column[k], &below[k], &xj);
                 if (rows > 0)
                     PMA_SUBTRACT(column[0], &next, &xj);
                 own[j - first] = next = xj;
             }
         })

PMA_LOOP(eliminate_sparse,
         (const pma_factor *f, size_t first, size_t last, double *x, double *work), {
             number *own = (number *)x;
             number xj = own[0];
             (void)work;
             for (size_t j = first; j < last; j++) {
                 int64_t k = f->ptr[j];
                 const int64_t end = f->ptr[j + 1];
                 number next = {0};
                 if (j + 1 < f->n)
                     next = own[j + 1 - first];
                 if (k < end && (size_t)f->index[k] == j + 1) {
                     PMA_SUBTRACT(f->values[k++], &xj, &next);
                     own[j + 1 - first] = next;
                 }
                 for (; k < end; k++)
                     PMA_SUBTRACT(f->values[k], &xj, &own[(size_t)f->index[k] - first]);
                 xj = next;
             }
         })

PMA_LOOP(substitute_sparse,
         (const pma_factor *f, size_t first, size_t last, double *x, double *work), {
             const double *Q = f->values + f->Q;
             number *own = (number *)x;
             number next = {0};
             (void)work;
             if (last < f->n)
                 next = own[last - first];
             for (size_t j = last; j-- > first;) {
                 int64_t k = f->ptr[j];
                 const int64_t end = f->ptr[j + 1];
                 number xj;
                 number sum = {0};
                 PMA_SCALE(f->inverse[j], &own[j - first], &xj);
                 if (k < end && (size_t)f->index[k] == j + 1)
                     PMA_SUBTRACT(Q[k++], &next, &xj);
                 for (; k < end; k++)
                     PMA_ADD(Q[k], &own[(size_t)f->index[k] - first], &sum);
                 PMA_SUBTRACT(1.0, &sum, &xj);
                 own[j - first] = next = xj;
             }
         })

/* A dense factor is one panel. Rows and columns first..n-1 of it; x[0] is unknown `first`. */
PMA_LOOP(eliminate_dense, (const pma_factor *f, size_t first, size_t last, double *x, double *work),
         {
             const pma_kernel *kernel = pma_kernel_best();
             (void)work;
             (PMA_VECTORS(number) == 1 ? kernel->eliminate : kernel->eliminate_lanes)(
                 f->values + first * f->n + first, f->n, f->n - first, last - first, x);
         })

PMA_LOOP(substitute_dense,
         (const pma_factor *f, size_t first, size_t last, double *x, double *work), {
             const pma_kernel *kernel = pma_kernel_best();
             number *own = (number *)x;
             (void)work;
             for (size_t j = first; j < last; j++)
                 PMA_SCALE(f->inverse[j], &own[j - first], &own[j - first]);
             (PMA_VECTORS(number) == 1 ? kernel->substitute : kernel->substitute_lanes)(
                 f->values + f->Q + first * f->n + first, f->n, f->n - first, last - first, x);
         })

PMA_LOOP(eliminate_panels,
         (const pma_factor *f, size_t first, size_t last, double *x, double *work),
         { pma_panels_eliminate(&f->panels, PMA_VECTORS(number), first, last, x, work); })

PMA_LOOP(substitute_panels,
         (const pma_factor *f, size_t first, size_t last, double *x, double *work), {
             pma_panels_substitute(&f->panels, f->inverse, PMA_VECTORS(number), first, last, x,
                                   work);
         })

/* The next unknown often depends on this one, in a chain on this one alone. It is kept in a
 * register, for a way through memory would cost as much as the arithmetic; and a chain has loops
 * of its own with nothing else in them, so that other work fits beside them. */
static void eliminate_chain(const pma_factor *f, size_t first, size_t last, double *x)
{
    const double *r = f->values + first;
    const size_t columns = pma_least(last, f->n - 1) - first;
    double xj = x[0];
    for (size_t j = 0; j < columns; j++)
        x[j + 1] = xj = x[j + 1] - r[j] * xj;
}

static void substitute_chain(const pma_factor *f, size_t first, size_t last, double *x)
{
    const double *q = f->values + f->Q + first, *inverse = f->inverse + first;
    size_t j = last - first;
    double xj = last < f->n ? x[j] : 0.0;
    while (j-- > 0)
        x[j] = xj = x[j] * inverse[j] - q[j] * xj;
}

static void eliminate_band(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    if (f->width == 1)
        eliminate_chain(f, first, last, x);
    else
        eliminate_wide_one(f, first, last, x, work);
}

static void substitute_band(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    if (f->width == 1)
        substitute_chain(f, first, last, x);
    else
        substitute_wide_one(f, first, last, x, work);
}

/* ---- in lanes: first and last are unknowns -------------------------------------------------- */

pma_factor pma_factor_in_lanes(const pma_factor *each)
{
    return (pma_factor){
        .form = PMA_IN_LANES, .n = each->n * PMA_LANES, .nb = each->nb * PMA_LANES, .each = each};
}

/* ---- each form ------------------------------------------------------------------------------ */

/* Some columns of a factor, x[0] is unknown `first`. In tables: in a switch, every form would save
 * the registers of all. */
typedef void (*sweep)(const pma_factor *f, size_t first, size_t last, double *x, double *work);

#define ELIMINATE(kind)                      \
    {[PMA_DIAGONAL] = eliminate_nothing,     \
     [PMA_BAND] = eliminate_wide_##kind,     \
     [PMA_DENSE] = eliminate_dense_##kind,   \
     [PMA_SPARSE] = eliminate_sparse_##kind, \
     [PMA_PANELS] = eliminate_panels_##kind}
#define SUBSTITUTE(kind)                      \
    {[PMA_DIAGONAL] = divide_##kind,          \
     [PMA_BAND] = substitute_wide_##kind,     \
     [PMA_DENSE] = substitute_dense_##kind,   \
     [PMA_SPARSE] = substitute_sparse_##kind, \
     [PMA_PANELS] = substitute_panels_##kind}

static void eliminate_lanes(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    static const sweep PLAIN[] = ELIMINATE(plain), AVX2[] = ELIMINATE(avx2);
    (pma_has_avx2() ? AVX2 : PLAIN)[f->each->form](f->each, first / PMA_LANES, last / PMA_LANES, x,
                                                   work);
}

static void substitute_lanes(const pma_factor *f, size_t first, size_t last, double *x,
                             double *work)
{
    static const sweep PLAIN[] = SUBSTITUTE(plain), AVX2[] = SUBSTITUTE(avx2);
    (pma_has_avx2() ? AVX2 : PLAIN)[f->each->form](f->each, first / PMA_LANES, last / PMA_LANES, x,
                                                   work);
}

/* Forward through the columns first..last-1. */
static void eliminate(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    static const sweep ELIMINATE[] = {
        [PMA_DIAGONAL] = eliminate_nothing,  [PMA_BAND] = eliminate_band,
        [PMA_DENSE] = eliminate_dense_one,   [PMA_SPARSE] = eliminate_sparse_one,
        [PMA_PANELS] = eliminate_panels_one, [PMA_IN_LANES] = eliminate_lanes,
    };
    if (first < last)
        ELIMINATE[f->form](f, first, last, x, work);
}

/* Backward through the columns last-1..first. */
static void substitute(const pma_factor *f, size_t first, size_t last, double *x, double *work)
{
    static const sweep SUBSTITUTE[] = {
        [PMA_DIAGONAL] = divide_one,          [PMA_BAND] = substitute_band,
        [PMA_DENSE] = substitute_dense_one,   [PMA_SPARSE] = substitute_sparse_one,
        [PMA_PANELS] = substitute_panels_one, [PMA_IN_LANES] = substitute_lanes,
    };
    if (first < last)
        SUBSTITUTE[f->form](f, first, last, x, work);
}

/* ---- a step --------------------------------------------------------------------------------- */

static inline void divide_some(const double *inverse, size_t count, double *restrict x)
{
    for (size_t i = 0; i < count; i++)
        x[i] *= inverse[i];
}

void pma_factor_interface(const pma_factor *f, double *xb, double *work)
{
    const size_t interior = f->n - f->nb;
    assert(f->nb <= f->n);
    if (f->nb == 0)
        return;
    if (f->nb == 1) { /* the last unknown alone: a sweep of nothing */
        xb[0] *= f->inverse[interior];
    } else if (f->form == PMA_DIAGONAL) {
        divide_some(f->inverse + interior, f->nb, xb);
    } else {
        eliminate(f, interior, f->n, xb, work);
        substitute(f, interior, f->n, xb, work);
    }
}

void pma_factor_divide(const pma_factor *f, size_t begin, size_t end, double *x)
{
    assert(f->form == PMA_DIAGONAL && begin <= end && end <= f->n);
    divide_some(f->inverse + begin, end - begin, x + begin);
}

void pma_factor_open_border(const pma_factor *f, double *x, double *xb, double *work)
{
    for (size_t i = 0; i < f->nb; i++)
        xb[i] = x[f->n - f->nb + i];
    pma_factor_interface(f, xb, work);
}

void pma_factor_close_border(const pma_factor *f, const double *fb, double *x, double *work)
{
    double *xb = x + (f->n - f->nb);
    for (size_t i = 0; i < f->nb; i++)
        xb[i] += fb[i];
    pma_factor_interface(f, xb, work);
}

void pma_factor_open_interior(const pma_factor *f, double *x, double *work)
{
    eliminate(f, 0, f->n - f->nb, x, work);
}

__attribute__((noinline)) static void open_swept(const pma_factor *f, double *x, double *xb,
                                                 double *work)
{
    eliminate(f, 0, f->n - f->nb, x, work);
    pma_factor_open_border(f, x, xb, work);
}

static void open_diagonal(const pma_factor *f, const double *x, double *xb)
{
    const size_t interior = f->n - f->nb;
    for (size_t i = 0; i < f->nb; i++)
        xb[i] = x[interior + i] * f->inverse[interior + i];
}

/* Each way is a function that is called last, so that none saves registers for the others. */
void pma_factor_open(const pma_factor *f, double *x, double *xb, double *work)
{
    if (f->form == PMA_DIAGONAL)
        open_diagonal(f, x, xb);
    else
        open_swept(f, x, xb, work);
}

__attribute__((noinline)) static void close_swept(const pma_factor *f, const double *fb, double *x,
                                                  double *work)
{
    pma_factor_close_border(f, fb, x, work);
    substitute(f, 0, f->n - f->nb, x, work);
}

static void close_diagonal(const pma_factor *f, const double *fb, double *x)
{
    const size_t interior = f->n - f->nb;
    for (size_t i = 0; i < f->nb; i++)
        x[interior + i] = (x[interior + i] + fb[i]) * f->inverse[interior + i];
    divide_some(f->inverse, interior, x);
}

void pma_factor_close(const pma_factor *f, const double *fb, double *x, double *work)
{
    if (f->form == PMA_DIAGONAL)
        close_diagonal(f, fb, x);
    else
        close_swept(f, fb, x, work);
}

void pma_factor_solve(const pma_factor *f, double *x, double *work)
{
    eliminate(f, 0, f->n, x, work);
    substitute(f, 0, f->n, x, work);
}
