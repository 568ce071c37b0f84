/* test_memory.c - every allocation fails once in what algebra and workers make: PMA_NO_MEMORY, and
 * nothing is left. The other objects are in tests/campaign_memory.py. */
#include <stdint.h>
#include <stdlib.h>

#include "allocations.h"
#include "check.h"
#include "factor/elimination.h"
#include "factor/numeric.h"
#include "factor/symbolic.h"
#include "matrices.h"
#include "naive.h"
#include "object.h"
#include "tests.h"
#include "workers/roster.h"
#include "workers/team.h"

enum { WORKERS = 3 };

static structure m;

/* ---- what is made, and destroyed where it was ------------------------------------------------ */

static pma_status make_elimination(void)
{
    pma_elimination *e;
    const pma_status status =
        pma_elimination_create(&m.panels, m.n, m.owner, &NAIVE_BLAS, WORKERS, &e);
    CHECK((e != NULL) == (status == PMA_OK));
    pma_elimination_destroy(e);
    return status;
}

static pma_status make_agenda(void)
{
    pma_agenda a;
    const pma_status status = pma_agenda_create(&m.panels, m.owner, WORKERS, &a);
    CHECK((a.tasks > 0) == (status == PMA_OK));
    pma_agenda_destroy(&a);
    return status;
}

static pma_status make_numeric(void)
{
    const pma_numeric_parts parts = {.n = m.n,
                                     .nb = m.nb,
                                     .ptr = m.ptr,
                                     .index = m.index,
                                     .panels = m.panels,
                                     .owner = m.owner,
                                     .blas = NAIVE_BLAS};
    pma_numeric f;
    const pma_status status = pma_numeric_create(&parts, &f);
    CHECK((f.values != NULL) == (status == PMA_OK));
    CHECK(status != PMA_OK || f.elimination != NULL);
    pma_numeric_destroy(&f);
    return status;
}

static pma_status make_roster(void)
{
    const pma_duty duties[2] = {{.entries = 10, .substeps = 1}, {.entries = 20, .substeps = 2}};
    pma_roster r;
    const pma_status status = pma_roster_create(2, duties, WORKERS, false, &r);
    CHECK((r.order != NULL) == (status == PMA_OK));
    pma_roster_destroy(&r);
    return status;
}

static pma_status make_team(void)
{
    pma_team *t;
    const pma_status status = pma_team_create(WORKERS, &t);
    CHECK((t != NULL) == (status == PMA_OK));
    pma_team_destroy(t);
    return status;
}

/* ---- each allocation fails once -------------------------------------------------------------- */

/* Returns how many there are. */
static size_t check_failures(pma_status (*make)(void))
{
    for (size_t k = 1;; k++) {
        fail_allocation(k);
        const pma_status status = make();
        if (!allocation_has_failed()) {
            fail_allocation(0);
            CHECK_STATUS(status, PMA_OK);
            return k - 1;
        }
        CHECK_STATUS(status, PMA_NO_MEMORY);
    }
}

static void what_cannot_be_allocated_is_not_made(void)
{
    static pma_status (*const makers[])(void) = {make_elimination, make_agenda, make_numeric,
                                                 make_roster, make_team};
    uint64_t seed = 91;
    if (!fail_allocation(0)) {
        printf("no allocation can be made to fail in this build\n");
        return;
    }
    draw_definite(&m, UNKNOWNS, 4, 24, &seed); /* too wide for a band */
    analyse(&m);
    list_ascending(&m);
    for (size_t i = 0; i < sizeof makers / sizeof *makers; i++)
        CHECK(check_failures(makers[i]) >= 1);
}

/* ---- an object and its arrays ---------------------------------------------------------------- */

typedef struct {
    double *numbers;
    char *letters;
    size_t *sizes;
} three;

static void an_object_has_its_arrays_zeroed_one_after_another(void)
{
    const pma_array arrays[] = {PMA_ARRAY(three, numbers, 3),
                                PMA_ARRAY(three, letters, 5),
                                PMA_ARRAY(three, sizes, 2),
                                {0}};
    three *x = pma_object_create(sizeof *x, arrays), y;
    void *block = pma_object_fill(&y, arrays);
    CHECK(x && block);
    CHECK((uintptr_t)x->numbers % 64 == 0 && (uintptr_t)y.numbers % 64 == 0); /* a line */
    CHECK(x->letters >= (char *)(x->numbers + 3));
    CHECK((char *)x->sizes >= x->letters + 8 && (uintptr_t)x->sizes % 8 == 0); /* a word */
    CHECK(x->numbers[2] == 0.0 && x->letters[4] == 0 && x->sizes[1] == 0);
    free(x);
    free(block);
}

static void arrays_beyond_all_memory_are_not_made(void)
{
    three x;
    for (size_t k = 1; k <= 3; k++) {
        const pma_array arrays[] = {PMA_ARRAY(three, numbers, SIZE_MAX / (8 * k)),
                                    PMA_ARRAY(three, sizes, SIZE_MAX / (8 * k)),
                                    {0}};
        CHECK(!pma_object_create(sizeof x, arrays));
        CHECK(!pma_object_fill(&x, arrays));
    }
    const size_t quarter = SIZE_MAX / 4; /* which five are beyond, one is not */
    const pma_array letters = PMA_ARRAY(three, letters, quarter);
    const pma_array arrays[] = {letters, letters, letters, letters, letters, {0}};
    CHECK(!pma_object_create(sizeof x, arrays));
}

const test MEMORY_TESTS[] = {
    TEST(an_object_has_its_arrays_zeroed_one_after_another),
    TEST(arrays_beyond_all_memory_are_not_made),
    TEST(what_cannot_be_allocated_is_not_made),
    END_OF_TESTS,
};
