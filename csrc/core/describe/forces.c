/* Restoring and internal forces, and what impulses meet, from their fields. */
#include <string.h>

#include "describe/describe.h"

/* ---- restoring forces ----------------------------------------------------------------------- */

/* Time levels and copies that have what springs remember. */
enum { LEVELS = 8 };

/* Several functions as one: their sum, in this order. */
typedef struct {
    double *work; /* 3 n: scratch */
    size_t count;
    pma_function *each;
} series;

static int call_series(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const series *all = user;
    const size_t bytes = (size_t)n * sizeof(double);
    double *own_u = all->work, *own_v = own_u + n, *term = own_v + n;
    for (size_t i = 0; i < all->count; i++) {
        memcpy(own_u, u, bytes); /* a function may write into its arguments */
        memcpy(own_v, v, bytes);
        memset(term, 0, bytes);
        const int code = all->each[i].function(t, n, own_u, own_v, term, all->each[i].user);
        if (code != 0)
            return code;
        for (intptr_t k = 0; k < n; k++)
            r[k] += term[k];
    }
    return 0;
}

/* A specimen, and where its memory begins in that of the restoring force. */
typedef struct {
    pma_specimen *core;
    size_t offset;
} specimen_function;

static int call_specimen(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const specimen_function *own = user;
    const pma_cell *cell = own->core->cell;
    const pma_wanted wanted = {.u = u, .v = v, .a = cell->a, .ahead = cell->ahead};
    (void)n;
    return pma_specimen_evaluate(own->core, t, &wanted, r, cell->memory + own->offset);
}

static pma_status take_specimen(const pma_field *f, size_t n, pma_restoring *restoring,
                                pma_trace *trace, pma_function *out)
{
    specimen_function *own;
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    PMA_TRY(pma_parts_specimen(f, n, &own->core, &out->by_caller));
    own->core->cell = restoring->cell;
    if (own->core->h > 0.0 && !restoring->cell->a)
        PMA_TRY(pma_field_allocate(f, n, sizeof(double), (void *)&restoring->cell->a));
    own->core->number = restoring->compensators;
    restoring->compensators += own->core->compensators > 0;
    own->offset = restoring->memory;
    *trace = pma_specimen_trace(own->core);
    trace->command += own->offset;
    trace->sent += own->offset;
    trace->measured += own->offset;
    trace->force += own->offset;
    restoring->memory += pma_specimen_numbers(own->core);
    out->function = call_specimen;
    out->user = own;
    return PMA_OK;
}

/* Springs of which ends move, and where their memory begins. Something outside drives their ends,
 * so that their work is that of a load: `pushed` (n) gets what they push with. */
typedef struct {
    pma_wheels wheels;
    const pma_cell *cell;
    size_t offset;
    double *pushed;
} wheels_function;

static int call_wheels(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const wheels_function *own = user;
    pma_wheels_add(&own->wheels, t, u, v, r, own->cell->memory + own->offset);
    for (intptr_t i = 0; i < n; i++)
        own->pushed[i] -= r[i];
    return 0;
}

/* A function with springs among what it sums, which adds the load of the user to `pushed`. */
typedef struct {
    pma_function inner;
    const double *load; /* n, or NULL */
    double *pushed;
} pushed_function;

static int call_pushed(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const pushed_function *own = user;
    memset(own->pushed, 0, (size_t)n * sizeof(double));
    const int code = own->inner.function(t, n, u, v, r, own->inner.user);
    for (intptr_t i = 0; own->load && i < n; i++)
        own->pushed[i] += own->load[i];
    return code;
}

static pma_status take_pushed(const pma_field *f, double *pushed, pma_restoring *out)
{
    pushed_function *own;
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    own->inner = (pma_function){.function = out->function, .user = out->user};
    own->load = out->load;
    own->pushed = pushed;
    out->function = call_pushed;
    out->user = own;
    out->load = pushed;
    return PMA_OK;
}

static pma_status take_paths(const pma_field *f, size_t n, pma_wheels *out)
{
    const pma_field list = pma_field_at(f, "paths");
    pma_path *paths;
    PMA_TRY(pma_field_tuple(&list, &out->count));
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *paths, (void *)&paths));
    out->paths = paths;
    for (size_t k = 0; k < out->count; k++) {
        const pma_field path = pma_field_item(&list, k);
        PMA_TRY(pma_parts_path(&path, n, &paths[k]));
    }
    return PMA_OK;
}

static pma_status take_wheels(const pma_field *f, size_t n, pma_restoring *restoring,
                              double **pushed, pma_function *out)
{
    const pma_field springs = pma_field_at(f, "springs"), ends = pma_field_at(f, "ends");
    const pma_field points = pma_field_at(f, "points");
    wheels_function *own;
    const void *data = NULL;
    PMA_TRY(pma_field_allocate(f, 1, sizeof *own, (void *)&own));
    PMA_TRY(pma_parts_springs(&springs, &own->wheels.springs));
    int64_t extents[2] = {(int64_t)own->wheels.springs.total, 2};
    PMA_TRY(pma_field_array(&ends, PMA_INT64S, 2, extents, &data));
    own->wheels.dofs = data;
    PMA_TRY(pma_field_array(&points, PMA_INT64S, 2, extents, &data));
    own->wheels.points = data;
    PMA_TRY(take_paths(f, n, &own->wheels));
    if (pma_wheels_check(&own->wheels, n) != PMA_OK)
        return pma_field_refuse(&ends, "must be dofs and paths of springs that follow one another");
    PMA_TRY(pma_field_allocate(f, own->wheels.count, sizeof *own->wheels.places,
                               (void *)&own->wheels.places));
    PMA_TRY(pma_field_allocate(f, 6 * own->wheels.springs.total, sizeof *own->wheels.work,
                               (void *)&own->wheels.work));
    PMA_TRY(pma_field_room(f, pma_springs_numbers(&own->wheels.springs), LEVELS * sizeof(double)));
    if (!*pushed)
        PMA_TRY(pma_field_allocate(f, n, sizeof **pushed, (void *)pushed));
    own->pushed = *pushed;
    own->cell = restoring->cell;
    own->offset = restoring->memory;
    restoring->memory += pma_springs_numbers(&own->wheels.springs);
    out->function = call_wheels;
    out->user = own;
    return PMA_OK;
}

/* How many of the numbers that a function remembers are counts; and these, if wanted. */
static size_t counts_of(const pma_function *function, pma_state_counts *counts)
{
    const specimen_function *specimen = function->user;
    const wheels_function *moving = function->user;
    size_t tables = 0, offset = 0;
    if (function->function == call_specimen) {
        tables = pma_specimen_tables(specimen->core);
        offset = specimen->offset;
        if (counts)
            pma_specimen_counts(specimen->core, counts);
    } else if (function->function == call_wheels) {
        tables = pma_springs_tables(&moving->wheels.springs);
        offset = moving->offset;
        if (counts)
            pma_springs_counts(&moving->wheels.springs, counts);
    }
    for (size_t k = 0; counts && k < tables; k++)
        counts[k].first += offset;
    return tables;
}

/* What of the memory of all functions are counts. */
static pma_status find_counts(const pma_field *f, const series *all, pma_restoring *out)
{
    pma_state_counts *counts;
    for (size_t i = 0; i < all->count; i++)
        out->tables += counts_of(&all->each[i], NULL);
    PMA_TRY(pma_field_allocate(f, out->tables, sizeof *counts, (void *)&counts));
    out->counts = counts;
    for (size_t i = 0; i < all->count; i++)
        counts += counts_of(&all->each[i], counts);
    return PMA_OK;
}

/* A function of the user, a specimen, or springs that move. */
static pma_status take_function(const pma_field *f, size_t n, pma_restoring *restoring,
                                pma_trace *traces, double **pushed, pma_function *out)
{
    if (f->node->kind != PMA_DICT)
        return pma_field_find(f, PMA_RESTORING_ROLE, out);
    if (pma_field_has(f, "paths"))
        return take_wheels(f, n, restoring, pushed, out);
    return take_specimen(f, n, restoring, &traces[restoring->traces++], out);
}

static pma_status take_functions(const pma_field *f, size_t n, pma_restoring *out)
{
    series *all;
    pma_trace *traces;
    double *pushed = NULL;
    PMA_TRY(pma_field_allocate(f, 1, sizeof *all, (void *)&all));
    PMA_TRY(pma_field_tuple(f, &all->count));
    if (all->count == 0)
        return pma_field_refuse(f, "must not be empty");
    PMA_TRY(pma_field_allocate(f, all->count, sizeof *all->each, (void *)&all->each));
    PMA_TRY(pma_field_allocate(f, 3 * n, sizeof *all->work, (void *)&all->work));
    PMA_TRY(pma_field_allocate(f, 1, sizeof *out->cell, (void *)&out->cell));
    PMA_TRY(pma_field_allocate(f, all->count, sizeof *traces, (void *)&traces));
    out->trace = traces;
    for (size_t i = 0; i < all->count; i++) {
        const pma_field function = pma_field_item(f, i);
        PMA_TRY(take_function(&function, n, out, traces, &pushed, &all->each[i]));
        out->by_caller = out->by_caller || all->each[i].by_caller;
    }
    PMA_TRY(find_counts(f, all, out));
    out->function = all->count == 1 ? all->each[0].function : call_series;
    out->user = all->count == 1 ? all->each[0].user : all;
    return pushed ? take_pushed(f, pushed, out) : PMA_OK;
}

pma_status pma_parts_restoring(const pma_field *f, size_t n, pma_restoring *out)
{
    const pma_field functions = pma_field_at(f, "functions"), load = pma_field_at(f, "load");
    *out = (pma_restoring){.n = n};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_parts_order(f, n, &out->order));
    if (!pma_field_is_none(&load))
        PMA_TRY(pma_field_doubles(&load, n, &out->load));
    PMA_TRY(pma_field_allocate(f, 3 * n, sizeof *out->work, (void *)&out->work));
    return take_functions(&functions, n, out);
}

/* ---- internal forces ------------------------------------------------------------------------ */

static pma_status take_force(const pma_field *f, pma_internal_force *out)
{
    const pma_field function = pma_field_at(f, "function"), history = pma_field_at(f, "history");
    const pma_field where = pma_field_at(f, "where"), across = pma_field_at(f, "across");
    const pma_field potential = pma_field_at(f, "potential");
    const void *data = NULL;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&history, 0, &out->history));
    if (!pma_field_is_none(&where)) {
        PMA_TRY(pma_field_vector(&where, PMA_INT64S, &out->entries, &data));
        out->where = data;
        if (!pma_field_is_none(&across))
            PMA_TRY(pma_field_longs(&across, out->entries, &out->across));
    }
    PMA_TRY(pma_field_find(&function, PMA_INTERNAL_ROLE, out));
    return pma_field_is_none(&potential) ? PMA_OK
                                         : pma_field_find(&potential, PMA_POTENTIAL_ROLE, out);
}

pma_status pma_parts_internal(const pma_field *f, size_t n, pma_internal *out)
{
    const pma_field initial = pma_field_at(f, "initial"), list = pma_field_at(f, "forces");
    pma_internal_force *forces;
    const void *data = NULL;
    *out = (pma_internal){.n = n};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_parts_order(f, n, &out->order));
    PMA_TRY(pma_field_vector(&initial, PMA_DOUBLES, &out->history, &data));
    out->initial = data;
    PMA_TRY(pma_field_tuple(&list, &out->count));
    PMA_TRY(pma_field_allocate(f, out->count, sizeof *forces, (void *)&forces));
    out->forces = forces;
    for (size_t k = 0; k < out->count; k++) {
        const pma_field force = pma_field_item(&list, k);
        PMA_TRY(take_force(&force, &forces[k]));
    }
    return PMA_OK;
}

/* ---- impulses ------------------------------------------------------------------------------- */

pma_status pma_parts_impulse(const pma_field *f, size_t nb, pma_impulse_parts *out)
{
    const pma_field inverse = pma_field_at(f, "inverse"), B = pma_field_at(f, "B");
    const pma_field alpha = pma_field_at(f, "alpha"), beta = pma_field_at(f, "beta");
    pma_link columns;
    *out = (pma_impulse_parts){.inverse = NULL};
    if (pma_field_is_none(f))
        return PMA_OK;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_doubles(&inverse, nb, &out->inverse));
    PMA_TRY(pma_field_real(&alpha, &out->alpha));
    PMA_TRY(pma_field_real(&beta, &out->beta));
    if (pma_field_is_none(&B))
        return PMA_OK;
    PMA_TRY(pma_parts_link(&B, nb, &columns));
    out->ptr = columns.ptr;
    out->index = columns.index;
    out->values = columns.values;
    return PMA_OK;
}
