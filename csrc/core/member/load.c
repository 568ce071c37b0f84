#include "member/load.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

/* Rows of a load. */
typedef struct {
    size_t begin, end;
} range;

static void add_scaled(range rows, double scale, const double *x, double *g)
{
    for (size_t i = rows.begin; i < rows.end; i++)
        g[i] += scale * x[i];
}

/* Where t falls among the samples, in units of their step. A t that is a sample instant up to the
 * rounding of three operations is that instant: otherwise a record could end one step early. */
static double sample_position(const pma_load *load, double t)
{
    const double x = t / load->dt, nearest = nearbyint(x);
    return fabs(x - nearest) <= 16.0 * DBL_EPSILON * nearest ? nearest : x;
}

/* row j of the samples, weighted and spread over the dofs */
static void add_sample(const pma_load *load, size_t j, double weight, range rows, double *g)
{
    const double *row = load->values + j * load->k;
    if (!load->shape) {
        add_scaled(rows, weight, row, g);
        return;
    }
    for (size_t c = 0; c < load->k; c++)
        add_scaled(rows, weight * row[c], load->shape + c * load->n, g);
}

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}), t = (j + theta) dt                    (L1) */
static void add_sampled(const pma_load *load, double t, range rows, double *g)
{
    const double x = sample_position(load, t), last = (double)(load->samples - 1);
    if (x >= last) {
        if (load->hold || x == last)
            add_sample(load, load->samples - 1, 1.0, rows, g);
        return;
    }
    const double begin = floor(x), theta = x - begin;
    add_sample(load, (size_t)begin, 1.0 - theta, rows, g);
    if (theta > 0.0)
        add_sample(load, (size_t)begin + 1, theta, rows, g);
}

static void add_value(const pma_load *load, range rows, double *g)
{
    for (size_t i = rows.begin; i < rows.end; i++)
        g[i] += load->work[load->order[i]];
}

pma_status pma_load_evaluate(const pma_load *load, double t, int *code)
{
    if (load->kind != PMA_LOAD_CALLED)
        return PMA_OK;
    memset(load->work, 0, load->n * sizeof(double));
    *code = load->function(t, (intptr_t)load->n, load->work, load->user);
    return *code == 0 ? PMA_OK : PMA_FORCE_FAILED;
}

void pma_load_add_rows(const pma_load *load, double t, int64_t number, size_t begin, size_t end,
                       double *g)
{
    const range rows = {begin, end};
    switch (load->kind) {
    case PMA_LOAD_CONSTANT:
        add_scaled(rows, 1.0, load->values, g);
        break;
    case PMA_LOAD_SAMPLED:
        add_sampled(load, t, rows, g);
        break;
    case PMA_LOAD_TABLE:
        assert(number >= load->first && (size_t)(number - load->first) < load->rows);
        add_scaled(rows, 1.0, load->values + (size_t)(number - load->first) * load->n, g);
        break;
    case PMA_LOAD_CALLED:
        add_value(load, rows, g);
        break;
    case PMA_LOAD_NONE:
        break;
    }
}

void pma_load_add(const pma_load *load, double t, int64_t number, double *g)
{
    pma_load_add_rows(load, t, number, 0, load->n, g);
}
