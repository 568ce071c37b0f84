/* naive.h - random numbers, algebra by plain loops, and a poll that stops. */
#ifndef PMA_TEST_NAIVE_H
#define PMA_TEST_NAIVE_H

#include <float.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

static const double EPS = DBL_EPSILON;
static const double PI = 3.14159265358979323846;

enum { SIZE = 9 }; /* two full lanes of four and one more, where a loop is vectorised */

/* ---- random numbers that are the same everywhere -------------------------------------------- */

/* Knuth's 64-bit linear congruence; the high bits are the good ones. */
uint32_t draw(uint64_t *seed, uint32_t below);

/* A multiple of 1/8 in [-1, 1]: sums of a few products of these are exact. */
double draw_eighth(uint64_t *seed);

void draw_vector(size_t n, uint64_t *seed, double *x);

/* ---- naive algebra -------------------------------------------------------------------------- */

enum { LARGEST = 16 }; /* unknowns of naive_solve */

/* b (n) := A^-1 b by Gaussian elimination with row exchanges, A (n*n) by rows */
void naive_solve(size_t n, const double *A, double *b);

/* A (n*n) = R D R^T; R by columns, the reciprocals of D */
void naive_factor(size_t n, const double *A, double *R, double *inverse);

/* ---- stop ----------------------------------------------------------------------------------- */

/* A poll that returns true when it is called for the stop_at-th time; never for 0. */
typedef struct {
    size_t polled, stop_at;
} stopper;

bool poll_stopper(void *ctx);

/* A stop in the middle of an operation, which calls `interrupt` there: the poll returns true from
 * the stop_at-th of these calls on; never for 0. */
typedef struct {
    size_t stop_at;
    atomic_size_t called;
    atomic_bool polled; /* ... and was true once */
} interrupter;

bool poll_interrupter(void *ctx);

/* `waits`, for another thread than the one that polls: until the poll has returned true. */
void interrupt(interrupter *i, bool waits);

#endif
