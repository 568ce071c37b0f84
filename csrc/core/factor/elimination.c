#include "factor/elimination.h"

#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#include "algebra/lanes.h"
#include "algebra/lists.h"
#include "factor/symbolic.h"
#include "factor/trapezoid.h"
#include "memory.h"
#include "object.h"

/* How often a worker looks for an update before it rests. */
enum { LOOKS = 2000 };

/* Doubles of a line of the cache: arrays of two workers share none. */
enum { LINE = PMA_LANES };

/* A worker, and the first of the supernodes that went wrong in its hands. */
typedef struct {
    double *update;    /* what is subtracted from a panel */
    int64_t *position; /* n: row -> row of the panel at hand */
    size_t failed, column;
    pma_status status;
} hand;

struct pma_elimination {
    pma_panels panels;
    const pma_panels *p; /* those */
    size_t n, workers;
    pma_blas blas;
    pma_agenda agenda;
    hand *hands;
    double *scratch;      /* of all hands */
    atomic_bool *done;    /* supernodes */
    atomic_size_t next;   /* task */
    atomic_size_t failed; /* the first supernode that is known to have, or SIZE_MAX */
    atomic_bool stopped;
    const pma_panels_input *A; /* since begun */
    double *inverse;
    const pma_patience *patience;
};

/* ---- making --------------------------------------------------------------------------------- */

/* The largest product of a supernode and its rows is no larger than the widest times the most. */
static size_t update_size(const pma_panels *p)
{
    size_t widest = 0, most = 0;
    for (size_t s = 0; s < p->count; s++) {
        widest = pma_panels_width(p, s) > widest ? pma_panels_width(p, s) : widest;
        most = pma_panels_rows(p, s) > most ? pma_panels_rows(p, s) : most;
    }
    return (widest * most + LINE) / LINE * LINE;
}

pma_status pma_elimination_create(const pma_panels *p, size_t n, const int64_t *owner,
                                  const pma_blas *blas, size_t workers, pma_elimination **out)
{
    const size_t update = update_size(p), position = (n + LINE) / LINE * LINE;
    const pma_array arrays[] = {
        {offsetof(pma_elimination, scratch), workers, (update + position) * sizeof(double)},
        PMA_ARRAY(pma_elimination, hands, workers),
        PMA_ARRAY(pma_elimination, done, p->count),
        {0}};
    pma_elimination *e = *out = pma_object_create(sizeof *e, arrays);
    if (!e)
        return PMA_NO_MEMORY;
    e->panels = *p;
    e->p = &e->panels;
    e->n = n;
    e->workers = workers;
    e->blas = *blas;
    for (size_t w = 0; w < workers; w++) {
        e->hands[w].update = e->scratch + w * (update + position);
        e->hands[w].position = (int64_t *)(void *)(e->hands[w].update + update);
    }
    const pma_status status = pma_agenda_create(p, owner, workers, &e->agenda);
    if (status != PMA_OK) {
        pma_memory_release(e);
        *out = NULL;
    }
    return status;
}

void pma_elimination_destroy(pma_elimination *e)
{
    if (e)
        pma_agenda_destroy(&e->agenda);
    pma_memory_release(e);
}

/* ---- one supernode: left-looking; a symmetric panel as a dense factor G S G^T --------------- */

/* The row of the panel that a row of the matrix is, or its height when it is none. */
static size_t position_in(const pma_panels *p, const hand *h, size_t s, int64_t row)
{
    const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
    const size_t position = (size_t)h->position[row];
    if (position < width)
        return p->first[s] + (int64_t)position == row ? position : height;
    if (position < height && p->rows[p->row_ptr[s] + (int64_t)(position - width)] == row)
        return position;
    return height;
}

/* The entry (row, column), found among ascending ones. */
static pma_status read_across(const pma_panels_input *A, size_t row, int64_t column, double *entry)
{
    const int64_t end = A->ptr[row + 1];
    const int64_t k = pma_position_of(A->index, A->ptr[row], end, (size_t)column);
    if (k == end || A->index[k] != column)
        return PMA_BAD_INDEX;
    *entry += A->values[k];
    return PMA_OK;
}

static void place_rows(const pma_panels *p, size_t s, const hand *h)
{
    const size_t width = pma_panels_width(p, s);
    for (size_t i = 0; i < width; i++)
        h->position[p->first[s] + (int64_t)i] = (int64_t)i;
    for (size_t i = 0; i < pma_panels_rows(p, s); i++)
        h->position[p->rows[p->row_ptr[s] + (int64_t)i]] = (int64_t)(width + i);
}

/* Entries of the matrix in and below the diagonal block, and those across the diagonal from them;
 * the others belong to other panels. Row j of A is column j of A^T, which Q is made of. */
static pma_status fill_panel(const pma_elimination *e, size_t s, const hand *h)
{
    const pma_panels *p = e->p;
    const pma_panels_input *A = e->A;
    const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
    double *R = p->values + p->start[s], *panel = R + p->Q;
    memset(panel, 0, width * height * sizeof *panel);
    if (p->Q > 0)
        memset(R, 0, width * height * sizeof *R);
    place_rows(p, s, h);
    for (size_t j = 0; j < width; j++) {
        const int64_t column = p->first[s] + (int64_t)j;
        for (int64_t k = A->ptr[column]; k < A->ptr[column + 1]; k++) {
            if (A->index[k] < column)
                continue;
            const size_t position = position_in(p, h, s, A->index[k]);
            if (position == height)
                return PMA_BAD_INDEX;
            panel[j * height + position] += A->values[k];
            if (p->Q > 0 &&
                read_across(A, (size_t)A->index[k], column, R + j * height + position) != PMA_OK)
                return PMA_BAD_INDEX;
        }
        e->inverse[column] = panel[j * height + j];
    }
    return PMA_OK;
}

static void subtract(const double *u, size_t count, double *x)
{
#pragma omp simd
    for (size_t i = 0; i < count; i++)
        x[i] -= u[i];
}

static void scatter(const double *u, const int32_t *rows, const int64_t *position, size_t begin,
                    size_t end, double *column)
{
    for (size_t i = begin; i < end; i++)
        column[position[rows[i]]] -= u[i];
}

/* X(s) -= X_d Y_d^T in the rows and columns that supernode d shares with it; X and Y are R and Q,
 * by where they begin in the values */
static void update_panel(const pma_elimination *e, const hand *h, size_t d, size_t begin,
                         size_t end, size_t s, size_t X, size_t Y)
{
    const pma_panels *p = e->p;
    const size_t height = pma_panels_height(p, s), k = pma_panels_width(p, d);
    const size_t m = pma_panels_rows(p, d) - begin, columns = end - begin;
    const int32_t *rows = p->rows + p->row_ptr[d];
    double *values = p->values + p->start[d], *panel = p->values + X + p->start[s];
    const pma_block source = {values, pma_panels_height(p, d)}, update = {h->update, m};
    const pma_block below = pma_block_at(source, k + begin, 0);
    if (p->Q > 0)
        pma_blas_multiply(&e->blas, m, columns, k, 1.0, (pma_block){below.values + X, below.next},
                          (pma_block){below.values + Y, below.next}, true, 0.0, update);
    else
        pma_trapezoid_multiply(source, k, 1.0, below, m, below, columns, 0.0, update, &e->blas);
    const int64_t first = h->position[rows[begin]];
    const bool adjoined = h->position[rows[begin + m - 1]] == first + (int64_t)m - 1;
    for (size_t j = 0; j < columns; j++) {
        double *column = panel + (size_t)h->position[rows[begin + j]] * height;
        const double *u = h->update + j * m;
        if (adjoined)
            subtract(u + j, m - j, column + first + j);
        else
            scatter(u, rows + begin, h->position, j, m, column);
    }
}

static pma_status apply_update(const pma_elimination *e, const hand *h, size_t d, size_t begin,
                               size_t s)
{
    const pma_panels *p = e->p;
    const int32_t *rows = p->rows + p->row_ptr[d];
    size_t end = begin;
    for (size_t i = begin; i < pma_panels_rows(p, d); i++) {
        if (position_in(p, h, s, rows[i]) == pma_panels_height(p, s))
            return PMA_BAD_INDEX;
        end += rows[i] < p->first[s + 1];
    }
    update_panel(e, h, d, begin, end, s, 0, p->Q);
    if (p->Q > 0)
        update_panel(e, h, d, begin, end, s, p->Q, 0);
    return PMA_OK;
}

static size_t factor_panel(const pma_elimination *e, size_t s)
{
    const pma_panels *p = e->p;
    double *R = p->values + p->start[s], *diagonal = e->inverse + p->first[s];
    const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
    if (p->Q > 0)
        return pma_trapezoid_factor_pair(R, R + p->Q, width, height, diagonal, e->A->lost,
                                         &e->blas);
    return pma_trapezoid_factor(R, width, height, diagonal, e->A->lost, e->A->indefinite, &e->blas);
}

/* ---- workers -------------------------------------------------------------------------------- */

/* Is what supernode s would become of no use any more? */
static bool is_void(const pma_elimination *e, size_t s)
{
    return atomic_load(&e->stopped) || atomic_load(&e->failed) < s;
}

void pma_elimination_look(pma_elimination *e)
{
    if (!atomic_load(&e->stopped) && e->patience->stop(e->patience->ctx))
        atomic_store(&e->stopped, true);
}

/* False where supernode d will not be done, or nobody wants s any more. */
static bool wait_for(pma_elimination *e, size_t worker, size_t d, size_t s)
{
    for (size_t looks = 1; !atomic_load_explicit(&e->done[d], memory_order_acquire); looks++) {
        if (is_void(e, s))
            return false;
        if (looks % LOOKS != 0)
            continue;
        if (e->patience->rest)
            e->patience->rest();
        if (worker == 0)
            pma_elimination_look(e);
    }
    return true;
}

/* Workers go on with supernodes before the one that failed: the first of all is to be found. */
static void fail(pma_elimination *e, hand *h, size_t s, pma_status status, size_t column)
{
    size_t first = atomic_load(&e->failed);
    while (s < first && !atomic_compare_exchange_weak(&e->failed, &first, s)) {
    }
    if (s >= h->failed)
        return;
    h->failed = s;
    h->status = status;
    h->column = column;
}

static void make_supernode(pma_elimination *e, size_t worker, size_t s)
{
    hand *h = &e->hands[worker];
    const pma_agenda *a = &e->agenda;
    pma_status status = fill_panel(e, s, h);
    for (size_t k = a->update[s]; k < a->update[s + 1] && status == PMA_OK; k++) {
        if (!wait_for(e, worker, a->source[k], s))
            return;
        status = apply_update(e, h, a->source[k], a->row[k], s);
    }
    const size_t width = pma_panels_width(e->p, s);
    const size_t good = status == PMA_OK ? factor_panel(e, s) : width;
    if (good < width)
        status = PMA_NOT_DEFINITE;
    if (status == PMA_OK)
        atomic_store_explicit(&e->done[s], true, memory_order_release);
    else
        fail(e, h, s, status, (size_t)e->p->first[s] + good);
}

void pma_elimination_begin(pma_elimination *e, const pma_panels_input *input, double *inverse,
                           const pma_patience *patience)
{
    e->A = input;
    e->inverse = inverse;
    e->patience = patience;
    atomic_store(&e->next, 0);
    atomic_store(&e->failed, SIZE_MAX);
    atomic_store(&e->stopped, false);
    for (size_t s = 0; s < e->p->count; s++)
        atomic_store_explicit(&e->done[s], false, memory_order_relaxed);
    for (size_t w = 0; w < e->workers; w++) {
        hand *h = &e->hands[w];
        memset(h->position, 0, e->n * sizeof *h->position);
        h->failed = SIZE_MAX;
        h->status = PMA_OK;
    }
}

void pma_elimination_work(pma_elimination *e, size_t worker)
{
    for (size_t t; (t = atomic_fetch_add(&e->next, 1)) < e->agenda.tasks;) {
        for (size_t s = e->agenda.first[t]; s <= e->agenda.last[t] && !is_void(e, s); s++) {
            make_supernode(e, worker, s);
            if (worker == 0)
                pma_elimination_look(e);
        }
    }
}

/* ---- the end -------------------------------------------------------------------------------- */

/* R is a unit factor, Q that of A^T still times D; or both are G. n, or the first row of this panel
 * from whose diagonal entry too much was subtracted                                       (F11) */
static size_t grown_row(const pma_elimination *e, size_t s)
{
    const pma_panels *p = e->p;
    const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
    const size_t first = (size_t)p->first[s];
    const int32_t *rows = p->rows + p->row_ptr[s];
    const double *R = p->values + p->start[s], *Q = R + p->Q;
    for (size_t j = 0; j < width; j++) {
        for (size_t i = j + 1; i < height; i++) {
            const size_t row = i < width ? first + i : (size_t)rows[i - width];
            const double most = e->A->growth * fabs(e->inverse[row]);
            if (!(fabs(R[j * height + i] * Q[j * height + i]) <= most))
                return row;
        }
    }
    return e->n;
}

static bool has_negative_pivot(const pma_panels *p)
{
    for (size_t s = 0; s < p->count; s++) {
        const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
        for (size_t j = 0; j < width; j++) {
            if (signbit(p->values[p->start[s] + (int64_t)(j * height + j)]))
                return true;
        }
    }
    return false;
}

static pma_status check_growth(const pma_elimination *e, size_t *column)
{
    *column = e->n;
    for (size_t s = 0; s < e->p->count && *column == e->n; s++)
        *column = grown_row(e, s);
    return *column == e->n ? PMA_OK : PMA_NOT_DEFINITE;
}

static void scale(const pma_panels *p, size_t s, double *inverse)
{
    double *R = p->values + p->start[s];
    const size_t width = pma_panels_width(p, s), height = pma_panels_height(p, s);
    if (p->Q > 0)
        pma_trapezoid_scale_pair(R, R + p->Q, width, height, inverse);
    else
        pma_trapezoid_scale(R, width, height, inverse);
}

/* What went wrong in the first supernode of all. */
static pma_status take_status(const pma_elimination *e, size_t *column)
{
    const hand *first = &e->hands[0];
    for (size_t w = 1; w < e->workers; w++) {
        if (e->hands[w].failed < first->failed)
            first = &e->hands[w];
    }
    if (first->status != PMA_OK)
        *column = first->column;
    return first->status;
}

pma_status pma_elimination_end(pma_elimination *e, size_t *column)
{
    if (atomic_load(&e->stopped))
        return PMA_STOPPED;
    pma_status status = take_status(e, column);
    if (status == PMA_OK && (e->p->Q > 0 || has_negative_pivot(e->p)))
        status = check_growth(e, column);
    for (size_t s = 0; s < e->p->count && status == PMA_OK; s++)
        scale(e->p, s, e->inverse + e->p->first[s]);
    return status;
}

pma_status pma_elimination_run(pma_elimination *e, const pma_panels_input *input, double *inverse,
                               const pma_patience *patience, size_t *column)
{
    pma_elimination_begin(e, input, inverse, patience);
    pma_elimination_work(e, 0);
    return pma_elimination_end(e, column);
}
