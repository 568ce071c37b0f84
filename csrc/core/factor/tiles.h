/* tiles.h - C (m x n) := beta C + alpha A B', in tiles whose sums are in registers.
 *
 * Included once for each kind of processor, with `piece`, a vector of as many numbers as its
 * registers hold, TILE, which names the functions, and TARGET, their attribute. An entry of C is
 * the sum over the columns of A in their order, whatever tile it belongs to. */

/* Some pieces of rows, one below the other, and some columns. */
PMA_INLINE void TILE(multiply_tile)(const pma_product *x, const double *A, const double *B,
                                    double *C, const size_t pieces, const size_t columns)
{
    const size_t length = sizeof(piece) / sizeof(double);
    piece sum[COLUMNS][PIECES] = {{{0.0}}};
    for (size_t l = 0; l < x->k; l++) {
        const double *a = A + l * x->next_A, *b = B + l * x->along_B;
#pragma GCC unroll 4
        for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 2
            for (size_t r = 0; r < pieces; r++)
                sum[j][r] += *(const piece *)(a + r * length) * b[j * x->across_B];
        }
    }
#pragma GCC unroll 4
    for (size_t j = 0; j < columns; j++) {
#pragma GCC unroll 2
        for (size_t r = 0; r < pieces; r++) {
            piece *c = (piece *)(C + j * x->next_C + r * length);
            *c = x->beta == 0.0 ? x->alpha * sum[j][r] : x->beta * *c + x->alpha * sum[j][r];
        }
    }
}

PMA_INLINE void TILE(multiply_columns)(const pma_product *x, const double *B, double *C,
                                       const size_t columns)
{
    const size_t length = sizeof(piece) / sizeof(double);
    size_t i = 0;
    for (; i + PIECES * length <= x->m; i += PIECES * length)
        TILE(multiply_tile)(x, x->A + i, B, C + i, PIECES, columns);
    for (; i + length <= x->m; i += length)
        TILE(multiply_tile)(x, x->A + i, B, C + i, 1, columns);
    for (; i < x->m; i++)
        multiply_row(x, x->A + i, B, C + i, columns);
}

TARGET static void TILE(multiply)(const pma_product *x)
{
    size_t j = 0;
    for (; j + COLUMNS <= x->n; j += COLUMNS)
        TILE(multiply_columns)(x, x->B + j * x->across_B, x->C + j * x->next_C, COLUMNS);
    for (; j < x->n; j++)
        TILE(multiply_columns)(x, x->B + j * x->across_B, x->C + j * x->next_C, 1);
}
