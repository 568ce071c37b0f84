#include "algebra/panels.h"

#include <string.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"
#include "algebra/lists.h"

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
            p->start[s + 1] - p->start[s] !=
                (int64_t)(pma_panels_width(p, s) * pma_panels_height(p, s)))
            return PMA_BAD_INDEX;
        border = border || p->first[s] == (int64_t)(n - nb);
    }
    return border ? PMA_OK : PMA_BAD_INDEX;
}

pma_status pma_panels_check_owners(const pma_panels *p, size_t n, const int64_t *owner)
{
    for (size_t j = 0; j < n; j++) {
        const int64_t s = owner[j], column = (int64_t)j;
        if (s < 0 || (size_t)s >= p->count || p->first[s] > column || p->first[s + 1] <= column)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

size_t pma_panels_most_height(const pma_panels *p)
{
    size_t most = 0;
    for (size_t s = 0; s < p->count; s++)
        most = pma_panels_height(p, s) > most ? pma_panels_height(p, s) : most;
    return most;
}

/* ---- sweeps --------------------------------------------------------------------------------- */

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
    const size_t width = pma_panels_width(p, s), below = pma_panels_rows(p, s);
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

__attribute__((always_inline)) static inline void eliminate_range(const pma_panels *p, size_t from,
                                                                  size_t to, const size_t lanes,
                                                                  double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    const size_t end = pma_start_of(p->first, p->count, to);
    for (size_t s = pma_start_of(p->first, p->count, from); s < end; s++)
        eliminate_supernode(kernel, p, s, from, lanes, x, work);
}

__attribute__((always_inline)) static inline void
substitute_range(const pma_panels *p, const double *inverse, size_t from, size_t to,
                 const size_t lanes, double *x, double *work)
{
    const pma_kernel *kernel = pma_kernel_best();
    const size_t first = pma_start_of(p->first, p->count, from);
    for (size_t s = pma_start_of(p->first, p->count, to); s-- > first;)
        substitute_supernode(kernel, p, inverse, s, from, lanes, x, work);
}

/* clang-format on */

void pma_panels_eliminate(const pma_panels *p, size_t lanes, size_t from, size_t to, double *x,
                          double *work)
{
    if (lanes == 1)
        eliminate_range(p, from, to, 1, x, work);
    else
        eliminate_range(p, from, to, PMA_LANES, x, work);
}

void pma_panels_substitute(const pma_panels *p, const double *inverse, size_t lanes, size_t from,
                           size_t to, double *x, double *work)
{
    if (lanes == 1)
        substitute_range(p, inverse, from, to, 1, x, work);
    else
        substitute_range(p, inverse, from, to, PMA_LANES, x, work);
}
