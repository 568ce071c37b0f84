/* test_status.c - every status has a text. */
#include <string.h>

#include "check.h"
#include "status.h"
#include "tests.h"

static void every_status_has_a_text_of_its_own(void)
{
    for (int i = PMA_OK; i <= PMA_ELSEWHERE; i++) {
        CHECK(strlen(pma_status_text((pma_status)i)) > 0);
        for (int j = PMA_OK; j < i; j++)
            CHECK(strcmp(pma_status_text((pma_status)i), pma_status_text((pma_status)j)) != 0);
    }
    CHECK_INT(PMA_OK, 0);
    CHECK(strcmp(pma_status_text(PMA_OK), "no error") == 0);
    CHECK(strcmp(pma_status_text(PMA_STOPPED), "stopped by the caller") == 0);
}

static void an_unknown_status_has_a_text_too(void)
{
    CHECK(pma_status_text((pma_status)(PMA_ELSEWHERE + 1)) != NULL);
    CHECK(pma_status_text((pma_status)1000) != NULL);
}

const test STATUS_TESTS[] = {
    TEST(every_status_has_a_text_of_its_own),
    TEST(an_unknown_status_has_a_text_too),
    END_OF_TESTS,
};
