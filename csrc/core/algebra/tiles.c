#include "algebra/tiles.h"

#include <stdint.h>
#include <stdlib.h>

/* What the tiles of a wave may take together with their vectors, in bytes: a third of a last cache of
 * 32 MB, which other threads and programs use too. Measured; twice as much gains nothing. */
enum { WAVE = 10000000 };

/* Bytes of a number of the matrix with its share of an index, and of the vectors of a row. */
enum { PER_ENTRY = 10, PER_ROW = 64 };

/* Rows of a tile, so that the call of a stage does not count; fewest tiles for each step of a wave. */
enum { LEAST_ROWS = 64, LEAST_TILES = 3 };

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

static size_t most(size_t a, size_t b)
{
    return a > b ? a : b;
}

/* ---- an order of the rows ------------------------------------------------------------------- */

/* The columns of a row, also those that are stored with a zero. */
static const int32_t *columns_of(const pma_matrix *A, size_t row, size_t *count)
{
    const bool strips = A->form == PMA_STRIPS;
    const size_t i = strips ? pma_strips_at(&A->strips, row) : row;
    const int64_t *ptr = strips ? A->strips.ptr : A->ptr;
    *count = (size_t)(ptr[i + 1] - ptr[i]);
    return (strips ? A->strips.index : A->index) + ptr[i];
}

/* Where one of the last rows belongs among the others: the middle of its columns among them; after
 * the first rows where it has none. */
static size_t middle_of(const pma_matrix *A, size_t row, size_t others)
{
    size_t count, low = others, high = 0;
    const int32_t *columns = columns_of(A, row, &count);
    for (size_t k = 0; k < count; k++) {
        const size_t column = (size_t)columns[k];
        if (column < others) {
            low = least(low, column);
            high = most(high, column);
        }
    }
    return low < others ? low + (high - low) / 2 : 0;
}

/* rank (n): where each row is when the last ones are put among the others; start (n + 1): scratch */
static void rank_rows(const pma_matrix *A, size_t last, size_t *rank, size_t *start)
{
    const size_t n = A->n, others = n - last;
    for (size_t i = 0; i <= n; i++)
        start[i] = 0;
    for (size_t i = others; i < n; i++) {
        rank[i] = middle_of(A, i, others);
        start[rank[i] + 1]++; /* so many follow that row */
    }
    for (size_t i = 0; i < n; i++)
        start[i + 1] += start[i];
    for (size_t i = 0; i < others; i++)
        rank[i] = i + start[i];
    for (size_t i = others; i < n; i++)
        rank[i] = rank[i] + 1 + start[rank[i]]++;
}

/* far (n): how far rows up to this rank are coupled, to either side of the diagonal */
static void find_reach(const pma_matrix *A, const size_t *rank, size_t *far)
{
    for (size_t i = 0; i < A->n; i++)
        far[i] = i;
    for (size_t i = 0; i < A->n; i++) {
        size_t count;
        const int32_t *columns = columns_of(A, i, &count);
        for (size_t k = 0; k < count; k++) {
            const size_t a = rank[i], b = rank[columns[k]];
            far[least(a, b)] = most(far[least(a, b)], most(a, b));
        }
    }
    for (size_t i = 1; i < A->n; i++)
        far[i] = most(far[i], far[i - 1]);
}

/* ---- tiles ---------------------------------------------------------------------------------- */

/* edge (count + 1): the first rank of each tile, such that those of a tile are coupled up to the end
 * of the next one; returns how many there are. */
static size_t cut(size_t n, const size_t *far, size_t *edge)
{
    size_t count = 1;
    edge[0] = 0;
    edge[1] = least(LEAST_ROWS, n);
    while (edge[count] < n) {
        const size_t end = edge[count];
        edge[count + 1] = least(n, most(end + LEAST_ROWS, far[end - 1] + 1));
        count++;
    }
    return count;
}

/* Steps for which the largest tiles of a wave stay in the cache; 0 where they are too large, or too
 * few for a wave. */
static size_t find_depth(const pma_matrix *A, size_t count, const size_t *edge)
{
    size_t rows = 0;
    for (size_t t = 0; t < count; t++)
        rows = most(rows, edge[t + 1] - edge[t]);
    const double entries = (double)pma_matrix_entries(A) / (double)A->n;
    const double tile = (double)rows * (PER_ENTRY * entries + PER_ROW);
    const size_t tiles = (size_t)(WAVE / tile);
    const size_t depth = least(tiles > 0 ? tiles - 1 : 0, count / LEAST_TILES);
    return depth < 2 ? 0 : depth;
}

/* Rows of a tile that follow one another are a range; tile (n): that of each row. */
static void lay_out(size_t n, const size_t *tile, pma_tiles *out)
{
    size_t *next = out->ptr + 1; /* one place ahead, until the ranges are written */
    for (size_t t = 0; t <= out->count; t++)
        out->ptr[t] = 0;
    for (size_t i = 0; i < n; i++) {
        if ((i == 0 || tile[i] != tile[i - 1]) && tile[i] + 1 < out->count)
            next[tile[i] + 1]++;
    }
    for (size_t t = 1; t < out->count; t++)
        next[t] += next[t - 1];
    for (size_t i = 0; i < n; i++) {
        const size_t r = next[tile[i]];
        if (i == 0 || tile[i] != tile[i - 1])
            out->begin[r] = i;
        if (i + 1 == n || tile[i + 1] != tile[i]) {
            out->end[r] = i + 1;
            next[tile[i]]++;
        }
    }
}

pma_status pma_tiles_create(const pma_matrix *A, size_t last, pma_tiles *out)
{
    const size_t n = A->n;
    *out = (pma_tiles){.count = 0};
    if ((A->form != PMA_SPARSE && A->form != PMA_STRIPS) || last == n)
        return PMA_OK;
    size_t *scratch = calloc(3 * n + 2, sizeof *scratch);
    out->block = calloc(3 * n + 1, sizeof *out->block);
    if (!scratch || !out->block) {
        free(scratch);
        pma_tiles_destroy(out);
        return PMA_NO_MEMORY;
    }
    size_t *rank = scratch, *far = scratch + n, *edge = far + n;
    rank_rows(A, last, rank, far);
    find_reach(A, rank, far);
    out->count = cut(n, far, edge);
    out->depth = find_depth(A, out->count, edge);
    if (out->depth > 0) {
        for (size_t t = 0; t < out->count; t++) {
            for (size_t i = edge[t]; i < edge[t + 1]; i++)
                far[i] = t; /* by rank */
        }
        for (size_t i = 0; i < n; i++)
            rank[i] = far[rank[i]];
        out->ptr = out->block;
        out->begin = out->ptr + n + 1;
        out->end = out->begin + n;
        lay_out(n, rank, out);
    } else {
        pma_tiles_destroy(out);
    }
    free(scratch);
    return PMA_OK;
}

void pma_tiles_destroy(pma_tiles *tiles)
{
    free(tiles->block);
    *tiles = (pma_tiles){.count = 0};
}

/* ---- a wave --------------------------------------------------------------------------------- */

static bool do_tile(const pma_tiles *tiles, size_t t, size_t k, pma_tile_stage stage, void *context)
{
    bool finite = true;
    for (size_t r = tiles->ptr[t]; r < tiles->ptr[t + 1]; r++)
        finite = stage(context, k, tiles->begin[r], tiles->end[r]) && finite;
    return finite;
}

bool pma_tiles_advance(const pma_tiles *tiles, size_t steps, pma_tile_stage stage, void *context)
{
    bool finite = true;
    for (size_t front = 0; front < tiles->count + steps; front++) {
        for (size_t k = 0; k <= least(front, steps); k++) {
            if (front - k < tiles->count)
                finite = do_tile(tiles, front - k, k, stage, context) && finite;
        }
    }
    return finite;
}
