#include "algebra/panels.h"

#include <math.h>
#include <string.h>

#include "algebra/kernel.h"

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

/* ---- numeric part: left-looking, each panel as a dense Cholesky factor ---------------------- */

/* What the numeric part walks with. */
typedef struct {
    pma_panels *p;
    const pma_blas *blas;
    double *update;
    int64_t *head, *next; /* supernodes waiting to update each supernode */
    int64_t *done;        /* how many rows of a supernode have been used as columns */
    int64_t *place;       /* row -> row of the panel at hand */
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

/* Entries of the matrix in and below the diagonal block; what is above belongs to others. */
static pma_status fill_panel(const walk *w, size_t s, const pma_panels_input *A, double *diagonal)
{
    const pma_panels *p = w->p;
    const size_t width = width_of(p, s), height = height_of(p, s);
    double *panel = p->values + p->start[s];
    memset(panel, 0, width * height * sizeof *panel);
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

/* panel(s) -= R_d R_d^T in the rows and columns that supernode d shares with it */
static pma_status apply_update(const walk *w, size_t d, size_t begin, size_t end, size_t s)
{
    const pma_panels *p = w->p;
    const size_t height = height_of(p, s);
    const int32_t *rows = p->rows + p->row_ptr[d];
    for (size_t i = begin; i < rows_of(p, d); i++) {
        if (place_in(w, s, rows[i]) == height)
            return PMA_BAD_INDEX;
    }
    double *from = p->values + p->start[d] + width_of(p, d) + begin;
    double *panel = p->values + p->start[s];
    int m = (int)(rows_of(p, d) - begin), columns = (int)(end - begin), k = (int)width_of(p, d);
    int ld = (int)height_of(p, d);
    double one = 1.0, zero = 0.0;
    w->blas->dgemm("N", "T", &m, &columns, &k, &one, from, &ld, from, &ld, &zero, w->update, &m);
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

/* Columns of a dense Cholesky factor made before what is right of them is updated. */
enum { BLOCK = 48 };

/* Cholesky factor of a small block, column by column; `columns` or the first that fails */
static size_t factor_block(double *block, size_t columns, size_t ld, const double *diagonal,
                           double lost)
{
    for (size_t j = 0; j < columns; j++) {
        double *column = block + j * ld;
        if (!(column[j] > lost * fabs(diagonal[j])))
            return j;
        const double root = sqrt(column[j]);
        column[j] = root;
        for (size_t i = j + 1; i < columns; i++)
            column[i] /= root;
        for (size_t k = j + 1; k < columns; k++) {
            for (size_t i = k; i < columns; i++)
                block[k * ld + i] -= column[i] * column[k];
        }
    }
    return columns;
}

/* Cholesky factor of a whole panel, in blocks; its width or the first column that fails */
static size_t factor_panel(double *panel, size_t width, size_t height, const double *diagonal,
                           double lost, const pma_blas *blas)
{
    double one = 1.0, minus = -1.0;
    int ld = (int)height;
    for (size_t begin = 0; begin < width; begin += BLOCK) {
        const size_t columns = width - begin < BLOCK ? width - begin : BLOCK;
        const size_t end = begin + columns;
        double *block = panel + begin * height + begin, *below = block + columns;
        const size_t good = factor_block(block, columns, height, diagonal + begin, lost);
        int m = (int)(height - end), k = (int)columns, right = (int)(width - end);
        if (good < columns)
            return begin + good;
        if (m == 0)
            continue;
        blas->dtrsm("R", "L", "T", "N", &m, &k, &one, block, &ld, below, &ld);
        if (right > 0)
            blas->dgemm("N", "T", &m, &right, &k, &minus, below, &ld, below, &ld, &one,
                        panel + end * height + end, &ld);
    }
    return width;
}

/* From the Cholesky factor to a unit diagonal: R_ij = G_ij / G_jj, D_j = G_jj^2 */
static void scale_panel(double *panel, size_t width, size_t height, double *inverse)
{
    for (size_t j = 0; j < width; j++) {
        double *column = panel + j * height;
        const double root = column[j];
        inverse[j] = 1.0 / (root * root);
        column[j] = 1.0;
        for (size_t i = j + 1; i < height; i++)
            column[i] /= root;
    }
}

static pma_status factor_supernode(const walk *w, size_t s, const pma_panels_input *A,
                                   const int64_t *owner, double *diagonal, size_t *column)
{
    const pma_panels *p = w->p;
    const size_t begin = (size_t)p->first[s], width = width_of(p, s);
    pma_status status = fill_panel(w, s, A, diagonal);
    if (status != PMA_OK || (status = apply_updates(w, s, owner)) != PMA_OK)
        return status;
    const size_t good = factor_panel(p->values + p->start[s], width, height_of(p, s),
                                     diagonal + begin, A->lost, w->blas);
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
              .place = integers + 3 * p->count};
    memset(w.place, 0, input->n * sizeof *w.place);
    for (size_t s = 0; s < p->count; s++)
        w.head[s] = -1;
    for (size_t s = 0; s < p->count; s++) {
        const pma_status status = factor_supernode(&w, s, input, owner, inverse, column);
        if (status != PMA_OK)
            return status;
        if (stop(ctx))
            return PMA_STOPPED;
    }
    for (size_t s = 0; s < p->count; s++)
        scale_panel(p->values + p->start[s], width_of(p, s), height_of(p, s),
                    inverse + p->first[s]);
    return PMA_OK;
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

/* One panel as a sweep sees it, and where its unknowns are in x. */
typedef struct {
    size_t width, below, height;
    const double *values;
    const int32_t *rows;
    double *own;   /* unknowns of its columns */
    bool adjoined; /* the unknowns of its rows follow them without a gap */
} panel_view;

static panel_view view(const pma_panels *p, size_t s, size_t from, double *x)
{
    const size_t width = width_of(p, s), below = rows_of(p, s);
    const int32_t *rows = p->rows + p->row_ptr[s];
    const bool adjoined = below == 0 || rows[below - 1] == p->first[s + 1] + (int64_t)below - 1;
    return (panel_view){.width = width,
                        .below = below,
                        .height = width + below,
                        .values = p->values + p->start[s],
                        .rows = rows,
                        .own = x + ((size_t)p->first[s] - from),
                        .adjoined = adjoined};
}

static void eliminate_panel(const pma_kernel *kernel, const panel_view *v, size_t from, double *x,
                            double *work)
{
    memcpy(work, v->own, v->width * sizeof *work);
    memset(work + v->width, 0, v->below * sizeof *work);
    kernel->eliminate(v->values, v->height, v->height, v->width, work);
    memcpy(v->own, work, v->width * sizeof *work);
    for (size_t i = 0; i < v->below; i++)
        x[(size_t)v->rows[i] - from] += work[v->width + i];
}

static void substitute_panel(const pma_kernel *kernel, const panel_view *v, size_t from,
                             const double *x, double *work)
{
    memcpy(work, v->own, v->width * sizeof *work);
    for (size_t i = 0; i < v->below; i++)
        work[v->width + i] = x[(size_t)v->rows[i] - from];
    kernel->substitute(v->values, v->height, v->height, v->width, work);
    memcpy(v->own, work, v->width * sizeof *work);
}

static void eliminate_supernode(const pma_kernel *kernel, const pma_panels *p, size_t s,
                                size_t from, double *x, double *work)
{
    const panel_view v = view(p, s, from, x);
    if (v.adjoined)
        kernel->eliminate(v.values, v.height, v.height, v.width, v.own);
    else
        eliminate_panel(kernel, &v, from, x, work);
}

static void substitute_supernode(const pma_kernel *kernel, const pma_panels *p,
                                 const double *inverse, size_t s, size_t from, double *x,
                                 double *work)
{
    const panel_view v = view(p, s, from, x);
    for (size_t j = 0; j < v.width; j++)
        v.own[j] *= inverse[(size_t)p->first[s] + j];
    if (v.adjoined)
        kernel->substitute(v.values, v.height, v.height, v.width, v.own);
    else
        substitute_panel(kernel, &v, from, x, work);
}

void pma_panels_eliminate(const pma_panels *p, size_t from, size_t to, double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    for (size_t s = supernode_at(p, from); s < p->count && (size_t)p->first[s] < to; s++)
        eliminate_supernode(kernel, p, s, from, x, work);
}

void pma_panels_substitute(const pma_panels *p, const double *inverse, size_t from, size_t to,
                           double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    const size_t begin = supernode_at(p, from);
    for (size_t s = supernode_at(p, to); s-- > begin;)
        substitute_supernode(kernel, p, inverse, s, from, x, work);
}

void pma_panels_eliminate_these(const pma_panels *p, const int64_t *supernodes, size_t count,
                                double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    for (size_t k = 0; k < count; k++)
        eliminate_supernode(kernel, p, (size_t)supernodes[k], 0, x, work);
}

void pma_panels_substitute_these(const pma_panels *p, const double *inverse,
                                 const int64_t *supernodes, size_t count, double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    for (size_t k = count; k-- > 0;)
        substitute_supernode(kernel, p, inverse, (size_t)supernodes[k], 0, x, work);
}
