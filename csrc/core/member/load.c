#include "member/load.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/kernel.h"

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

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}), t = (j + theta) dt                    (L1) */
static sum_of_samples samples_at(const pma_load *load, double x)
{
    const double last = (double)(load->samples - 1);
    if (x >= last)
        return (sum_of_samples){
            .count = load->hold || x == last, .row = {load->samples - 1}, .weight = {1.0}};
    const double begin = floor(x), theta = x - begin;
    return (sum_of_samples){.count = theta > 0.0 ? 2 : 1,
                            .row = {(size_t)begin, (size_t)begin + 1},
                            .weight = {1.0 - theta, theta}};
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

static void add_sampled(const pma_load *load, double t, range rows, double *g)
{
    const sum_of_samples sum = samples_at(load, sample_position(load->dt, t));
    for (size_t s = 0; s < sum.count; s++)
        add_sample(load, sum.row[s], sum.weight[s], rows, g);
}

static void add_value(const pma_load *load, range rows, double *g)
{
    for (size_t i = rows.begin; i < rows.end; i++)
        g[i] += load->work[load->order[i]];
}

/* ---- in lanes: each load is a sum of vectors, and those of all lanes are added together ------ */

/* The terms of the load of one lane. */
typedef struct {
    const pma_load *load;
    const double *vector; /* the only one, or NULL: of samples */
    sum_of_samples sum;
    size_t count;
} terms;

static terms terms_of(const pma_load *load, double x)
{
    switch (load->kind) {
    case PMA_LOAD_CONSTANT:
        return (terms){.load = load, .vector = load->values, .count = 1};
    case PMA_LOAD_SAMPLED: {
        const sum_of_samples sum = samples_at(load, x);
        return (terms){.load = load, .sum = sum, .count = sum.count * (load->shape ? load->k : 1)};
    }
    default:
        return (terms){.count = 0};
    }
}

static const double *term(const terms *of, size_t q, double *scale)
{
    const pma_load *load = of->load;
    *scale = 1.0;
    if (of->vector)
        return of->vector;
    const size_t columns = load->shape ? load->k : 1, s = q / columns, c = q % columns;
    const double *row = load->values + of->sum.row[s] * load->k;
    *scale = of->sum.weight[s];
    if (!load->shape)
        return row;
    *scale *= row[c];
    return load->shape + c * load->n;
}

/* g += the q-th term of every lane that has one */
static void add_terms(const terms *of, size_t q, range rows, double *g)
{
    const double *x[PMA_LANES];
    double scale[PMA_LANES];
    size_t with = 0;
    for (size_t l = 0; l < PMA_LANES; l++) {
        x[l] = q < of[l].count ? term(&of[l], q, &scale[l]) : NULL;
        with += x[l] != NULL;
    }
    for (size_t i = rows.begin; i < rows.end && with == PMA_LANES; i++) {
        for (size_t l = 0; l < PMA_LANES; l++)
            g[i * PMA_LANES + l] += scale[l] * x[l][i];
    }
    for (size_t l = 0; l < PMA_LANES && with < PMA_LANES; l++) {
        for (size_t i = rows.begin; i < rows.end && x[l]; i++)
            g[i * PMA_LANES + l] += scale[l] * x[l][i];
    }
}

static void add_lanes(const pma_load *load, double t, range rows, double *g)
{
    terms of[PMA_LANES];
    size_t most = 0;
    double x = 0.0, dt = 0.0; /* most often all records have the same step */
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_load *own = &load->each[l];
        if (own->kind == PMA_LOAD_SAMPLED && own->dt != dt) {
            dt = own->dt;
            x = sample_position(dt, t);
        }
        of[l] = terms_of(own, x);
        most = of[l].count > most ? of[l].count : most;
    }
    for (size_t q = 0; q < most; q++)
        add_terms(of, q, rows, g);
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
    case PMA_LOAD_IN_LANES:
        add_lanes(load, t, (range){begin / PMA_LANES, end / PMA_LANES}, g);
        break;
    case PMA_LOAD_NONE:
        break;
    }
}

void pma_load_add(const pma_load *load, double t, int64_t number, double *g)
{
    pma_load_add_rows(load, t, number, 0, load->n, g);
}
