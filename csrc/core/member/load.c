#include "member/load.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/lanes.h"

/* Some dofs of a load; dof i is number i * stride of g. */
typedef struct {
    size_t begin, end, stride;
} range;

static void add_scaled(range rows, double scale, const double *x, double *g)
{
    if (rows.stride == 1) {
        for (size_t i = rows.begin; i < rows.end; i++)
            g[i] += scale * x[i];
    } else {
        for (size_t i = rows.begin; i < rows.end; i++)
            g[i * rows.stride] += scale * x[i];
    }
}

/* Where t falls among the samples, in units of their step. A t that is a sample instant up to the
 * rounding of three operations is that instant: otherwise a record could end one step early. */
static double sample_position(double dt, double t)
{
    const double x = t / dt, nearest = nearbyint(x);
    return fabs(x - nearest) <= 16.0 * DBL_EPSILON * nearest ? nearest : x;
}

/* The samples of which F(t) is a sum: at most two, with their weights. */
typedef struct {
    size_t count, row[2];
    double weight[2];
} sum_of_samples;

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}), t = begin + (j + theta) dt, the first sample
 * before begin (L1) */
static sum_of_samples samples_at(const pma_load *load, double t)
{
    const double x = fmax(0.0, sample_position(load->dt, t - load->begin));
    const double last = (double)(load->samples - 1);
    if (x >= last)
        return (sum_of_samples){
            .count = load->hold || x == last, .row = {load->samples - 1}, .weight = {1.0}};
    const size_t begin = (size_t)x;
    const double theta = x - (double)begin;
    return (sum_of_samples){
        .count = theta > 0.0 ? 2 : 1, .row = {begin, begin + 1}, .weight = {1.0 - theta, theta}};
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

static void add_samples(const pma_load *load, const sum_of_samples *sum, range rows, double *g)
{
    for (size_t s = 0; s < sum->count; s++)
        add_sample(load, sum->row[s], sum->weight[s], rows, g);
}

static void add_value(const pma_load *load, range rows, double *g)
{
    for (size_t i = rows.begin; i < rows.end; i++)
        g[i] += load->work[load->order[i]];
}

/* ---- in lanes ------------------------------------------------------------------------------- */

enum { PIECE = 256 }; /* dofs at a time, whose g stays in the first cache from lane to lane */

static void add_in_lane(const pma_load *own, double t, range rows, double *g)
{
    if (own->kind == PMA_LOAD_CONSTANT)
        add_scaled(rows, 1.0, own->values, g);
    if (own->kind == PMA_LOAD_SAMPLED) {
        const sum_of_samples sum = samples_at(own, t);
        add_samples(own, &sum, rows, g);
    }
    for (size_t i = 0; own->kind == PMA_LOAD_SUM && i < own->count; i++)
        add_in_lane(&own->each[i], t, rows, g);
}

static void add_piece(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    const range rows = {begin, end, PMA_LANES};
    for (size_t l = 0; l < PMA_LANES; l++)
        add_in_lane(&load->each[l], t, rows, g + l);
}

static void add_lanes(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    for (; begin < end; begin += PIECE)
        add_piece(load, t, begin, end - begin < PIECE ? end : begin + PIECE, g);
}

/* ---- any load ------------------------------------------------------------------------------- */

bool pma_load_has(const pma_load *load, pma_load_kind kind)
{
    bool found = load->kind == kind;
    for (size_t i = 0; load->kind == PMA_LOAD_SUM && i < load->count; i++)
        found = found || pma_load_has(&load->each[i], kind);
    return found;
}

bool pma_load_covers(const pma_load *load, int64_t begin, int64_t end)
{
    bool all = load->kind != PMA_LOAD_TABLE ||
               (begin >= load->first && end <= load->first + (int64_t)load->rows);
    for (size_t i = 0; load->kind == PMA_LOAD_SUM && i < load->count; i++)
        all = all && pma_load_covers(&load->each[i], begin, end);
    return all;
}

pma_status pma_load_evaluate(const pma_load *load, double t, int *code)
{
    pma_status status = PMA_OK;
    for (size_t i = 0; load->kind == PMA_LOAD_SUM && i < load->count && status == PMA_OK; i++)
        status = pma_load_evaluate(&load->each[i], t, code);
    if (status != PMA_OK || load->kind != PMA_LOAD_CALLED)
        return status;
    memset(load->work, 0, load->n * sizeof(double));
    *code = load->function(t, (intptr_t)load->n, load->work, load->user);
    return *code == 0 ? PMA_OK : PMA_FORCE_FAILED;
}

void pma_load_add_called(const pma_load *load, double *g)
{
    if (load->kind == PMA_LOAD_CALLED)
        add_value(load, (range){0, load->n, 1}, g);
    for (size_t i = 0; load->kind == PMA_LOAD_SUM && i < load->count; i++)
        pma_load_add_called(&load->each[i], g);
}

void pma_load_add_rows(const pma_load *load, double t, int64_t number, size_t begin, size_t end,
                       double *g)
{
    const range rows = {begin, end, 1};
    switch (load->kind) {
    case PMA_LOAD_CONSTANT:
        add_scaled(rows, 1.0, load->values, g);
        break;
    case PMA_LOAD_SAMPLED: {
        const sum_of_samples sum = samples_at(load, t);
        add_samples(load, &sum, rows, g);
        break;
    }
    case PMA_LOAD_TABLE:
        assert(number >= load->first && (size_t)(number - load->first) < load->rows);
        add_scaled(rows, 1.0, load->values + (size_t)(number - load->first) * load->n, g);
        break;
    case PMA_LOAD_CALLED:
        add_value(load, rows, g);
        break;
    case PMA_LOAD_SUM:
        for (size_t i = 0; i < load->count; i++)
            pma_load_add_rows(&load->each[i], t, number, begin, end, g);
        break;
    case PMA_LOAD_IN_LANES:
        add_lanes(load, t, begin / PMA_LANES, end / PMA_LANES, g);
        break;
    case PMA_LOAD_NONE:
        break;
    }
}

void pma_load_add(const pma_load *load, double t, int64_t number, double *g)
{
    pma_load_add_rows(load, t, number, 0, load->n, g);
}
