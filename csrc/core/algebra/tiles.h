/* tiles.h - the rows of a sparse matrix in tiles, each coupled with its two neighbours alone.
 *
 * Of steps x_k+1 = f(x_k, A x_k), a tile can take its k-th when its neighbours have taken theirs
 * before it. So a wave over the tiles takes several steps, each one tile behind the one before, and
 * reads A once for all of them while the tiles between first and last stay in the cache: time
 * skewing. */
#ifndef PMA_TILES_H
#define PMA_TILES_H

#include <stdbool.h>
#include <stddef.h>

#include "algebra/matrix.h"
#include "status.h"

/* Tile t has the ranges ptr[t]..ptr[t+1]-1, each of the rows begin[r]..end[r]-1. */
typedef struct {
    size_t count; /* tiles; 0 where a wave would not pay */
    size_t depth; /* steps for which the tiles of a wave stay in the cache */
    size_t *ptr, *begin, *end;
    size_t *block;
} pma_tiles;

/* Tiles of a matrix of which the last `last` rows may be coupled with any others: each of them goes to
 * the tile in the middle of its columns. PMA_NO_MEMORY alone. */
pma_status pma_tiles_create(const pma_matrix *A, size_t last, pma_tiles *out);
void pma_tiles_destroy(pma_tiles *tiles);

/* Stage k = 0..steps of the rows begin..end-1, which comes after stage k - 1 of all rows that they are
 * coupled with, and before stage k + 1 of any of them. False: something is not finite. */
typedef bool (*pma_tile_stage)(void *context, size_t k, size_t begin, size_t end);

/* All stages of all tiles in a wave; false when one of them was. Does not allocate. */
bool pma_tiles_advance(const pma_tiles *tiles, size_t steps, pma_tile_stage stage, void *context);

#endif
