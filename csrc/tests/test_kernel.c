/* test_kernel.c - sweeps through one panel, against two loops, and one kernel against the other. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "algebra/kernel.h"
#include "algebra/lanes.h"
#include "check.h"
#include "naive.h"
#include "subdomain/scheme.h"
#include "tests.h"

/* Two groups of eight columns and all that can be left of a third; rows of more than a vector. */
enum { WIDTH = 23, HEIGHT = 37, LEADING = HEIGHT + 2 };

/* R in eighths below the diagonal, NaN where nothing is read. */
static void draw_panel(size_t height, size_t width, uint64_t *seed, double *panel)
{
    for (size_t j = 0; j < width; j++) {
        for (size_t i = 0; i < LEADING; i++)
            panel[j * LEADING + i] = i > j && i < height ? draw_eighth(seed) : (double)NAN;
    }
}

/* size: the same sums of absolute values. A number of the result is a sum of products along paths
 * through R; each has at most 2 height factors and terms, rounded once each. */
static void naive_eliminate(const double *panel, size_t height, size_t width, double *x,
                            double *size)
{
    for (size_t j = 0; j < width; j++) {
        for (size_t i = j + 1; i < height; i++) {
            x[i] -= panel[j * LEADING + i] * x[j];
            size[i] += fabs(panel[j * LEADING + i]) * size[j];
        }
    }
}

static void naive_substitute(const double *panel, size_t height, size_t width, double *x,
                             double *size)
{
    for (size_t j = width; j-- > 0;) {
        for (size_t i = j + 1; i < height; i++) {
            x[j] -= panel[j * LEADING + i] * x[i];
            size[j] += fabs(panel[j * LEADING + i]) * size[i];
        }
    }
}

static void check_swept(size_t height, const double *x, const double *expected, const double *size)
{
    for (size_t i = 0; i < height; i++)
        CHECK_NEAR(x[i], expected[i], 4.0 * (double)height * EPS * size[i]);
    CHECK_NEAR(x[height], 7.0, 0.0); /* not to be written */
}

static void check_kernels(size_t height, size_t width, uint64_t *seed)
{
    double panel[WIDTH * LEADING];
    double x[HEIGHT + 1], best[HEIGHT + 1], expected[HEIGHT + 1], size[HEIGHT + 1];
    draw_panel(height, width, seed, panel);
    for (size_t way = 0; way < 2; way++) {
        draw_vector(height, seed, x);
        x[height] = 7.0;
        memcpy(best, x, sizeof x);
        memcpy(expected, x, sizeof x);
        memcpy(size, x, sizeof x); /* all positive */
        if (way == 0) {
            naive_eliminate(panel, height, width, expected, size);
            pma_kernel_plain()->eliminate(panel, LEADING, height, width, x);
            pma_kernel_best()->eliminate(panel, LEADING, height, width, best);
        } else {
            naive_substitute(panel, height, width, expected, size);
            pma_kernel_plain()->substitute(panel, LEADING, height, width, x);
            pma_kernel_best()->substitute(panel, LEADING, height, width, best);
        }
        check_swept(height, x, expected, size);
        CHECK_BITS(height + 1, best, x);
    }
}

static void all_kernels_sweep_like_two_loops_and_bitwise_identically(void)
{
    uint64_t seed = 12;
    for (size_t width = 0; width <= WIDTH; width++) {
        for (size_t height = width; height <= HEIGHT; height++)
            check_kernels(height, width, &seed);
    }
}

/* Products of eighths with small integers: no rounding, so they have to be equal. */
static void all_kernels_multiply_like_two_loops(void)
{
    uint64_t seed = 13;
    double A[WIDTH * LEADING], x[WIDTH], y[HEIGHT], best[HEIGHT], expected[HEIGHT];
    for (size_t columns = 0; columns <= WIDTH; columns++) {
        for (size_t rows = 0; rows <= HEIGHT; rows++) {
            for (size_t k = 0; k < columns * LEADING; k++)
                A[k] = k % LEADING < rows ? draw_eighth(&seed) : (double)NAN;
            for (size_t j = 0; j < columns; j++)
                x[j] = draw(&seed, 100);
            for (size_t i = 0; i < rows; i++) {
                y[i] = best[i] = expected[i] = draw(&seed, 100);
                for (size_t j = 0; j < columns; j++)
                    expected[i] -= A[j * LEADING + i] * x[j];
            }
            pma_kernel_plain()->subtract(A, LEADING, rows, columns, x, y);
            pma_kernel_best()->subtract(A, LEADING, rows, columns, x, best);
            CHECK_BITS(rows, y, expected);
            CHECK_BITS(rows, best, expected);
        }
    }
}

/* The loops themselves are tested with matrices and factors; here that they are the same
 * everywhere, and write no further. */
static void all_kernels_do_lanes_bitwise_identically(void)
{
    enum { END = HEIGHT * PMA_LANES };
    const pma_kernel *kernels[2] = {pma_kernel_plain(), pma_kernel_best()};
    uint64_t seed = 19;
    double panel[WIDTH * LEADING], x[END], swept[2][3 * END + 1];
    for (size_t width = 0; width <= WIDTH; width++) {
        for (size_t height = width; height <= HEIGHT; height++) {
            const size_t size = height * PMA_LANES;
            draw_panel(height, width, &seed, panel);
            draw_vector(size, &seed, x);
            for (size_t k = 0; k < 2; k++) {
                double *eliminated = swept[k], *substituted = eliminated + size;
                double *product = substituted + size;
                for (size_t way = 0; way < 3; way++)
                    memcpy(eliminated + way * size, x, size * sizeof *x);
                product[size] = 7.0;
                kernels[k]->eliminate_lanes(panel, LEADING, height, width, eliminated);
                kernels[k]->substitute_lanes(panel, LEADING, height, width, substituted);
                kernels[k]->subtract_lanes(panel + width, LEADING, height - width, width, x,
                                           product);
            }
            CHECK_BITS(3 * size + 1, swept[1], swept[0]);
            CHECK(swept[0][3 * size] == 7.0);
        }
    }
}

static pma_state state_in(double *block)
{
    return (pma_state){
        .u = block, .v = block + HEIGHT, .w = block + 2 * HEIGHT, .a = block + 3 * HEIGHT};
}

/* The formulas themselves are tested with the subdomain; here that they are the same everywhere,
 * and that rows outside are left alone. */
static void all_kernels_predict_and_correct_the_given_rows_bitwise_identically(void)
{
    uint64_t seed = 17;
    const pma_step c = pma_step_make((pma_scheme){0.2, 0.4, 0.3, 0.7}, 0.1);
    double old[4 * HEIGHT], a[4 * HEIGHT], b[4 * HEIGHT];
    const pma_state from = state_in(old), plain = state_in(a), best = state_in(b);
    for (size_t begin = 0; begin < 6; begin++) {
        for (size_t end = begin; end <= HEIGHT; end++) {
            draw_vector(4 * HEIGHT, &seed, old);
            for (size_t k = 0; k < 4 * HEIGHT; k++)
                a[k] = b[k] = 7.0;
            pma_update_plain()->predict(&c, begin, end, &from, &plain);
            pma_update_best()->predict(&c, begin, end, &from, &best);
            CHECK_BITS(4 * HEIGHT, b, a);
            for (size_t i = 0; i < HEIGHT; i++)
                CHECK_NEAR(plain.w[i], i >= begin && i < end ? 0.0 : 7.0, 0.0);
            draw_vector(HEIGHT, &seed, plain.w);
            memcpy(best.w, plain.w, HEIGHT * sizeof(double));
            CHECK(pma_update_plain()->correct(&c, begin, end, &plain));
            CHECK(pma_update_best()->correct(&c, begin, end, &best));
            CHECK_BITS(4 * HEIGHT, b, a);
        }
    }
}

static void every_value_that_is_not_finite_is_found(void)
{
    const pma_step c = pma_step_make((pma_scheme){0.2, 0.4, 0.3, 0.7}, 0.1);
    const double bad[3] = {NAN, INFINITY, -INFINITY};
    double a[4 * HEIGHT];
    const pma_state x = state_in(a);
    for (size_t k = 0; k < 3 * 4 * HEIGHT; k++) {
        const pma_update *kernels[2] = {pma_update_plain(), pma_update_best()};
        for (size_t i = 0; i < 2; i++) {
            for (size_t l = 0; l < 4 * HEIGHT; l++)
                a[l] = l == k / 3 ? bad[k % 3] : 1e308 / 8.0; /* a sum of eight is not finite */
            CHECK(!kernels[i]->correct(&c, 0, HEIGHT, &x));
        }
    }
}

const test KERNEL_TESTS[] = {
    TEST(all_kernels_sweep_like_two_loops_and_bitwise_identically),
    TEST(all_kernels_multiply_like_two_loops),
    TEST(all_kernels_do_lanes_bitwise_identically),
    TEST(all_kernels_predict_and_correct_the_given_rows_bitwise_identically),
    TEST(every_value_that_is_not_finite_is_found),
    END_OF_TESTS,
};
