/* test_path.c - points that run along paths, loads and springs there, against hand calculation. */
#include <math.h>
#include <stdint.h>

#include "check.h"
#include "forces/load.h"
#include "forces/path.h"
#include "forces/wheels.h"
#include "tests.h"

/* From 0 to 1 the dofs 0 and 1, linear; from 1 to 3 the dof 1, 1 - xi^3, and one that is fixed. At
 * t = 0 the point is half a unit before it. All numbers are sums of a few powers of two. */
static const double ENDS[3] = {0.0, 1.0, 3.0};
static const int64_t DOFS[4] = {0, 1, 1, -1};
static const double SHAPE[16] = {1, -1, 0, 0, 0, 1, 0, 0, 1, 0, 0, -1, 5, 5, 5, 5};
static const pma_path PATH = {.segments = 2,
                              .width = 2,
                              .ends = ENDS,
                              .dofs = DOFS,
                              .shape = SHAPE,
                              .start = -0.5,
                              .speed = 0.5};

static void check_sums(double t, const double *N)
{
    const pma_place place = pma_path_at(&PATH, t);
    const double u[2] = {4.0, 32.0};
    double y[3] = {1.0, 2.0, 4.0};
    CHECK(pma_path_value(&PATH, &place, u) == N[0] * u[0] + N[1] * u[1]);
    pma_path_add(&PATH, &place, 2.0, 0, 3, y);
    CHECK(y[0] == 1.0 + 2.0 * N[0] && y[1] == 2.0 + 2.0 * N[1] && y[2] == 4.0);
    double rows[3] = {0.0, 0.0, 0.0};
    pma_path_add(&PATH, &place, 2.0, 1, 3, rows);
    CHECK(rows[0] == 0.0 && rows[1] == 2.0 * N[1]);
}

static void a_point_has_the_shape_functions_of_the_segment_under_it(void)
{
    check_sums(0.0, (double[]){0.0, 0.0}); /* before the path */
    check_sums(1.0, (double[]){1.0, 0.0}); /* its beginning belongs to it */
    check_sums(1.5, (double[]){0.75, 0.25});
    check_sums(3.0, (double[]){0.0, 1.0});
    check_sums(5.0, (double[]){0.0, 0.875}); /* xi = 1/2 */
    check_sums(7.0, (double[]){0.0, 0.0});   /* its end, where 1 - xi^3 = 0 */
    CHECK(pma_path_at(&PATH, 7.0).is_on && !pma_path_at(&PATH, 7.0000001).is_on);
    CHECK(!pma_path_at(&PATH, 0.9999999).is_on && !pma_path_at(&PATH, (double)NAN).is_on);
    CHECK(pma_path_at(&PATH, nextafter(7.0, 8.0)).is_on); /* up to rounding */
}

/* N v + s' dN/ds u: at t = 5 0.875 v + 1/2 (-3/4) / 2 u of the second segment of length 2 */
static void the_rate_of_a_point_has_the_slope_under_it(void)
{
    const pma_place first = pma_path_at(&PATH, 1.5), second = pma_path_at(&PATH, 5.0);
    const double u[2] = {4.0, 32.0}, v[2] = {8.0, 16.0};
    CHECK(pma_path_rate(&PATH, &first, u, v) == 0.75 * 8.0 + 0.25 * 16.0 + 0.5 * (32.0 - 4.0));
    CHECK(pma_path_rate(&PATH, &second, u, v) == 0.875 * 16.0 - 0.5 * 0.375 * 32.0);
    CHECK(pma_path_rate(&PATH, &second, u, NULL) == -0.5 * 0.375 * 32.0);
}

static void a_path_of_other_dofs_or_without_length_is_refused(void)
{
    const double falls[3] = {0.0, 1.0, 1.0};
    const int64_t wrong[4] = {0, 1, 1, -2};
    pma_path path = PATH;
    CHECK_STATUS(pma_path_check(&PATH, 2), PMA_OK);
    CHECK_STATUS(pma_path_check(&PATH, 1), PMA_BAD_INDEX);
    path.ends = falls;
    CHECK_STATUS(pma_path_check(&path, 2), PMA_BAD_SIZE);
    path = PATH;
    path.dofs = wrong;
    CHECK_STATUS(pma_path_check(&path, 2), PMA_BAD_INDEX);
    path = PATH;
    path.segments = 0;
    CHECK_STATUS(pma_path_check(&path, 2), PMA_BAD_SIZE);
}

/* samples 1, 3 at 0 and 4: 1.75 at t = 1.5 and 3 at t = 5, if the last one is held */
static void a_moving_load_is_its_samples_times_the_shape_functions(void)
{
    const double samples[2] = {1.0, 3.0};
    pma_load load = {.kind = PMA_LOAD_MOVING,
                     .n = 2,
                     .values = samples,
                     .samples = 2,
                     .k = 1,
                     .dt = 4.0,
                     .hold = true,
                     .path = &PATH};
    double g[2] = {0.0, 0.0};
    pma_load_add(&load, 1.5, 0, g);
    CHECK(g[0] == 0.75 * 1.75 && g[1] == 0.25 * 1.75);
    pma_load_add(&load, 5.0, 0, g);
    CHECK(g[1] == 0.25 * 1.75 + 0.875 * 3.0);
    load.hold = false;
    pma_load_add(&load, 5.0, 0, g);
    CHECK(g[1] == 0.25 * 1.75 + 0.875 * 3.0);
    CHECK(pma_load_covers(&load, 0, 1000));
}

/* A bilinear spring (k = 2 beyond the limit 1, 6 more below it) between dof 2 and the point, and a
 * damped gap (k = 8, no clearance, c = 4) between the point and the ground. */
static void springs_follow_a_point_and_rest_off_its_path(void)
{
    const int32_t first[2] = {0, 2}, second[2] = {1, 3};
    const double k[2] = {2.0, 8.0}, more[2] = {6.0, 0.0}, limit[2] = {1.0, 4.0};
    const pma_spring_set sets[2] = {{.law = PMA_BILINEAR,
                                     .count = 1,
                                     .first = first,
                                     .second = second,
                                     .parameters = {&k[0], &more[0], &limit[0]}},
                                    {.law = PMA_DAMPED_GAP,
                                     .count = 1,
                                     .first = first + 1,
                                     .second = second + 1,
                                     .parameters = {&k[1], &more[1], &limit[1]}}};
    const int64_t dofs[4] = {2, -1, -1, -1}, points[4] = {-1, 0, 0, -1};
    pma_place places[1];
    double work[12], memory[6] = {0.0};
    pma_wheels wheels = {.springs = {.count = 2, .sets = sets, .total = 2},
                         .dofs = dofs,
                         .points = points,
                         .count = 1,
                         .paths = &PATH,
                         .places = places,
                         .work = work};
    const double u[3] = {4.0, 32.0, 13.0}, v[3] = {8.0, 16.0, 1.0};
    double r[3] = {0.0, 0.0, 0.0};
    CHECK_STATUS(pma_wheels_check(&wheels, 3), PMA_OK);
    CHECK_STATUS(pma_wheels_check(&wheels, 2), PMA_BAD_INDEX);
    pma_wheels_add(&wheels, 0.5, u, v, r, memory);
    CHECK(r[0] == 0.0 && r[1] == 0.0 && r[2] == 0.0 && memory[0] == 0.0);
    /* u_p = 11, u_p' = 24: d = 2 and 11, f = 2 * 2 + 6 * 1 = 10 and 8 * 11 + 4 * 24 = 184 */
    pma_wheels_add(&wheels, 1.5, u, v, r, memory);
    CHECK(r[2] == 10.0 && r[0] == 0.75 * (184.0 - 10.0) && r[1] == 0.25 * (184.0 - 10.0));
    /* off the path: no force, and the plastic deformation d - 1 = 1 stays */
    pma_wheels_add(&wheels, 8.0, u, v, r, memory);
    CHECK(r[2] == 10.0 && memory[0] == 2.0 && memory[4] == 1.0);
    const int32_t exchanged[2] = {1, 2};
    pma_spring_set wrong[2] = {sets[0], sets[1]};
    wrong[0].first = exchanged;
    wrong[0].second = first;
    wheels.springs.sets = wrong;
    CHECK_STATUS(pma_wheels_check(&wheels, 3), PMA_BAD_INDEX);
}

const test PATH_TESTS[] = {
    TEST(a_point_has_the_shape_functions_of_the_segment_under_it),
    TEST(the_rate_of_a_point_has_the_slope_under_it),
    TEST(a_path_of_other_dofs_or_without_length_is_refused),
    TEST(a_moving_load_is_its_samples_times_the_shape_functions),
    TEST(springs_follow_a_point_and_rest_off_its_path),
    END_OF_TESTS,
};
