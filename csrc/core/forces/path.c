#include "forces/path.h"

#include <float.h>
#include <math.h>

pma_status pma_path_check(const pma_path *path, size_t n)
{
    if (path->segments == 0)
        return PMA_BAD_SIZE;
    for (size_t i = 0; i < path->segments; i++) {
        if (!(path->ends[i + 1] > path->ends[i]))
            return PMA_BAD_SIZE;
    }
    for (size_t k = 0; k < path->segments * path->width; k++) {
        if (path->dofs[k] < -1 || path->dofs[k] >= (int64_t)n)
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

/* s = s_0 + s' t (L7); the last segment that does not begin behind it */
pma_place pma_path_at(const pma_path *path, double t)
{
    const double way = path->speed * t, s = path->start + way, *ends = path->ends;
    const double last = ends[path->segments];
    const double rounding = 16.0 * DBL_EPSILON * (fabs(path->start) + fabs(way) + fabs(last));
    if (!(s >= ends[0] - rounding && s <= last + rounding))
        return (pma_place){.is_on = false};
    size_t low = 0, high = path->segments;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (s >= ends[middle])
            low = middle;
        else
            high = middle;
    }
    const double xi = (s - ends[low]) / (ends[low + 1] - ends[low]);
    return (pma_place){.is_on = true, .segment = low, .xi = xi < 0.0 ? 0.0 : xi > 1.0 ? 1.0 : xi};
}

/* N_k and dN_k / dxi */
static double shape_at(const double *c, double xi)
{
    return c[0] + xi * (c[1] + xi * (c[2] + xi * c[3]));
}

static double slope_at(const double *c, double xi)
{
    return c[1] + xi * (2.0 * c[2] + xi * 3.0 * c[3]);
}

double pma_path_value(const pma_path *path, const pma_place *place, const double *u)
{
    if (!place->is_on)
        return 0.0;
    const size_t first = place->segment * path->width;
    double sum = 0.0;
    for (size_t k = first; k < first + path->width; k++) {
        if (path->dofs[k] >= 0)
            sum += shape_at(path->shape + PMA_SHAPE * k, place->xi) * u[path->dofs[k]];
    }
    return sum;
}

double pma_path_rate(const pma_path *path, const pma_place *place, const double *u, const double *v)
{
    if (!place->is_on)
        return 0.0;
    const size_t first = place->segment * path->width;
    const double *ends = path->ends + place->segment;
    const double by_xi = path->speed / (ends[1] - ends[0]);
    double sum = v ? pma_path_value(path, place, v) : 0.0;
    for (size_t k = first; k < first + path->width; k++) {
        if (path->dofs[k] >= 0)
            sum += by_xi * slope_at(path->shape + PMA_SHAPE * k, place->xi) * u[path->dofs[k]];
    }
    return sum;
}

void pma_path_add(const pma_path *path, const pma_place *place, double f, size_t begin, size_t end,
                  double *y)
{
    if (!place->is_on)
        return;
    const size_t first = place->segment * path->width;
    for (size_t k = first; k < first + path->width; k++) {
        const int64_t dof = path->dofs[k];
        if (dof >= 0 && (size_t)dof >= begin && (size_t)dof < end)
            y[dof] += f * shape_at(path->shape + PMA_SHAPE * k, place->xi);
    }
}
