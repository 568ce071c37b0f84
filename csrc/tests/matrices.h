/* matrices.h - matrices for the tests of factors: of a known factor, and on the way to panels. */
#ifndef PMA_TEST_MATRICES_H
#define PMA_TEST_MATRICES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "algebra/factor.h"
#include "algebra/panels.h"
#include "factor/elimination.h"
#include "naive.h"

/* ---- rows without zeros --------------------------------------------------------------------- */

/* The rows of a dense matrix without its zeros. */
typedef struct {
    int64_t ptr[SIZE + 1];
    int32_t index[SIZE * SIZE];
    double values[SIZE * SIZE];
} compressed;

compressed compress(size_t n, const double *rows);

/* ---- matrices whose factor is known --------------------------------------------------------- */

/* A = R D Q^T, made from its factors, so that nothing is ever factored; Q is R if symmetric. */
typedef struct {
    size_t n;
    double R[SIZE * SIZE], D[SIZE]; /* R by rows */
    double Q[SIZE * SIZE];          /* by rows, if unsymmetric */
    bool unsymmetric;
    double inverse[SIZE];        /* as the core wants it */
    double columns[SIZE * SIZE]; /* R; NaN on and above the diagonal, where nothing is read */
    compressed sparse;
} triple;

/* R in eighths and D powers of two: products of them are exact */
triple make_triple(size_t n, double density, uint64_t *seed);

/* Another Q, where R has entries. */
void make_unsymmetric(triple *t, uint64_t *seed);

/* Scratch of a factor, NaN, and one number more that is not to be written: that is checked when it
 * is given back. */
double *take_scratch(const pma_factor *f);
void return_scratch(const pma_factor *f, double *work);

/* An opened step knows the solution on the interface, closed it is the solution with and without
 * what acts there; the interface sweep on its own solves with S. */
void check_sweeps(const triple *t, const pma_factor *f, uint64_t *seed);

/* The sweeps with vectors in lanes: `check` is given each solution x (n) and its right-hand side b;
 * all are bitwise those of one vector. In the last lane is NaN, which no other one may take. */
void check_lanes(const pma_factor *f,
                 void (*check)(const void *of, const double *x, const double *b), const void *of,
                 uint64_t *seed);

/* The product with vectors in lanes is bitwise that with one. */
void check_lane_product(const pma_matrix *A, uint64_t *seed);

/* ---- matrices on their way to a factor in panels -------------------------------------------- */

/* The routines that the numeric part calls, by plain loops. */
extern const pma_blas NAIVE_BLAS;

enum { GRID = 8, UNKNOWNS = GRID * GRID }; /* more than one block of a dense panel, which is 48 */

/* A matrix on its way to a factor in panels, in the core's words; n, nb and A are given. */
typedef struct {
    size_t n, nb;
    double A[UNKNOWNS * UNKNOWNS]; /* by rows */
    int64_t ptr[UNKNOWNS + 1];
    int32_t index[UNKNOWNS * UNKNOWNS];
    double entries[UNKNOWNS * UNKNOWNS];

    int64_t parent[UNKNOWNS], count[UNKNOWNS], order[UNKNOWNS], owner[UNKNOWNS];
    int64_t first[UNKNOWNS + 1], row_ptr[UNKNOWNS + 1], start[UNKNOWNS + 1];
    int32_t rows[UNKNOWNS * UNKNOWNS];
    double values[UNKNOWNS * UNKNOWNS], inverse[UNKNOWNS];
    int64_t integers[4 * UNKNOWNS];
    pma_panels panels;
} structure;

/* The factor of m->A as m->index and m->entries have it, by one worker. */
extern const pma_patience NEVER;
pma_status make_numbers(structure *m, double lost, const pma_patience *patience, size_t *column);

/* Every row backward: rows need not be in order. */
void list_entries(structure *m);

/* Every row ascending. */
void list_ascending(structure *m);

/* One in `one_in` pairs is tied; the diagonal dominates, so A is positive definite. */
void draw_definite(structure *m, size_t n, size_t nb, uint32_t one_in, uint64_t *seed);

/* A square grid of springs, its last line the interface. */
void draw_grid(structure *m);

void count_entries(structure *m);

/* A := A in another order */
void reorder(structure *m);

/* All that comes before the numbers; A is brought into postorder. */
void analyse(structure *m);

/* |b - A x| of a Cholesky solve is below (3 n + 1) eps |G| |G^T| |x|, entry by entry, and |G| |G^T|
 * below sqrt(a_ii a_jj) by Cauchy-Schwarz; the rest is for scaling to R D R^T and for this loop. */
void check_definite_residual(const structure *m, const double *x, const double *b);

#endif
