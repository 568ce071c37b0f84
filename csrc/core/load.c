#include "load.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

static void add_scaled(size_t n, double scale, const double *x, double *g)
{
    for (size_t i = 0; i < n; i++)
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
static void add_sample(const pma_load *load, size_t j, double weight, double *g)
{
    const double *row = load->values + j * load->k;
    if (!load->shape) {
        add_scaled(load->n, weight, row, g);
        return;
    }
    for (size_t c = 0; c < load->k; c++)
        add_scaled(load->n, weight * row[c], load->shape + c * load->n, g);
}

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}), t = (j + theta) dt                    (L1) */
static void add_sampled(const pma_load *load, double t, double *g)
{
    const double x = sample_position(load, t), last = (double)(load->samples - 1);
    if (x >= last) {
        if (load->hold || x == last)
            add_sample(load, load->samples - 1, 1.0, g);
        return;
    }
    const double begin = floor(x), theta = x - begin;
    add_sample(load, (size_t)begin, 1.0 - theta, g);
    if (theta > 0.0)
        add_sample(load, (size_t)begin + 1, theta, g);
}

static void add_answer(const pma_load *load, double *g)
{
    for (size_t i = 0; i < load->n; i++)
        g[i] += load->work[load->order[i]];
}

pma_status pma_load_ask(const pma_load *load, double t, int *code)
{
    if (load->kind != PMA_LOAD_CALLED)
        return PMA_OK;
    memset(load->work, 0, load->n * sizeof(double));
    *code = load->function(t, (intptr_t)load->n, load->work, load->user);
    return *code == 0 ? PMA_OK : PMA_FORCE_FAILED;
}

void pma_load_add(const pma_load *load, double t, int64_t step, double *g)
{
    switch (load->kind) {
    case PMA_LOAD_CONSTANT:
        add_scaled(load->n, 1.0, load->values, g);
        break;
    case PMA_LOAD_SAMPLED:
        add_sampled(load, t, g);
        break;
    case PMA_LOAD_TABLE:
        assert(step >= load->first && (size_t)(step - load->first) < load->rows);
        add_scaled(load->n, 1.0, load->values + (size_t)(step - load->first) * load->n, g);
        break;
    case PMA_LOAD_CALLED:
        add_answer(load, g);
        break;
    case PMA_LOAD_NONE:
        break;
    }
}
