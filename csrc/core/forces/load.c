#include "forces/load.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "algebra/lists.h"

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
static double sample_position(const pma_load *load, double t)
{
    const double x = (t - load->begin) / load->dt, nearest = nearbyint(x);
    return fabs(x - nearest) <= 16.0 * DBL_EPSILON * nearest ? nearest : x;
}

/* The samples of which F(t) is a sum: at most two, with their weights. */
typedef struct {
    size_t count, row[2];
    double weight[2];
} sum_of_samples;

/* F(t) = shape ((1 - theta) s_j + theta s_{j+1}) at the position j + theta, the first sample before
 * (L1) */
static sum_of_samples samples_at(const pma_load *load, double position)
{
    const double x = position > 0.0 ? position : 0.0;
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

/* F(t) = N(s)^T p(t), p between samples as in (L1)                                         (L7) */
static void add_moving(const pma_load *load, double t, range rows, double *g)
{
    const pma_place place = pma_path_at(load->path, t);
    const sum_of_samples sum = samples_at(load, sample_position(load, t));
    double p = 0.0;
    for (size_t s = 0; s < sum.count; s++)
        p += sum.weight[s] * load->values[sum.row[s]];
    pma_path_add(load->path, &place, p, rows.begin, rows.end, g);
}

static void add_value(const pma_load *load, range rows, double *g)
{
    for (size_t i = rows.begin; i < rows.end; i++)
        g[i] += load->work[load->order[i]];
}

/* ---- in lanes ------------------------------------------------------------------------------- */

enum { PIECE = 256 }; /* dofs at a time, whose g stays in the first cache from term to term */

/* One of the loads that a load is the sum of, or itself, as a sampled one: a constant load is a
 * sample that is held, times a shape; what is no load has no series. */
static pma_load term_of(const pma_load *load, size_t i)
{
    static const double one = 1.0;
    const pma_load *term = load;
    if (load->kind == PMA_LOAD_SUM)
        term = i < load->count ? &load->each[i] : NULL;
    else if (i > 0)
        term = NULL;
    if (term && term->kind == PMA_LOAD_SAMPLED)
        return *term;
    const double *constant = term && term->kind == PMA_LOAD_CONSTANT ? term->values : NULL;
    return (pma_load){.kind = PMA_LOAD_SAMPLED,
                      .n = load->n,
                      .values = &one,
                      .shape = constant ? constant : &one,
                      .samples = 1,
                      .k = constant ? 1 : 0,
                      .dt = 1.0,
                      .hold = true};
}

/* The vectors that act on all of its dofs. */
static size_t series_of(const pma_load *term)
{
    return term->shape ? term->k : 0;
}

static size_t most_series(const pma_load *each, size_t i)
{
    size_t most = 0;
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_load term = term_of(&each[l], i);
        most = pma_most(most, series_of(&term));
    }
    return most;
}

static bool have_equal_times(const pma_load *load, const pma_load *other)
{
    return load->dt == other->dt && load->begin == other->begin &&
           load->samples == other->samples && load->hold == other->hold;
}

size_t pma_load_lane_terms(const pma_load *each)
{
    size_t most = 1;
    for (size_t l = 0; l < PMA_LANES; l++)
        most = pma_most(most, each[l].kind == PMA_LOAD_SUM ? each[l].count : 1);
    return most;
}

size_t pma_load_lane_shapes(const pma_load *each)
{
    size_t series = 0;
    for (size_t i = 0; i < pma_load_lane_terms(each); i++)
        series += most_series(each, i);
    return series * each->n * PMA_LANES;
}

/* Term i of the loads, with its shapes in an array of zeros. */
static pma_lane_term take_lane_term(const pma_load *each, size_t i, double *shape)
{
    pma_lane_term term = {.series = most_series(each, i), .shape = shape, .has_equal_times = true};
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_load own = term.of[l] = term_of(&each[l], i);
        const size_t count = series_of(&own) * own.n;
        for (size_t k = 0; k < count; k++)
            shape[k * PMA_LANES + l] = own.shape[k];
        term.has_units |= !own.shape;
        term.has_equal_times = term.has_equal_times && have_equal_times(&own, &term.of[0]);
    }
    return term;
}

pma_load pma_load_in_lanes(const pma_load *each, pma_lane_term *terms, double *shapes)
{
    const pma_load load = {.kind = PMA_LOAD_IN_LANES,
                           .n = each->n * PMA_LANES,
                           .terms = terms,
                           .count = pma_load_lane_terms(each)};
    memset(shapes, 0, pma_load_lane_shapes(each) * sizeof *shapes);
    for (size_t i = 0; i < load.count; i++) {
        terms[i] = take_lane_term(each, i, shapes);
        shapes += terms[i].series * load.n;
    }
    return load;
}

/* Of what samples the term of each lane is a sum; of equal times the first is that of all lanes. */
static void lane_samples(const pma_lane_term *term, double t, sum_of_samples *sums)
{
    const size_t count = term->has_equal_times ? 1 : PMA_LANES;
    for (size_t l = 0; l < count; l++)
        sums[l] = samples_at(&term->of[l], sample_position(&term->of[l], t));
}

static inline const sum_of_samples *sum_of_lane(const pma_lane_term *term,
                                                const sum_of_samples *sums, size_t l)
{
    return &sums[term->has_equal_times ? 0 : l];
}

/* g += scale shape, of each lane */
PMA_LANE_LOOP(add_series,
              (const double *scale, const double *shape, size_t begin, size_t end, double *g), {
                  const number s = *(const number *)scale, *from = (const number *)shape;
                  number *to = (number *)g;
                  for (size_t i = begin; i < end; i++)
                      PMA_ADD_LANES(&s, &from[i], &to[i]);
              })

/* Weight times sample s of series c, of the lanes that have them; the others add zero. */
static inline void lane_scales(const pma_lane_term *term, const sum_of_samples *sums, size_t s,
                               size_t c, double *scale)
{
    for (size_t l = 0; l < PMA_LANES; l++) {
        const pma_load *own = &term->of[l];
        const sum_of_samples *sum = sum_of_lane(term, sums, l);
        const bool has = s < sum->count && c < own->k && own->shape;
        scale[l] = has ? sum->weight[s] * own->values[sum->row[s] * own->k + c] : 0.0;
    }
}

static void add_lane_term(const pma_lane_term *term, const sum_of_samples *sums, size_t n,
                          range rows, double *g)
{
    size_t most = 0;
    for (size_t l = 0; l < PMA_LANES; l++)
        most = pma_most(most, sum_of_lane(term, sums, l)->count);
    for (size_t s = 0; s < most; s++) {
        for (size_t c = 0; c < term->series; c++) {
            double scale[PMA_LANES];
            lane_scales(term, sums, s, c, scale);
            (pma_has_avx2() ? add_series_avx2 : add_series_plain)(scale, term->shape + c * n,
                                                                  rows.begin, rows.end, g);
        }
    }
    for (size_t l = 0; l < PMA_LANES && term->has_units; l++) {
        if (!term->of[l].shape)
            add_samples(&term->of[l], sum_of_lane(term, sums, l), rows, g + l);
    }
}

static void add_lanes(const pma_load *load, double t, size_t begin, size_t end, double *g)
{
    for (size_t i = 0; i < load->count; i++) {
        sum_of_samples sums[PMA_LANES];
        lane_samples(&load->terms[i], t, sums);
        for (size_t from = begin; from < end; from += PIECE) {
            const size_t to = end - from < PIECE ? end : from + PIECE;
            add_lane_term(&load->terms[i], sums, load->n, (range){from, to, PMA_LANES}, g);
        }
    }
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
        const sum_of_samples sum = samples_at(load, sample_position(load, t));
        add_samples(load, &sum, rows, g);
        break;
    }
    case PMA_LOAD_TABLE:
        assert(number >= load->first && (size_t)(number - load->first) < load->rows);
        add_scaled(rows, 1.0, load->values + (size_t)(number - load->first) * load->n, g);
        break;
    case PMA_LOAD_MOVING:
        add_moving(load, t, rows, g);
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
