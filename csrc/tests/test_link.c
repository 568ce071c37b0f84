/* test_link.c - the constraints of a subdomain. */
#include <stddef.h>
#include <stdint.h>

#include "algebra/lanes.h"
#include "algebra/link.h"
#include "check.h"
#include "tests.h"

static pma_status link_status(const int64_t *ptr, const int32_t *index)
{
    const double ones[3] = {1.0, 1.0, 1.0};
    return pma_link_check(&(pma_link){2, 3, ptr, index, ones, NULL});
}

static void a_link_with_a_bad_index_is_refused(void)
{
    const int64_t ptr[4] = {0, 1, 1, 3};
    CHECK_STATUS(link_status(ptr, (int32_t[]){1, 0, 1}), PMA_OK);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, 1, 0}), PMA_OK);
    CHECK_STATUS(link_status(ptr, (int32_t[]){2, 0, 1}), PMA_BAD_INDEX);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, 1, 2}), PMA_BAD_INDEX);
    CHECK_STATUS(link_status(ptr, (int32_t[]){0, -1, 1}), PMA_BAD_INDEX);
    const int32_t index[3] = {0, 1, 0};
    CHECK_STATUS(link_status((int64_t[]){0, 0, 0, 0}, index), PMA_OK);
    CHECK_STATUS(link_status((int64_t[]){1, 1, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){-1, 1, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){0, 2, 1, 3}, index), PMA_BAD_INDEX);
    CHECK_STATUS(link_status((int64_t[]){0, 1, 3, 2}, index), PMA_BAD_INDEX);
    const pma_link none = {0, 0, (int64_t[]){0}, NULL, NULL, NULL};
    CHECK_STATUS(pma_link_check(&none), PMA_OK);
}

/* L_b = [2 0 0; -1 0 1], by hand and without rounding */
static void a_link_loads_and_gathers_with_one_and_the_same_matrix(void)
{
    const pma_link L = {
        2, 3, (int64_t[]){0, 2, 2, 3}, (int32_t[]){0, 1, 1}, (double[]){2.0, -1.0, 1.0}, NULL};
    double x_b[3] = {10.0, 20.0, 30.0}, jump[2] = {100.0, 200.0};
    pma_link_add(&L, (double[]){3.0, 5.0}, x_b); /* += (2*3 - 5, 0, 5) */
    CHECK_BITS(3, x_b, ((double[]){11.0, 20.0, 35.0}));
    pma_link_gather(&L, 0.5, x_b, jump); /* += 0.5 (2*11, -11 + 35) */
    CHECK_BITS(2, jump, ((double[]){111.0, 212.0}));
    pma_link_load(&L, (double[]){3.0, 5.0}, x_b);
    CHECK_BITS(3, x_b, ((double[]){1.0, 0.0, 5.0}));
}

/* The same in every lane, times the number of the lane. */
static void a_link_loads_and_gathers_in_lanes(void)
{
    const pma_link each = {
        2, 3, (int64_t[]){0, 2, 2, 3}, (int32_t[]){0, 1, 1}, (double[]){2.0, -1.0, 1.0}, NULL};
    const double lam[2] = {3.0, 5.0}, x_b[3] = {11.0, 20.0, 35.0}, jump[2] = {111.0, 212.0};
    const pma_link L = pma_link_in_lanes(&each);
    double loaded[3 * PMA_LANES], lam_l[2 * PMA_LANES], x_l[3 * PMA_LANES], jump_l[2 * PMA_LANES];
    for (size_t l = 0; l < PMA_LANES; l++) {
        for (size_t row = 0; row < 2; row++) {
            lam_l[row * PMA_LANES + l] = (double)l * lam[row];
            jump_l[row * PMA_LANES + l] = (double)l * (row == 0 ? 100.0 : 200.0);
        }
        for (size_t j = 0; j < 3; j++)
            x_l[j * PMA_LANES + l] = (double)l * (10.0 + 10.0 * (double)j);
    }
    pma_link_load(&L, lam_l, loaded);
    pma_link_add(&L, lam_l, x_l);
    pma_link_gather(&L, 0.5, x_l, jump_l);
    for (size_t l = 0; l < PMA_LANES; l++) {
        for (size_t j = 0; j < 3; j++)
            CHECK_NEAR(x_l[j * PMA_LANES + l], (double)l * x_b[j], 0.0);
        for (size_t j = 0; j < 3; j++)
            CHECK_NEAR(loaded[j * PMA_LANES + l], (double)l * (x_b[j] - 10.0 - 10.0 * (double)j),
                       0.0);
        for (size_t row = 0; row < 2; row++)
            CHECK_NEAR(jump_l[row * PMA_LANES + l], (double)l * jump[row], 0.0);
    }
}

static void lanes_are_split_into_vectors(void)
{
    double lanes[3 * PMA_LANES], vectors[PMA_LANES][3], *out[PMA_LANES];
    for (size_t k = 0; k < 3 * PMA_LANES; k++)
        lanes[k] = (double)k;
    for (size_t l = 0; l < PMA_LANES; l++)
        out[l] = vectors[l];
    vectors[PMA_LANES - 1][0] = 7.0;
    pma_lanes_split(3, lanes, PMA_LANES - 1, out);
    for (size_t l = 0; l + 1 < PMA_LANES; l++) {
        for (size_t i = 0; i < 3; i++)
            CHECK(vectors[l][i] == (double)(i * PMA_LANES + l));
    }
    CHECK(vectors[PMA_LANES - 1][0] == 7.0);
}

const test LINK_TESTS[] = {
    TEST(a_link_with_a_bad_index_is_refused),
    TEST(a_link_loads_and_gathers_with_one_and_the_same_matrix),
    TEST(a_link_loads_and_gathers_in_lanes),
    TEST(lanes_are_split_into_vectors),
    END_OF_TESTS,
};
