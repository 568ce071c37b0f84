#include "algebra/panels.h"

#include <math.h>
#include <string.h>

#include "algebra/kernel.h"
#include "algebra/trapezoid.h"

static size_t width_of(const pma_panels *p, size_t s)
{
    return (size_t)(p->first[s + 1] - p->first[s]);
}

static size_t rows_of(const pma_panels *p, size_t s)
{
    return (size_t)(p->row_ptr[s + 1] - p->row_ptr[s]);
}

/* Rows of the whole panel: the distance between two of its columns. */
static size_t height_of(const pma_panels *p, size_t s)
{
    return width_of(p, s) + rows_of(p, s);
}

/* ---- checks --------------------------------------------------------------------------------- */

static bool rows_are_right(const pma_panels *p, size_t s, size_t n)
{
    int64_t above = p->first[s + 1] - 1;
    for (int64_t k = p->row_ptr[s]; k < p->row_ptr[s + 1]; k++) {
        if (p->rows[k] <= above || (size_t)p->rows[k] >= n)
            return false;
        above = p->rows[k];
    }
    return true;
}

pma_status pma_panels_check(const pma_panels *p, size_t n, size_t nb)
{
    bool border = nb == n || nb == 0;
    if (p->first[0] != 0 || p->row_ptr[0] != 0 || p->start[0] != 0 ||
        p->first[p->count] != (int64_t)n)
        return PMA_BAD_INDEX;
    for (size_t s = 0; s < p->count; s++) {
        if (p->first[s + 1] <= p->first[s] || p->first[s + 1] > (int64_t)n ||
            p->row_ptr[s + 1] < p->row_ptr[s])
            return PMA_BAD_INDEX;
    }
    for (size_t s = 0; s < p->count; s++) {
        if (!rows_are_right(p, s, n) ||
            p->start[s + 1] - p->start[s] != (int64_t)(width_of(p, s) * height_of(p, s)))
            return PMA_BAD_INDEX;
        border = border || p->first[s] == (int64_t)(n - nb);
    }
    return border ? PMA_OK : PMA_BAD_INDEX;
}

size_t pma_panels_most_height(const pma_panels *p)
{
    size_t most = 0;
    for (size_t s = 0; s < p->count; s++)
        most = height_of(p, s) > most ? height_of(p, s) : most;
    return most;
}

static size_t most_rows(const pma_panels *p)
{
    size_t most = 0;
    for (size_t s = 0; s < p->count; s++)
        most = rows_of(p, s) > most ? rows_of(p, s) : most;
    return most;
}

size_t pma_panels_update_size(const pma_panels *p)
{
    size_t widest = 0;
    for (size_t s = 0; s < p->count; s++)
        widest = width_of(p, s) > widest ? width_of(p, s) : widest;
    return widest * most_rows(p);
}

/* ---- numeric part: left-looking; a symmetric panel as a dense Cholesky factor --------------- */

/* What the numeric part walks with. */
typedef struct {
    pma_panels *p;
    const pma_blas *blas;
    double *update;
    int64_t *head, *next; /* supernodes waiting to update each supernode */
    int64_t *done;        /* how many rows of a supernode have been used as columns */
    int64_t *place;       /* row -> row of the panel at hand */
    int64_t *unread;      /* unsymmetric: the first entry of each row that no column has read */
} walk;

/* The row of the panel that a row of the matrix is, or its height when it is none. */
static size_t place_in(const walk *w, size_t s, int64_t row)
{
    const pma_panels *p = w->p;
    const size_t width = width_of(p, s), place = (size_t)w->place[row];
    if (place < width)
        return p->first[s] + (int64_t)place == row ? place : height_of(p, s);
    if (place < height_of(p, s) && p->rows[p->row_ptr[s] + (int64_t)(place - width)] == row)
        return place;
    return height_of(p, s);
}

/* The entry (row, column) for the next column that has one in this row. */
static pma_status read_across(const walk *w, const pma_panels_input *A, size_t row, int64_t column,
                              double *entry)
{
    const int64_t k = w->unread[row]++;
    if (k >= A->ptr[row + 1] || A->index[k] != column)
        return PMA_BAD_INDEX;
    *entry += A->values[k];
    return PMA_OK;
}

/* Entries of the matrix in and below the diagonal block, and those across the diagonal from them;
 * the others belong to other panels. Row j of A is column j of A^T, which Q is made of. */
static pma_status fill_panel(const walk *w, size_t s, const pma_panels_input *A, double *diagonal)
{
    const pma_panels *p = w->p;
    const size_t width = width_of(p, s), height = height_of(p, s);
    double *R = p->values + p->start[s], *panel = R + p->Q;
    memset(panel, 0, width * height * sizeof *panel);
    if (p->Q > 0)
        memset(R, 0, width * height * sizeof *R);
    for (size_t i = 0; i < width; i++)
        w->place[p->first[s] + (int64_t)i] = (int64_t)i;
    for (size_t i = 0; i < rows_of(p, s); i++)
        w->place[p->rows[p->row_ptr[s] + (int64_t)i]] = (int64_t)(width + i);
    for (size_t j = 0; j < width; j++) {
        const int64_t column = p->first[s] + (int64_t)j;
        for (int64_t k = A->ptr[column]; k < A->ptr[column + 1]; k++) {
            if (A->index[k] < column)
                continue;
            const size_t place = place_in(w, s, A->index[k]);
            if (place == height)
                return PMA_BAD_INDEX;
            panel[j * height + place] += A->values[k];
            if (p->Q > 0 &&
                read_across(w, A, (size_t)A->index[k], column, R + j * height + place) != PMA_OK)
                return PMA_BAD_INDEX;
        }
        diagonal[column] = panel[j * height + j];
    }
    return PMA_OK;
}

static void subtract(const double *u, size_t count, double *x)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        x[i] -= u[i];
}

static void scatter(const double *u, const int32_t *rows, const int64_t *place, size_t begin,
                    size_t end, double *column)
{
    for (size_t i = begin; i < end; i++)
        column[place[rows[i]]] -= u[i];
}

/* X(s) -= X_d Y_d^T in the rows and columns that supernode d shares with it; X and Y are R and Q,
 * by where they begin in the values */
static void update_panel(const walk *w, size_t d, size_t begin, size_t end, size_t s, size_t X,
                         size_t Y)
{
    const pma_panels *p = w->p;
    const size_t height = height_of(p, s);
    const int32_t *rows = p->rows + p->row_ptr[d];
    double *below = p->values + p->start[d] + width_of(p, d) + begin;
    double *panel = p->values + X + p->start[s];
    int m = (int)(rows_of(p, d) - begin), columns = (int)(end - begin), k = (int)width_of(p, d);
    int ld = (int)height_of(p, d);
    double one = 1.0, zero = 0.0;
    w->blas->dgemm("N", "T", &m, &columns, &k, &one, below + X, &ld, below + Y, &ld, &zero,
                   w->update, &m);
    const int64_t first = w->place[rows[begin]];
    const bool adjoined = w->place[rows[begin + (size_t)m - 1]] == first + m - 1;
    for (size_t j = 0; j < (size_t)columns; j++) {
        double *column = panel + (size_t)w->place[rows[begin + j]] * height;
        const double *u = w->update + j * (size_t)m;
        if (adjoined)
            subtract(u + j, (size_t)m - j, column + first + j);
        else
            scatter(u, rows + begin, w->place, j, (size_t)m, column);
    }
}

static pma_status apply_update(const walk *w, size_t d, size_t begin, size_t end, size_t s)
{
    const pma_panels *p = w->p;
    for (size_t i = begin; i < rows_of(p, d); i++) {
        if (place_in(w, s, p->rows[p->row_ptr[d] + (int64_t)i]) == height_of(p, s))
            return PMA_BAD_INDEX;
    }
    update_panel(w, d, begin, end, s, 0, p->Q);
    if (p->Q > 0)
        update_panel(w, d, begin, end, s, p->Q, 0);
    return PMA_OK;
}

/* A supernode whose rows are not used up waits for the owner of the next one. */
static void wait(const walk *w, size_t d, const int64_t *owner)
{
    if (w->done[d] < (int64_t)rows_of(w->p, d)) {
        const int64_t s = owner[w->p->rows[w->p->row_ptr[d] + w->done[d]]];
        w->next[d] = w->head[s];
        w->head[s] = (int64_t)d;
    }
}

static pma_status apply_updates(const walk *w, size_t s, const int64_t *owner)
{
    pma_status status = PMA_OK;
    int64_t d = w->head[s];
    while (d >= 0 && status == PMA_OK) {
        const int64_t following = w->next[d];
        const int32_t *rows = w->p->rows + w->p->row_ptr[d];
        const size_t begin = (size_t)w->done[d];
        size_t end = begin;
        while (end < rows_of(w->p, (size_t)d) && rows[end] < w->p->first[s + 1])
            end++;
        status = apply_update(w, (size_t)d, begin, end, s);
        w->done[d] = (int64_t)end;
        wait(w, (size_t)d, owner);
        d = following;
    }
    return status;
}

/* ---- the growth of an unsymmetric factor: R is a unit factor, Q that of A^T still times D ----- */

/* n, or the first row of this panel from whose diagonal entry too much was subtracted      (F11) */
static size_t grown_row(const pma_panels *p, size_t s, size_t n, double growth,
                        const double *diagonal)
{
    const size_t width = width_of(p, s), height = height_of(p, s), first = (size_t)p->first[s];
    const int32_t *rows = p->rows + p->row_ptr[s];
    const double *R = p->values + p->start[s], *Q = R + p->Q;
    for (size_t j = 0; j < width; j++) {
        for (size_t i = j + 1; i < height; i++) {
            const size_t row = i < width ? first + i : (size_t)rows[i - width];
            if (!(fabs(R[j * height + i] * Q[j * height + i]) <= growth * fabs(diagonal[row])))
                return row;
        }
    }
    return n;
}

static pma_status check_growth(const pma_panels *p, const pma_panels_input *A,
                               const double *diagonal, size_t *column)
{
    *column = A->n;
    for (size_t s = 0; s < p->count && *column == A->n; s++)
        *column = grown_row(p, s, A->n, A->growth, diagonal);
    return *column == A->n ? PMA_OK : PMA_NOT_DEFINITE;
}

/* ---- one supernode after the other ---------------------------------------------------------- */

static size_t factor_one(const walk *w, size_t s, const pma_panels_input *A, double *diagonal)
{
    const pma_panels *p = w->p;
    double *R = p->values + p->start[s];
    const size_t width = width_of(p, s), height = height_of(p, s);
    if (p->Q > 0)
        return pma_trapezoid_factor_pair(R, R + p->Q, width, height, diagonal, A->lost, w->blas);
    return pma_trapezoid_factor(R, width, height, diagonal, A->lost, w->blas);
}

static void scale_one(const pma_panels *p, size_t s, double *inverse)
{
    double *R = p->values + p->start[s];
    if (p->Q > 0)
        pma_trapezoid_scale_pair(R, R + p->Q, width_of(p, s), height_of(p, s), inverse);
    else
        pma_trapezoid_scale(R, width_of(p, s), height_of(p, s), inverse);
}

static pma_status factor_supernode(const walk *w, size_t s, const pma_panels_input *A,
                                   const int64_t *owner, double *diagonal, size_t *column)
{
    const pma_panels *p = w->p;
    const size_t begin = (size_t)p->first[s], width = width_of(p, s);
    pma_status status = fill_panel(w, s, A, diagonal);
    if (status != PMA_OK || (status = apply_updates(w, s, owner)) != PMA_OK)
        return status;
    const size_t good = factor_one(w, s, A, diagonal + begin);
    *column = begin + good;
    if (good < width)
        return PMA_NOT_DEFINITE;
    w->done[s] = 0;
    wait(w, s, owner);
    return PMA_OK;
}

pma_status pma_panels_factor(pma_panels *p, const pma_panels_input *input, const int64_t *owner,
                             const pma_blas *blas, double *inverse, double *update,
                             int64_t *integers, size_t *column, bool (*stop)(void *ctx), void *ctx)
{
    walk w = {.p = p,
              .blas = blas,
              .update = update,
              .head = integers,
              .next = integers + p->count,
              .done = integers + 2 * p->count,
              .place = integers + 3 * p->count,
              .unread = integers + 3 * p->count + input->n};
    memset(w.place, 0, input->n * sizeof *w.place);
    if (p->Q > 0)
        memcpy(w.unread, input->ptr, input->n * sizeof *w.unread);
    for (size_t s = 0; s < p->count; s++)
        w.head[s] = -1;
    for (size_t s = 0; s < p->count; s++) {
        const pma_status status = factor_supernode(&w, s, input, owner, inverse, column);
        if (status != PMA_OK)
            return status;
        if (stop(ctx))
            return PMA_STOPPED;
    }
    const pma_status status = p->Q > 0 ? check_growth(p, input, inverse, column) : PMA_OK;
    for (size_t s = 0; s < p->count && status == PMA_OK; s++)
        scale_one(p, s, inverse + p->first[s]);
    return status;
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* The supernodes of the columns from..to-1, which begin and end with one. */
static size_t supernode_at(const pma_panels *p, size_t column)
{
    size_t low = 0, high = p->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if ((size_t)p->first[middle] < column)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* One panel of R or Q as a sweep sees it, and where its unknowns are in x. */
typedef struct {
    size_t width, below, height;
    const double *values;
    const int32_t *rows;
    double *own;   /* unknowns of its columns */
    bool adjoined; /* the unknowns of its rows follow them without a gap */
} panel_view;

static panel_view view(const pma_panels *p, size_t s, size_t begin, size_t from, size_t lanes,
                       double *x)
{
    const size_t width = width_of(p, s), below = rows_of(p, s);
    const int32_t *rows = p->rows + p->row_ptr[s];
    const bool adjoined = below == 0 || rows[below - 1] == p->first[s + 1] + (int64_t)below - 1;
    return (panel_view){.width = width,
                        .below = below,
                        .height = width + below,
                        .values = p->values + begin + p->start[s],
                        .rows = rows,
                        .own = x + ((size_t)p->first[s] - from) * lanes,
                        .adjoined = adjoined};
}

/* The loops below are compiled twice, for one lane and for all of them. */

/* clang-format off: attributes are long, and a name begins its line */

__attribute__((always_inline)) static inline void
eliminate_supernode(const pma_kernel *kernel, const pma_panels *p, size_t s, size_t from,
                    const size_t lanes, double *x, double *work)
{
    void (*const eliminate)(const double *, size_t, size_t, size_t, double *) =
        lanes == 1 ? kernel->eliminate : kernel->eliminate_lanes;
    const panel_view v = view(p, s, 0, from, lanes, x);
    if (v.adjoined) {
        eliminate(v.values, v.height, v.height, v.width, v.own);
        return;
    }
    double *added = work + v.width * lanes;
    memcpy(work, v.own, v.width * lanes * sizeof *work);
    memset(added, 0, v.below * lanes * sizeof *work);
    eliminate(v.values, v.height, v.height, v.width, work);
    memcpy(v.own, work, v.width * lanes * sizeof *work);
    for (size_t i = 0; i < v.below; i++) {
        double *below = x + ((size_t)v.rows[i] - from) * lanes;
        for (size_t l = 0; l < lanes; l++)
            below[l] += added[i * lanes + l];
    }
}

__attribute__((always_inline)) static inline void
substitute_supernode(const pma_kernel *kernel, const pma_panels *p, const double *inverse, size_t s,
                     size_t from, const size_t lanes, double *x, double *work)
{
    void (*const substitute)(const double *, size_t, size_t, size_t, double *) =
        lanes == 1 ? kernel->substitute : kernel->substitute_lanes;
    const panel_view v = view(p, s, p->Q, from, lanes, x);
    for (size_t j = 0; j < v.width; j++) {
        for (size_t l = 0; l < lanes; l++)
            v.own[j * lanes + l] *= inverse[(size_t)p->first[s] + j];
    }
    if (v.adjoined) {
        substitute(v.values, v.height, v.height, v.width, v.own);
        return;
    }
    double *gathered = work + v.width * lanes;
    memcpy(work, v.own, v.width * lanes * sizeof *work);
    for (size_t i = 0; i < v.below; i++) {
        const double *below = x + ((size_t)v.rows[i] - from) * lanes;
        for (size_t l = 0; l < lanes; l++)
            gathered[i * lanes + l] = below[l];
    }
    substitute(v.values, v.height, v.height, v.width, work);
    memcpy(v.own, work, v.width * lanes * sizeof *work);
}

/* Supernodes from..to-1, or those of a list; x[0] is unknown `first`. */
typedef struct {
    const int64_t *list; /* or NULL */
    size_t from, to, first;
} range;

static size_t member_of(const range *r, size_t k)
{
    return r->list ? (size_t)r->list[k] : k;
}

__attribute__((always_inline)) static inline void
eliminate_range(const pma_panels *p, const range *r, const size_t lanes, double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    for (size_t k = r->from; k < r->to; k++)
        eliminate_supernode(kernel, p, member_of(r, k), r->first, lanes, x, work);
}

__attribute__((always_inline)) static inline void
substitute_range(const pma_panels *p, const double *inverse, const range *r, const size_t lanes,
                 double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    for (size_t k = r->to; k-- > r->from;)
        substitute_supernode(kernel, p, inverse, member_of(r, k), r->first, lanes, x, work);
}

/* clang-format on */

static void eliminate(const pma_panels *p, const range *r, size_t lanes, double *x, double *work)
{
    if (lanes == 1)
        eliminate_range(p, r, 1, x, work);
    else
        eliminate_range(p, r, PMA_LANES, x, work);
}

static void substitute(const pma_panels *p, const double *inverse, const range *r, size_t lanes,
                       double *x, double *work)
{
    if (lanes == 1)
        substitute_range(p, inverse, r, 1, x, work);
    else
        substitute_range(p, inverse, r, PMA_LANES, x, work);
}

void pma_panels_eliminate(const pma_panels *p, size_t lanes, size_t from, size_t to, double *x,
                          double *work)
{
    const range r = {.from = supernode_at(p, from), .to = supernode_at(p, to), .first = from};
    eliminate(p, &r, lanes, x, work);
}

void pma_panels_substitute(const pma_panels *p, const double *inverse, size_t lanes, size_t from,
                           size_t to, double *x, double *work)
{
    const range r = {.from = supernode_at(p, from), .to = supernode_at(p, to), .first = from};
    substitute(p, inverse, &r, lanes, x, work);
}

void pma_panels_eliminate_these(const pma_panels *p, const int64_t *supernodes, size_t count,
                                size_t lanes, double *x, double *work)
{
    eliminate(p, &(range){.list = supernodes, .to = count}, lanes, x, work);
}

void pma_panels_substitute_these(const pma_panels *p, const double *inverse,
                                 const int64_t *supernodes, size_t count, size_t lanes, double *x,
                                 double *work)
{
    substitute(p, inverse, &(range){.list = supernodes, .to = count}, lanes, x, work);
}
