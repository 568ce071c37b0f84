/* test_link.c - the constraints of a subdomain. */
#include <stddef.h>
#include <stdint.h>

#include "algebra/link.h"
#include "check.h"
#include "tests.h"

static pma_status link_status(const int64_t *ptr, const int32_t *index)
{
    const double ones[3] = {1.0, 1.0, 1.0};
    return pma_link_check(&(pma_link){2, 3, ptr, index, ones});
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
    const pma_link none = {0, 0, (int64_t[]){0}, NULL, NULL};
    CHECK_STATUS(pma_link_check(&none), PMA_OK);
}

/* L_b = [2 0 0; -1 0 1], by hand and without rounding */
static void a_link_loads_and_gathers_with_one_and_the_same_matrix(void)
{
    const pma_link L = {2, 3, (int64_t[]){0, 2, 2, 3}, (int32_t[]){0, 1, 1},
                        (double[]){2.0, -1.0, 1.0}};
    double x_b[3] = {10.0, 20.0, 30.0}, jump[2] = {100.0, 200.0};
    pma_link_load(&L, (double[]){3.0, 5.0}, x_b); /* += (2*3 - 5, 0, 5) */
    CHECK_BITS(3, x_b, ((double[]){11.0, 20.0, 35.0}));
    pma_link_gather(&L, 0.5, x_b, jump); /* += 0.5 (2*11, -11 + 35) */
    CHECK_BITS(2, jump, ((double[]){111.0, 212.0}));
}

const test LINK_TESTS[] = {
    TEST(a_link_with_a_bad_index_is_refused),
    TEST(a_link_loads_and_gathers_with_one_and_the_same_matrix),
    END_OF_TESTS,
};
