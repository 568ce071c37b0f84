/* A specimen in a laboratory: the pace of a run, and a ring of records that another thread
 * reads. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <limits.h>

/* ---- pace ------------------------------------------------------------------------------- */

/* state (3,): origin, done, shift; times (5, rows) as in pma_pace */
static pma_status take_times(const pma_field *f, pma_pace *pace, int64_t **state)
{
    const pma_field counts = pma_field_at(f, "state"), times = pma_field_at(f, "times");
    int64_t shape[2] = {5, -1};
    const int64_t *count = NULL;
    double *data = NULL;
    PMA_TRY(pma_field_longs(&counts, 3, &count));
    PMA_TRY(pma_field_output(&times, 2, shape, &data));
    if (count[1] < 0 || !counts.node->is_writeable)
        return pma_field_refuse(&counts, "must be writeable, with a number of steps");
    pace->rows = (size_t)shape[1];
    pace->begun = data;
    pace->commanded = data + pace->rows;
    pace->returned = data + 2 * pace->rows;
    pace->ended = data + 3 * pace->rows;
    pace->shifts = data + 4 * pace->rows;
    pace->origin = count[0];
    pace->done = (size_t)count[1];
    pace->shift = count[2];
    *state = (int64_t *)(uintptr_t)count;
    return PMA_OK;
}

/* {positions, last}: the commands and forces of a subdomain there, in `last` (2, count). */
static pma_status take_monitored(const pma_field *f, size_t n, pma_stamp *stamp)
{
    const pma_field positions = pma_field_at(f, "positions"), last = pma_field_at(f, "last");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_positions(&positions, n, &stamp->count, &stamp->position));
    int64_t shape[2] = {2, (int64_t)stamp->count};
    PMA_TRY(pma_field_output(&last, 2, shape, &stamp->command));
    stamp->force = stamp->command + stamp->count;
    return PMA_OK;
}

/* The clock of the commands of a subdomain. */
static pma_limits_clock clock_of(CouplerObject *self, Py_ssize_t i, const pma_pace *pace)
{
    const double fine = (double)pma_coupler_instants(self->core);
    const double substeps = (double)pma_subdomain_parts(pma_subdomain_of(self, i)->core)->substeps;
    return (pma_limits_clock){
        .now = pace->clock.now, .ctx = pace->clock.ctx, .period = pace->period * (fine / substeps)};
}

/* Every subdomain with a restoring function has a stamp. monitored: None or {positions, last} of
 * each subdomain */
static pma_status add_stamps(CouplerObject *self, const pma_field *f, pma_pace *pace)
{
    const pma_field monitored = pma_field_at(f, "monitored"), values = pma_field_at(f, "values");
    const size_t own = (size_t)PyTuple_Size(self->subdomains);
    size_t count;
    PMA_TRY(pma_field_tuple(&monitored, &count));
    if (count != own)
        return pma_field_refuse(&monitored, "must have an entry for each subdomain");
    PMA_TRY(pma_field_allocate(f, count, sizeof *pace->stamps, (void *)&pace->stamps));
    for (size_t i = 0; i < count; i++) {
        pma_subdomain *s = pma_subdomain_of(self, (Py_ssize_t)i)->core;
        const pma_parts *parts = pma_subdomain_parts(s);
        const pma_limits_clock clock = clock_of(self, (Py_ssize_t)i, pace);
        PMA_TRY(pma_subdomain_time(s, NULL, &clock));
        if (!parts->restoring.function)
            continue;
        pma_stamp *stamp = &pace->stamps[pace->stamp_count++];
        *stamp = (pma_stamp){.now = pace->clock.now, .ctx = pace->clock.ctx};
        const pma_field item = pma_field_item(&monitored, i);
        if (!pma_field_is_none(&item))
            PMA_TRY(take_monitored(&item, parts->n, stamp));
        pace->columns += 2 * stamp->count;
        PMA_TRY(pma_subdomain_time(s, stamp, &clock));
    }
    int64_t shape[2] = {(int64_t)pace->rows, (int64_t)pace->columns};
    return pma_field_output(&values, 2, shape, &pace->values);
}

static pma_status take_pace(CouplerObject *self, const pma_field *f, long long steps,
                            pma_paced_run *run)
{
    const pma_field period = pma_field_at(f, "period"), stops = pma_field_at(f, "stops");
    const pma_field signals = pma_field_at(f, "signals"), woken = pma_field_at(f, "woken");
    pma_pace *pace = &run->pace;
    int64_t file;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_real(&period, &pace->period));
    PMA_TRY(pma_field_flag(&stops, &pace->stops));
    PMA_TRY(pma_field_integer(&signals, -1, &file));
    PMA_TRY(pma_field_find(&woken, PMA_OBJECT_ROLE, (void *)&run->woken));
    if (!(pace->period > 0.0) || file > INT_MAX)
        return pma_field_refuse(&period, "must be positive, and signals a file");
    run->signals = (int)file;
    PMA_TRY(take_times(f, pace, &run->state));
    const size_t fine = pma_coupler_instants(self->core), left = pace->rows - pace->done;
    if (self->processes || pace->done > pace->rows || left / fine < (size_t)steps)
        return pma_field_refuse(f, "does not fit the coupler");
    return add_stamps(self, f, pace);
}

PyObject *pma_coupler_object_set_pace(CouplerObject *self, PyObject *obj)
{
    PyObject *pace = obj == Py_None ? NULL : Py_NewRef(obj);
    if (pma_coupler_claim(self) < 0) {
        Py_XDECREF(pace);
        return NULL;
    }
    pma_swap(&self->pace, &pace);
    pma_coupler_release(self);
    Py_XDECREF(pace);
    Py_RETURN_NONE;
}

int pma_take_pace(CouplerObject *self, long long steps, PyObject *arrays, pma_paced_run *run)
{
    pma_argument arg;
    *run = (pma_paced_run){.pace = {.clock = pma_pace_system_clock}, .signals = -1};
    if (!self->pace)
        return 0;
    const pma_field root = pma_read(&arg, self->pace, "pace", arrays);
    if (pma_end(&arg, take_pace(self, &root, steps, run)) < 0)
        return -1;
    pma_coupler_set_pace(self->core, &run->pace);
    return 0;
}

void pma_release_pace(CouplerObject *self, pma_paced_run *run)
{
    if (!run->state)
        return;
    pma_coupler_set_pace(self->core, NULL);
    for (Py_ssize_t i = 0; i < PyTuple_Size(self->subdomains); i++)
        (void)pma_subdomain_time(pma_subdomain_of(self, i)->core, NULL, NULL);
    run->state[0] = run->pace.origin;
    run->state[1] = (int64_t)run->pace.done;
    run->state[2] = run->pace.shift;
}

/* ---- a ring of records ---------------------------------------------------------------------- */

PyObject *pma_coupler_object_set_ring(CouplerObject *self, PyObject *obj)
{
    const npy_intp any = -1;
    PyArrayObject *array = NULL;
    if (obj != Py_None && pma_take_array(obj, NPY_INT64, 1, &any, "steps", NULL, &array) < 0)
        return NULL;
    if (array && (PyArray_DIM(array, 0) < 1 || !PyArray_ISWRITEABLE(array)))
        return PyErr_Format(PyExc_ValueError, "steps must be writeable and not empty");
    if (pma_coupler_claim(self) < 0)
        return NULL;
    PyObject *slots = array ? Py_NewRef(obj) : NULL;
    pma_swap(&self->slots, &slots);
    self->ring.size = array ? (int64_t)PyArray_DIM(array, 0) : 0;
    self->ring.steps = array ? PyArray_DATA(array) : NULL;
    pma_count_set(&self->ring.read, 0);
    pma_count_set(&self->ring.written, pma_coupler_step_count(self->core));
    pma_count_set(&self->ring.lost, 0);
    pma_coupler_release(self);
    Py_XDECREF(slots);
    Py_RETURN_NONE;
}

/* Not claimed: it is another thread that calls it while the coupler is stepped. */
PyObject *pma_coupler_object_ring(CouplerObject *self, PyObject *obj)
{
    const long long read = PyLong_AsLongLong(obj);
    if (read == -1 && PyErr_Occurred())
        return NULL;
    pma_count_set(&self->ring.read, read);
    const long long written = pma_count_get(&self->ring.written);
    return Py_BuildValue("(LL)", written, (long long)pma_count_get(&self->ring.lost));
}
