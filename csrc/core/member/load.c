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

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}), t = begin + (j + theta) dt            (L1) */
static sum_of_samples samples_at(const pma_load *load, double t)
{
    const double x = sample_position(load->dt, t - load->begin);
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

static void add_lanes(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_load *own = &load->each[l];
        const range rows = {begin, end, PMA_LANES};
        if (own->kind == PMA_LOAD_CONSTANT)
            add_scaled(rows, 1.0, own->values, g + l);
        if (own->kind != PMA_LOAD_SAMPLED)
            continue;
        const sum_of_samples sum = samples_at(own, t);
        add_samples(own, &sum, rows, g + l);
    }
}

static void add_lanes_by_pieces(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    for (; begin < end; begin += PIECE)
        add_lanes(load, t, begin, end - begin < PIECE ? end : begin + PIECE, g);
}

static bool can_be_joined(const pma_load *a, const pma_load *b)
{
    return b->kind == PMA_LOAD_SAMPLED && b->shape && b->k == a->k && b->dt == a->dt &&
           b->begin == a->begin && b->samples == a->samples && b->hold == a->hold;
}

size_t pma_load_joined_size(const pma_load *each)
{
    for (size_t l = 0; l < PMA_LANES; l++) {
        if (!can_be_joined(&each[0], &each[l]))
            return 0;
    }
    return (each->samples + each->n) * each->k * PMA_LANES;
}

void pma_load_join(const pma_load *each, double *numbers, pma_load *load)
{
    const size_t values = each->samples * each->k, shapes = each->k * each->n;
    double *shape = numbers + values * PMA_LANES;
    for (size_t l = 0; l < PMA_LANES; l++) {
        for (size_t i = 0; i < values; i++)
            numbers[i * PMA_LANES + l] = each[l].values[i];
        for (size_t i = 0; i < shapes; i++)
            shape[i * PMA_LANES + l] = each[l].shape[i];
    }
    load->values = numbers;
    load->shape = shape;
}

/* g += scale x of one unknown, in each lane */
static inline void add_products(const double *scale, const double *x, double *restrict g)
{
#pragma omp simd
    for (size_t l = 0; l < PMA_LANES; l++)
        g[l] += scale[l] * x[l];
}

static void add_joined(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    const size_t k = load->each->k;
    const sum_of_samples sum = samples_at(load->each, t);
    for (size_t q = 0; q < sum.count * k; q++) {
        const size_t s = q / k, c = q % k;
        const double *row = load->values + (sum.row[s] * k + c) * PMA_LANES;
        const double *shape = load->shape + c * load->n;
        double scale[PMA_LANES];
#pragma omp simd
        for (size_t l = 0; l < PMA_LANES; l++)
            scale[l] = sum.weight[s] * row[l];
        for (size_t i = begin * PMA_LANES; i < end * PMA_LANES; i += PMA_LANES)
            add_products(scale, shape + i, g + i);
    }
}

/* ---- any load ------------------------------------------------------------------------------- */

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
    case PMA_LOAD_IN_LANES:
        (load->values ? add_joined : add_lanes_by_pieces)(load, t, begin / PMA_LANES,
                                                          end / PMA_LANES, g);
        break;
    case PMA_LOAD_NONE:
        break;
    }
}

void pma_load_add(const pma_load *load, double t, int64_t number, double *g)
{
    pma_load_add_rows(load, t, number, 0, load->n, g);
}
