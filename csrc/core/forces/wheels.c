#include "forces/wheels.h"

#include <stdbool.h>
#include <string.h>

/* Ends 2 i and 2 i + 1 of spring i, in the order of the sets? */
static bool are_in_turn(const pma_springs *springs)
{
    int32_t end = 0;
    for (size_t s = 0; s < springs->count; s++) {
        for (size_t i = 0; i < springs->sets[s].count; i++, end += 2) {
            if (springs->sets[s].first[i] != end || springs->sets[s].second[i] != end + 1)
                return false;
        }
    }
    return true;
}

pma_status pma_wheels_check(const pma_wheels *wheels, size_t n)
{
    const size_t ends = 2 * wheels->springs.total;
    PMA_TRY(pma_springs_check(&wheels->springs, ends));
    for (size_t k = 0; k < wheels->count; k++)
        PMA_TRY(pma_path_check(&wheels->paths[k], n));
    for (size_t i = 0; i < ends; i++) {
        if (wheels->dofs[i] < -1 || wheels->dofs[i] >= (int64_t)n || wheels->points[i] < -1 ||
            wheels->points[i] >= (int64_t)wheels->count)
            return PMA_BAD_INDEX;
    }
    return are_in_turn(&wheels->springs) ? PMA_OK : PMA_BAD_INDEX;
}

/* Is neither end of a spring off its path? */
static bool is_on(const pma_wheels *wheels, size_t spring)
{
    const int64_t a = wheels->points[2 * spring], b = wheels->points[2 * spring + 1];
    return (a < 0 || wheels->places[a].is_on) && (b < 0 || wheels->places[b].is_on);
}

/* Displacement and velocity of an end. */
static void measure(const pma_wheels *wheels, size_t end, const double *u, const double *v,
                    double *u_end, double *v_end)
{
    const int64_t dof = wheels->dofs[end], point = wheels->points[end];
    if (point >= 0) {
        *u_end = pma_path_value(&wheels->paths[point], &wheels->places[point], u);
        *v_end = pma_path_rate(&wheels->paths[point], &wheels->places[point], u, v);
    } else {
        *u_end = dof < 0 ? 0.0 : u[dof];
        *v_end = dof < 0 ? 0.0 : v[dof];
    }
}

static void spread(const pma_wheels *wheels, size_t end, double f, double *r)
{
    const int64_t dof = wheels->dofs[end], point = wheels->points[end];
    if (point >= 0)
        pma_path_add(&wheels->paths[point], &wheels->places[point], f, 0, SIZE_MAX, r);
    else if (dof >= 0)
        r[dof] += f;
}

void pma_wheels_add(const pma_wheels *wheels, double t, const double *u, const double *v, double *r,
                    double *memory)
{
    const size_t total = wheels->springs.total;
    double *u_ends = wheels->work, *v_ends = u_ends + 2 * total, *f = v_ends + 2 * total;
    memset(u_ends, 0, 6 * total * sizeof(double));
    for (size_t k = 0; k < wheels->count; k++)
        wheels->places[k] = pma_path_at(&wheels->paths[k], t);
    for (size_t i = 0; i < total; i++) {
        const size_t a = 2 * i, b = a + 1;
        if (is_on(wheels, i)) {
            measure(wheels, a, u, v, &u_ends[a], &v_ends[a]);
            measure(wheels, b, u, v, &u_ends[b], &v_ends[b]);
        } else {
            u_ends[a] = memory[i]; /* the deformation that it had */
        }
    }
    pma_springs_subtract(&wheels->springs, u_ends, v_ends, memory, memory, f);
    for (size_t i = 0; i < total; i++) {
        if (is_on(wheels, i)) {
            spread(wheels, 2 * i, 0.0 - f[2 * i], r);
            spread(wheels, 2 * i + 1, 0.0 - f[2 * i + 1], r);
        }
    }
}
