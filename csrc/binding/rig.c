/* A specimen in a laboratory: the pace of a run, and a ring of records that another thread reads. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- pace ------------------------------------------------------------------------------- */

/* (origin, done, shift), times (5, rows) as in pma_pace */
static int take_times(PyObject *state, PyObject *times, pma_pace *pace)
{
    PyArrayObject *counts, *rows;
    const npy_intp three = 3, shape[2] = {5, -1};
    if (pma_take_array(state, NPY_INT64, 1, &three, "state", NULL, &counts) < 0 ||
        pma_take_array(times, NPY_DOUBLE, 2, shape, "times", NULL, &rows) < 0)
        return -1;
    const int64_t *count = PyArray_DATA(counts);
    if (!PyArray_ISWRITEABLE(rows) || !PyArray_ISWRITEABLE(counts) || count[1] < 0 ||
        !(pace->period > 0.0))
        return pma_refuse(PyExc_ValueError, "a pace needs writeable arrays and a positive period");
    double *const data = PyArray_DATA(rows);
    pace->rows = (size_t)PyArray_DIM(rows, 1);
    pace->begun = data;
    pace->commanded = data + pace->rows;
    pace->returned = data + 2 * pace->rows;
    pace->ended = data + 3 * pace->rows;
    pace->shifts = data + 4 * pace->rows;
    pace->origin = count[0];
    pace->done = (size_t)count[1];
    pace->shift = count[2];
    return 0;
}

/* The commands and forces of a subdomain at `positions`, in `last` (2, count). */
static int take_monitored(PyObject *positions, PyObject *last, const pma_subdomain *s,
                          pma_stamp *stamp)
{
    PyArrayObject *rows;
    if (pma_take_positions(positions, pma_subdomain_parts(s)->n, "positions", NULL, &stamp->count,
                           &stamp->position) < 0)
        return -1;
    const npy_intp shape[2] = {2, (npy_intp)stamp->count};
    if (pma_take_array(last, NPY_DOUBLE, 2, shape, "last", NULL, &rows) < 0)
        return -1;
    stamp->command = PyArray_DATA(rows);
    stamp->force = stamp->command + stamp->count;
    return 0;
}

/* The clock of the commands of a subdomain. */
static pma_limits_clock clock_of(CouplerObject *self, Py_ssize_t i, const pma_pace *pace)
{
    const double fine = (double)pma_coupler_instants(self->core);
    const double substeps = (double)pma_subdomain_parts(pma_subdomain_of(self, i)->core)->substeps;
    return (pma_limits_clock){
        .now = pace->clock.now, .ctx = pace->clock.ctx, .period = pace->period * (fine / substeps)};
}

/* Every subdomain with a restoring function has a stamp. `monitored`: for each subdomain None or
 * (positions, last) */
static int add_stamps(CouplerObject *self, PyObject *monitored, PyObject *values, pma_pace *pace)
{
    const Py_ssize_t count = PyTuple_Size(self->subdomains);
    if (PyTuple_Size(monitored) != count)
        return pma_refuse(PyExc_ValueError, "monitored must have an entry for each subdomain");
    pace->stamps = PyMem_Calloc((size_t)count + 1, sizeof *pace->stamps);
    if (!pace->stamps)
        return pma_check(PMA_NO_MEMORY, NULL);
    for (Py_ssize_t i = 0; i < count; i++) {
        pma_subdomain *s = pma_subdomain_of(self, i)->core;
        const pma_limits_clock clock = clock_of(self, i, pace);
        if (pma_check(pma_subdomain_time(s, NULL, &clock), NULL) < 0)
            return -1;
        if (!pma_subdomain_parts(s)->restoring.function)
            continue;
        pma_stamp *stamp = &pace->stamps[pace->stamp_count++];
        *stamp = (pma_stamp){.now = pace->clock.now, .ctx = pace->clock.ctx};
        PyObject *own = PyTuple_GetItem(monitored, i), *positions, *last;
        if (own != Py_None && (!PyArg_ParseTuple(own, "OO", &positions, &last) ||
                               take_monitored(positions, last, s, stamp) < 0))
            return -1;
        pace->columns += 2 * stamp->count;
        if (pma_check(pma_subdomain_time(s, stamp, &clock), NULL) < 0)
            return -1;
    }
    PyArrayObject *array;
    const npy_intp shape[2] = {(npy_intp)pace->rows, (npy_intp)pace->columns};
    if (pma_take_array(values, NPY_DOUBLE, 2, shape, "values", NULL, &array) < 0)
        return -1;
    pace->values = PyArray_DATA(array);
    return 0;
}

PyObject *pma_coupler_object_set_pace(CouplerObject *self, PyObject *obj)
{
    PyObject *pace = obj == Py_None ? NULL : Py_NewRef(obj);
    if (pace && !PyTuple_Check(pace)) {
        Py_DECREF(pace);
        return PyErr_Format(PyExc_TypeError, "a pace must be None or a tuple");
    }
    if (pma_coupler_claim(self) < 0) {
        Py_XDECREF(pace);
        return NULL;
    }
    pma_swap(&self->pace, &pace);
    pma_coupler_release(self);
    Py_XDECREF(pace);
    Py_RETURN_NONE;
}

int pma_take_pace(CouplerObject *self, long long steps, pma_pace *pace, int *signals)
{
    PyObject *state, *times, *monitored, *values, *woken;
    int stops;
    if (!self->pace)
        return 0;
    *pace = (pma_pace){.clock = pma_pace_system_clock};
    if (!PyArg_ParseTuple(self->pace, "dpiOOO!OO", &pace->period, &stops, signals, &state, &times,
                          &PyTuple_Type, &monitored, &values, &woken) ||
        take_times(state, times, pace) < 0)
        return -1;
    pace->stops = stops;
    const size_t fine = pma_coupler_instants(self->core), left = pace->rows - pace->done;
    if (self->processes || pace->done > pace->rows || left / fine < (size_t)steps)
        return pma_refuse(PyExc_ValueError, "the pace does not fit the coupler");
    if (add_stamps(self, monitored, values, pace) < 0)
        return -1;
    pma_coupler_set_pace(self->core, pace);
    return 0;
}

void pma_release_pace(CouplerObject *self, pma_pace *pace)
{
    if (!pace->stamps)
        return;
    pma_coupler_set_pace(self->core, NULL);
    for (Py_ssize_t i = 0; i < PyTuple_Size(self->subdomains); i++)
        (void)pma_subdomain_time(pma_subdomain_of(self, i)->core, NULL, NULL);
    int64_t *count = PyArray_DATA((PyArrayObject *)PyTuple_GetItem(self->pace, 3));
    count[0] = pace->origin;
    count[1] = (int64_t)pace->done;
    count[2] = pace->shift;
    PyMem_Free(pace->stamps);
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
    atomic_store(&self->ring.read, 0);
    atomic_store(&self->ring.written, pma_coupler_step_count(self->core));
    atomic_store(&self->ring.lost, 0);
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
    atomic_store_explicit(&self->ring.read, read, memory_order_release);
    const long long written = atomic_load_explicit(&self->ring.written, memory_order_acquire);
    return Py_BuildValue("(LL)", written, (long long)atomic_load(&self->ring.lost));
}
