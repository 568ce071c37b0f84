#include "algebra/path.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* ---- checks --------------------------------------------------------------------------------- */

/* The last k with list[k] <= value, in an ascending list that begins at or below it. */
static size_t last_not_above(const int64_t *list, size_t count, int64_t value)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (list[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static bool holds(const pma_path *path, const pma_panels *p, int64_t column)
{
    const int64_t s = (int64_t)last_not_above(p->first, p->count, column);
    return path->count > 0 &&
           path->supernodes[last_not_above(path->supernodes, path->count, s)] == s;
}

static pma_status check_permutation(const pma_path *path, size_t n)
{
    bool *taken = calloc(n + 1, sizeof *taken);
    pma_status status = taken ? PMA_OK : PMA_NO_MEMORY;
    for (size_t i = 0; i < n && status == PMA_OK; i++) {
        const int64_t k = path->place[i];
        if (k < 0 || (size_t)k >= n || taken[k])
            status = PMA_BAD_INDEX;
        else
            taken[k] = true;
    }
    free(taken);
    return status;
}

static bool ascends(const pma_path *path, const pma_panels *p)
{
    int64_t above = -1;
    for (size_t k = 0; k < path->count; k++) {
        if (path->supernodes[k] <= above || (size_t)path->supernodes[k] >= p->count)
            return false;
        above = path->supernodes[k];
    }
    return true;
}

pma_status pma_path_check(const pma_path *path, const pma_panels *p, size_t n, size_t nb)
{
    const pma_status status = check_permutation(path, n);
    if (status != PMA_OK)
        return status;
    if (!ascends(path, p))
        return PMA_BAD_INDEX;
    for (size_t k = 0; k < path->count; k++) {
        const int64_t s = path->supernodes[k], first = p->row_ptr[s];
        if (first < p->row_ptr[s + 1] && !holds(path, p, p->rows[first]))
            return PMA_BAD_INDEX;
    }
    for (size_t i = n - nb; i < n; i++) {
        if (!holds(path, p, path->place[i]))
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

size_t pma_path_entries(const pma_path *path, const pma_panels *p)
{
    size_t entries = 0;
    for (size_t k = 0; k < path->count; k++) {
        const int64_t s = path->supernodes[k];
        entries += (size_t)(p->start[s + 1] - p->start[s]);
    }
    return entries;
}

/* ---- sweeps --------------------------------------------------------------------------------- */

/* aside := y, or y += aside, or aside := 0 in the columns on the paths */
typedef enum { TAKE, ADD, CLEAR } passing;

static void pass(const pma_path *path, const pma_panels *p, passing how, size_t lanes, double *y,
                 double *aside)
{
    for (size_t k = 0; k < path->count; k++) {
        const int64_t s = path->supernodes[k];
        const size_t end = (size_t)p->first[s + 1] * lanes;
        for (size_t j = (size_t)p->first[s] * lanes; j < end; j++) {
            if (how == ADD)
                y[j] += aside[j];
            else
                aside[j] = how == TAKE ? y[j] : 0.0;
        }
    }
}

/* aside := P x, and back, for the unknowns from `begin` on; x[0] is unknown `begin` */
static void bring_in(const pma_path *path, size_t begin, size_t n, size_t lanes, const double *x,
                     double *aside)
{
    for (size_t i = begin; i < n; i++) {
        for (size_t l = 0; l < lanes; l++)
            aside[(size_t)path->place[i] * lanes + l] = x[(i - begin) * lanes + l];
    }
}

static void bring_back(const pma_path *path, size_t begin, size_t n, size_t lanes,
                       const double *aside, double *x)
{
    for (size_t i = begin; i < n; i++) {
        for (size_t l = 0; l < lanes; l++)
            x[(i - begin) * lanes + l] = aside[(size_t)path->place[i] * lanes + l];
    }
}

/* aside := R^-1 P xb, xb (nb) on the interface */
static void eliminate_interface(const pma_path *path, const pma_panels *p, size_t n, size_t nb,
                                size_t lanes, const double *xb, double *aside)
{
    pass(path, p, CLEAR, lanes, NULL, aside);
    bring_in(path, n - nb, n, lanes, xb, aside);
    pma_panels_eliminate_these(p, path->supernodes, path->count, lanes, aside, aside + n * lanes);
}

/* xb (nb) := (P^T R^-T D^-1 aside)_b */
static void substitute_interface(const pma_path *path, const pma_panels *p, const double *inverse,
                                 size_t n, size_t nb, size_t lanes, double *xb, double *aside)
{
    pma_panels_substitute_these(p, inverse, path->supernodes, path->count, lanes, aside,
                                aside + n * lanes);
    bring_back(path, n - nb, n, lanes, aside, xb);
}

void pma_path_open(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                   size_t nb, size_t lanes, double *x, double *xb, double *aside)
{
    bring_in(path, 0, n, lanes, x, aside);
    memcpy(x, aside, n * lanes * sizeof *x);
    pma_panels_eliminate(p, lanes, 0, n, x, aside + n * lanes);
    pass(path, p, TAKE, lanes, x, aside);
    substitute_interface(path, p, inverse, n, nb, lanes, xb, aside);
}

void pma_path_close(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                    size_t nb, size_t lanes, const double *fb, double *x, double *aside)
{
    eliminate_interface(path, p, n, nb, lanes, fb, aside);
    pass(path, p, ADD, lanes, x, aside);
    pma_panels_substitute(p, inverse, lanes, 0, n, x, aside + n * lanes);
    memcpy(aside, x, n * lanes * sizeof *x);
    bring_back(path, 0, n, lanes, aside, x);
}

void pma_path_interface(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                        size_t nb, size_t lanes, double *xb, double *aside)
{
    eliminate_interface(path, p, n, nb, lanes, xb, aside);
    substitute_interface(path, p, inverse, n, nb, lanes, xb, aside);
}

void pma_path_solve(const pma_path *path, const pma_panels *p, const double *inverse, size_t n,
                    size_t lanes, double *x, double *aside)
{
    bring_in(path, 0, n, lanes, x, aside);
    pma_panels_eliminate(p, lanes, 0, n, aside, aside + n * lanes);
    pma_panels_substitute(p, inverse, lanes, 0, n, aside, aside + n * lanes);
    bring_back(path, 0, n, lanes, aside, x);
}
