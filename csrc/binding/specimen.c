/* Specimens behind actuators and compensators: conversion, and runs of given commands. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "member/specimen.h"

/* Lags and samples of a filter: numbers of what it remembers do not overflow. */
enum { MOST = 1 << 30 };

/* A specimen, what it points into, and where its memory begins in that of the restoring force. */
typedef struct {
    pma_specimen core;
    pma_spring_set *sets;
    size_t offset;
    pma_filter filters[];
} specimen;

static void free_specimen(PyObject *owner)
{
    specimen *own = PyCapsule_GetPointer(owner, NULL);
    for (size_t k = 0; k < own->core.count; k++)
        PyMem_Free((void *)own->filters[k].adaptive);
    PyMem_Free(own->sets);
    PyMem_Free(own);
}

static specimen *add_specimen(Py_ssize_t filters, npy_intp n, PyObject *arrays)
{
    specimen *own = PyMem_Calloc(1, sizeof *own + (size_t)filters * sizeof own->filters[0]);
    if (own)
        own->core =
            (pma_specimen){.n = (size_t)n, .count = (size_t)filters, .filters = own->filters};
    if (pma_keep(own, free_specimen, arrays) < 0)
        return NULL;
    own->core.work = pma_add_scratch(n, arrays);
    return own->core.work ? own : NULL;
}

/* (lag, weight, largest, phi, before, after, slope, noise, quantum, seed) */
static int take_actuator(PyObject *obj, PyObject *arrays, pma_actuator *out)
{
    PyObject *lag, *weight, *phi, *before, *after, *slope;
    PyArrayObject *square;
    const npy_intp any[2] = {-1, -1};
    npy_intp taps = -1;
    unsigned long long seed;
    if (!PyArg_ParseTuple(obj, "OOdOOOOddK", &lag, &weight, &out->largest, &phi, &before, &after,
                          &slope, &out->noise, &out->quantum, &seed) ||
        pma_take_vector(lag, NPY_INT64, &taps, "lag", arrays, &out->lag) < 0 ||
        pma_take_array(phi, NPY_DOUBLE, 2, any, "phi", arrays, &square) < 0)
        return -1;
    const npy_intp order = PyArray_DIM(square, 0);
    out->seed = seed;
    out->taps = (size_t)taps;
    out->phi = PyArray_DATA(square);
    out->order = (size_t)order;
    out->length = 1;
    bool fits = order <= PMA_ACTUATOR_ORDER && order == PyArray_DIM(square, 1);
    for (npy_intp i = 0; i < taps; i++) {
        fits = fits && out->lag[i] >= 0 && out->lag[i] < MOST;
        out->length = (size_t)out->lag[i] + 1 > out->length ? (size_t)out->lag[i] + 1 : out->length;
    }
    if (!fits)
        return pma_refuse(PyExc_ValueError, "phi or lag is out of range");
    if (pma_take_doubles(weight, taps, "weight", arrays, &out->weight) < 0 ||
        pma_take_doubles(before, order, "before", arrays, &out->before) < 0 ||
        pma_take_doubles(after, order, "after", arrays, &out->after) < 0)
        return -1;
    return pma_take_doubles(slope, order + 1, "slope", arrays, &out->slope);
}

/* (h, (start, least, most, change), threshold, every, window, section) */
static int take_adaptive(PyObject *obj, PyObject *arrays, pma_adaptive *out)
{
    PyObject *limits, *section;
    PyArrayObject *limit, *sections;
    const npy_intp four[2] = {4, PMA_ADAPTIVE_TERMS}, five[2] = {-1, 5};
    Py_ssize_t every, window;
    if (!PyArg_ParseTuple(obj, "dOdnnO", &out->h, &limits, &out->threshold, &every, &window,
                          &section) ||
        pma_take_array(limits, NPY_DOUBLE, 2, four, "limits", NULL, &limit) < 0 ||
        pma_take_array(section, NPY_DOUBLE, 2, five, "section", arrays, &sections) < 0)
        return -1;
    if (every < 1 || window < 1 || window > MOST)
        return pma_refuse(PyExc_ValueError, "every and window must be positive, and not too large");
    const double *values = PyArray_DATA(limit);
    const size_t bytes = sizeof out->start;
    memcpy(out->start, values, bytes);
    memcpy(out->least, values + PMA_ADAPTIVE_TERMS, bytes);
    memcpy(out->most, values + 2 * PMA_ADAPTIVE_TERMS, bytes);
    memcpy(out->change, values + 3 * PMA_ADAPTIVE_TERMS, bytes);
    out->every = (size_t)every;
    out->window = (size_t)window;
    out->sections = (size_t)PyArray_DIM(sections, 0);
    out->section = PyArray_DATA(sections);
    return 0;
}

static int take_filter(PyObject *obj, PyObject *arrays, pma_filter *out)
{
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "a filter must be a tuple");
    if (PyTuple_Size(obj) != 6)
        return take_actuator(obj, arrays, &out->actuator);
    pma_adaptive *adaptive = PyMem_Calloc(1, sizeof *adaptive);
    out->adaptive = adaptive;
    if (!adaptive)
        return pma_check(PMA_NO_MEMORY, NULL);
    return take_adaptive(obj, arrays, adaptive);
}

/* (filters, springs, function or None, number of compensators) */
static specimen *take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, bool *by_caller)
{
    PyObject *filters, *springs, *function;
    Py_ssize_t compensators;
    if (!PyArg_ParseTuple(obj, "O!O!On", &PyTuple_Type, &filters, &PyTuple_Type, &springs,
                          &function, &compensators))
        return NULL;
    if (compensators < 0 || compensators > PyTuple_Size(filters))
        return (void *)PyErr_Format(PyExc_ValueError, "compensators must be among the filters");
    specimen *own = add_specimen(PyTuple_Size(filters), n, arrays);
    if (!own || pma_take_springs(springs, arrays, &own->sets, &own->core.springs) < 0)
        return NULL;
    const pma_status status = pma_springs_check(&own->core.springs, (size_t)n);
    if (status != PMA_OK)
        return pma_raise(status, "springs"), NULL;
    for (Py_ssize_t k = 0; k < PyTuple_Size(filters); k++) {
        if (take_filter(PyTuple_GetItem(filters, k), arrays, &own->filters[k]) < 0)
            return NULL;
    }
    pma_callback inner = {NULL, NULL};
    if (function != Py_None && pma_take_callback(function, &inner, by_caller) < 0)
        return NULL;
    own->core.compensators = (size_t)compensators;
    own->core.function = inner.function;
    own->core.user = inner.user;
    return own;
}

static int call_specimen(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const specimen *own = user;
    (void)n;
    return pma_specimen_evaluate(&own->core, t, u, v, r, own->core.cell->memory + own->offset);
}

int pma_take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, pma_restoring *restoring,
                      pma_callback *out)
{
    specimen *own = take_specimen(obj, n, arrays, &restoring->by_caller);
    if (!own)
        return -1;
    own->core.cell = restoring->cell;
    own->core.number = restoring->compensators;
    restoring->compensators += own->core.compensators > 0;
    own->offset = restoring->memory;
    restoring->memory += pma_specimen_numbers(&own->core);
    *out = (pma_callback){call_specimen, own};
    return 0;
}

/* ---- a run of given commands ---------------------------------------------------------------- */

/* r and x (k, n), from their zeros; -1 with an exception set */
static int run_commands(const specimen *own, npy_intp k, const double *t, const double *u,
                        const double *v, double *r, double *x)
{
    const size_t n = own->core.n, bytes = n * sizeof(double);
    double *memory = PyMem_Calloc(pma_specimen_numbers(&own->core) + n, sizeof *memory);
    if (!memory)
        return pma_check(PMA_NO_MEMORY, NULL);
    double *rate = memory + pma_specimen_numbers(&own->core);
    int code = 0;
    for (npy_intp i = 0; i < k && code == 0; i++) {
        memcpy(x + (size_t)i * n, u + (size_t)i * n, bytes);
        memcpy(rate, v + (size_t)i * n, bytes);
        code = pma_specimen_evaluate(&own->core, t[i], x + (size_t)i * n, rate, r + (size_t)i * n,
                                     memory);
    }
    PyMem_Free(memory);
    if (code != 0 && !PyErr_Occurred())
        PyErr_Format(PyExc_RuntimeError, "the specimen returned %d", code);
    return code != 0 ? -1 : 0;
}

static PyObject *follow_in(PyObject *args, PyObject *arrays)
{
    PyObject *obj, *t_obj, *u_obj, *v_obj;
    PyArrayObject *u;
    const npy_intp any[2] = {-1, -1};
    const double *t, *v;
    bool by_caller = false;
    if (!PyArg_ParseTuple(args, "O!OOO", &PyTuple_Type, &obj, &t_obj, &u_obj, &v_obj) ||
        pma_take_array(u_obj, NPY_DOUBLE, 2, any, "u", NULL, &u) < 0)
        return NULL;
    const npy_intp *shape = PyArray_DIMS(u);
    PyArrayObject *rates;
    if (pma_take_doubles(t_obj, shape[0], "t", NULL, &t) < 0 ||
        pma_take_array(v_obj, NPY_DOUBLE, 2, shape, "v", NULL, &rates) < 0)
        return NULL;
    v = PyArray_DATA(rates);
    specimen *own = take_specimen(obj, shape[1], arrays, &by_caller);
    if (!own)
        return NULL;
    PyObject *results[2] = {PyArray_ZEROS(2, shape, NPY_DOUBLE, 0),
                            PyArray_ZEROS(2, shape, NPY_DOUBLE, 0)};
    if (results[0] && results[1] &&
        run_commands(own, shape[0], t, PyArray_DATA(u), v,
                     PyArray_DATA((PyArrayObject *)results[0]),
                     PyArray_DATA((PyArrayObject *)results[1])) < 0)
        Py_CLEAR(results[1]);
    return pma_pack(2, results);
}

static PyObject *follow_specimen(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *arrays = PyList_New(0);
    PyObject *result = arrays ? follow_in(args, arrays) : NULL;
    Py_XDECREF(arrays);
    return result;
}

PyMethodDef pma_specimen_functions[] = {
    {"follow_specimen", follow_specimen, METH_VARARGS,
     "follow_specimen(specimen, t, u, v) -> (r, x): of one that is new, at commands u (k, n)"},
    {NULL, NULL, 0, NULL},
};
