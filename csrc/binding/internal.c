/* Internal forces of a subdomain, and what their iteration needs. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- Python callables ----------------------------------------------------------------------- */

typedef struct {
    const pma_callable *of;
    double t;
    npy_intp n;
    const double *u, *v, *q;
    double *f, *K, *C, *q1;
} evaluation;

/* An item of the result, (size,), copied; None leaves what is there. */
static int take_values(PyObject *result, Py_ssize_t item, npy_intp size, double *out)
{
    const double *values;
    PyObject *obj = PyTuple_GetItem(result, item);
    if (!out || obj == Py_None)
        return 0;
    if (pma_take_doubles(obj, size, "internal", NULL, &values) < 0)
        return -1;
    memcpy(out, values, (size_t)size * sizeof(double));
    return 0;
}

/* (f, K, C, q1) := evaluate(u, v, t, q, wanted); -1 with an exception set */
static int evaluate(const evaluation *e)
{
    const npy_intp entries = e->of->entries, history = e->of->history;
    PyObject *u = pma_new_vector(e->n, e->u), *v = pma_new_vector(e->n, e->v);
    PyObject *q = pma_new_vector(history, e->q), *result = NULL;
    int failed = -1;
    if (u && v && q)
        result = PyObject_CallFunction(e->of->callable, "OOdOO", u, v, e->t, q,
                                       e->K ? Py_True : Py_False);
    if (result && (!PyTuple_Check(result) || PyTuple_Size(result) != 4))
        PyErr_SetString(PyExc_TypeError, "internal must return a tuple (f, K, C, q1)");
    else if (result && take_values(result, 0, e->n, e->f) == 0 &&
             take_values(result, 1, entries, e->K) == 0 &&
             take_values(result, 2, entries, e->C) == 0 &&
             take_values(result, 3, history, e->q1) == 0)
        failed = 0;
    Py_XDECREF(result);
    Py_XDECREF(u);
    Py_XDECREF(v);
    Py_XDECREF(q);
    return failed;
}

static int run(void *ctx)
{
    return PyErr_Occurred() ? -1 : evaluate(ctx); /* a poll may have raised meanwhile */
}

/* A Python callable as a pma_internal_function, in the thread that called advance. An exception
 * stays set in that thread. */
static int call_callable(double t, intptr_t n, double *u, double *v, double *q, double *f,
                         double *K, double *C, double *q1, void *user)
{
    evaluation e = {user, t, (npy_intp)n, u, v, q, f, K, C, q1};
    return pma_gil_call(run, &e);
}

typedef struct {
    const pma_callable *of;
    npy_intp n;
    const double *u;
    double *energy;
} potential_evaluation;

static int run_potential(void *ctx)
{
    const potential_evaluation *e = ctx;
    if (PyErr_Occurred())
        return -1;
    PyObject *u = pma_new_vector(e->n, e->u);
    PyObject *result = u ? PyObject_CallFunctionObjArgs(e->of->potential, u, NULL) : NULL;
    *e->energy = result ? PyFloat_AsDouble(result) : 0.0;
    Py_XDECREF(u);
    Py_XDECREF(result);
    return PyErr_Occurred() ? -1 : 0;
}

/* The method of a Python callable as a pma_internal_potential_function. */
static int call_potential(intptr_t n, double *u, double *energy, void *user)
{
    potential_evaluation e = {user, (npy_intp)n, u, energy};
    return pma_gil_call(run_potential, &e);
}

/* ---- forces --------------------------------------------------------------------------------- */

/* (function, history, where, across, potential): where is None for a force whose tangents are never
 * evaluated, across for one whose tangents are not compared with their transpose, potential is a
 * callable of Python or None */
static int take_force(PyObject *obj, PyObject *arrays, pma_callable *callable,
                      pma_internal_force *out)
{
    PyObject *function, *where, *across, *potential;
    Py_ssize_t history;
    npy_intp entries = -1;
    if (!PyArg_ParseTuple(obj, "OnOOO", &function, &history, &where, &across, &potential))
        return -1;
    if (history < 0)
        return pma_refuse(PyExc_ValueError, "history must not be negative");
    out->history = (size_t)history;
    if (where != Py_None) {
        if (pma_take_vector(where, NPY_INT64, &entries, "where", arrays, &out->where) < 0)
            return -1;
        out->entries = (size_t)entries;
    }
    if (where != Py_None && across != Py_None &&
        pma_take_vector(across, NPY_INT64, &entries, "across", arrays, &out->across) < 0)
        return -1;
    if (PyList_Append(arrays, function) < 0)
        return -1;
    out->function = (pma_internal_function)pma_address_of(function, &out->user);
    if (out->function)
        return 0;
    if (!PyCallable_Check(function))
        return pma_refuse(PyExc_TypeError, "internal must be callable");
    if (potential != Py_None && PyList_Append(arrays, potential) < 0)
        return -1;
    *callable = (pma_callable){function, potential, history, (npy_intp)out->entries};
    out->potential = potential != Py_None ? call_potential : NULL;
    out->function = call_callable;
    out->user = callable;
    out->by_caller = true;
    return 0;
}

int pma_take_internal(PyObject *obj, npy_intp n, PyObject *arrays, pma_forces *forces,
                      pma_internal *out)
{
    PyObject *order, *initial, *list;
    npy_intp history = -1;
    *out = (pma_internal){.n = (size_t)n};
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "internal must be a tuple (order, initial, forces)");
    if (!PyArg_ParseTuple(obj, "OOO!", &order, &initial, &PyTuple_Type, &list) ||
        pma_take_order(order, n, arrays, &out->order) < 0 ||
        pma_take_vector(initial, NPY_DOUBLE, &history, "initial", arrays, &out->initial) < 0)
        return -1;
    out->history = (size_t)history;
    const size_t count = (size_t)PyTuple_Size(list);
    forces->forces = PyMem_Calloc(count + 1, sizeof *forces->forces);
    forces->callables = PyMem_Calloc(count + 1, sizeof *forces->callables);
    if (!forces->forces || !forces->callables)
        return pma_check(PMA_NO_MEMORY, NULL);
    for (size_t k = 0; k < count; k++) {
        if (take_force(PyTuple_GetItem(list, (Py_ssize_t)k), arrays, &forces->callables[k],
                       &forces->forces[k]) < 0)
            return -1;
    }
    out->forces = forces->forces;
    out->count = count;
    return 0;
}

void pma_release_forces(pma_forces *forces)
{
    PyMem_Free(forces->forces);
    PyMem_Free(forces->callables);
}

/* ---- factors that are made again ------------------------------------------------------------ */

/* (ptr, index, structure, dgemm, dtrsm, unsymmetric): structure is None where the pattern is a
 * diagonal */
int pma_take_numeric(PyObject *obj, npy_intp n, npy_intp nb, PyObject *arrays,
                     pma_numeric_parts *out)
{
    PyObject *ptr, *index, *structure, *dgemm, *dtrsm;
    int unsymmetric;
    npy_intp size = n + 1;
    *out = (pma_numeric_parts){.n = (size_t)n, .nb = (size_t)nb};
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "pattern must be a tuple of six");
    if (!PyArg_ParseTuple(obj, "OOOOOp", &ptr, &index, &structure, &dgemm, &dtrsm, &unsymmetric) ||
        pma_take_vector(ptr, NPY_INT64, &size, "ptr", arrays, &out->ptr) < 0)
        return -1;
    out->unsymmetric = unsymmetric;
    npy_intp entries = (npy_intp)out->ptr[n];
    if (pma_take_vector(index, NPY_INT32, &entries, "index", arrays, &out->index) < 0)
        return -1;
    if (structure == Py_None)
        return 0;
    if (pma_take_blas(dgemm, dtrsm, &out->blas) < 0)
        return -1;
    if (!PyTuple_Check(structure) || PyTuple_Size(structure) != 5)
        return pma_refuse(PyExc_TypeError, "structure must be a tuple of five arrays");
    if (pma_take_structure(structure, "structure", arrays, &out->panels) < 0)
        return -1;
    return pma_take_vector(PyTuple_GetItem(structure, 4), NPY_INT64, &n, "owner", arrays,
                           &out->owner);
}

int pma_take_iterate(PyObject *obj, const pma_parts *parts, PyObject *arrays, pma_team **team,
                     pma_iterate_parts *out)
{
    PyObject *pattern, *base, *twice, *M_size;
    int springs, keeps;
    Py_ssize_t threads;
    const npy_intp n = (npy_intp)parts->n;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "iterate must be a tuple of seven");
    if (!PyArg_ParseTuple(obj, "ppOOOOn", &springs, &keeps, &pattern, &base, &twice, &M_size,
                          &threads))
        return -1;
    *out = (pma_iterate_parts){.springs = springs, .keeps = keeps};
    if (pma_take_numeric(pattern, n, (npy_intp)parts->nb, arrays, &out->tangent) < 0 ||
        pma_take_crew(threads, team, &out->tangent.crew) < 0)
        return -1;
    const npy_intp entries = (npy_intp)out->tangent.ptr[n];
    if (pma_take_doubles(base, entries, "base", arrays, &out->base) < 0 ||
        pma_take_matrix(M_size, n, "M_size", arrays, &out->M_size) < 0)
        return -1;
    if (!parts->doubled)
        return 0;
    return pma_take_doubles(twice, entries, "base_twice", arrays, &out->base_twice);
}

/* (tolerance, iterations, reuse, pattern, start, later) for pm and gc,
 * (tolerance, iterations, reuse, response_start, response, H_size) for macro coupling */
int pma_take_iteration(PyObject *obj, npy_intp p, bool macro, PyObject *arrays,
                       pma_iteration_parts *out)
{
    PyObject *first, *second, *third;
    Py_ssize_t iterations;
    int reuse;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "iteration must be a tuple of six");
    *out = (pma_iteration_parts){.newton = {.tolerance = 0.0}};
    if (!PyArg_ParseTuple(obj, "dnpOOO", &out->newton.tolerance, &iterations, &reuse, &first,
                          &second, &third))
        return -1;
    if (iterations < 1 || !(out->newton.tolerance > 0.0))
        return pma_refuse(PyExc_ValueError, "need tolerance > 0 and iterations >= 1");
    out->newton.iterations = (size_t)iterations;
    out->newton.reuse = reuse;
    if (macro)
        return pma_take_matrix(first, p, "response_start", arrays, &out->response_start) < 0 ||
                       pma_take_matrix(second, p, "response", arrays, &out->response) < 0
                   ? -1
                   : pma_take_matrix(third, p, "H_size", arrays, &out->H_size);
    if (pma_take_numeric(first, p, p, arrays, &out->H) < 0)
        return -1;
    const npy_intp entries = (npy_intp)out->H.ptr[p];
    return pma_take_doubles(second, entries, "start", arrays, &out->start) < 0
               ? -1
               : pma_take_doubles(third, entries, "later", arrays, &out->later);
}

/* ---- what iterations keep ------------------------------------------------------------------- */

PyObject *pma_subdomain_iteration(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    pma_iterate *it = pma_subdomain_iterate(self->core);
    bool twice;
    if (!it)
        Py_RETURN_NONE;
    if (!pma_subdomain_claim(self))
        return NULL;
    const double *kept = pma_iterate_kept(it, &twice);
    const double scale = pma_iterate_scale(it);
    PyObject *entries =
        kept ? pma_new_vector((npy_intp)pma_iterate_entries(it), kept) : Py_NewRef(Py_None);
    pma_subdomain_release(self);
    return entries ? Py_BuildValue("(dNO)", scale, entries, twice ? Py_True : Py_False) : NULL;
}

PyObject *pma_subdomain_set_iteration(SubdomainObject *self, PyObject *args)
{
    PyObject *entries;
    const double *kept = NULL;
    double scale;
    int twice;
    pma_iterate *it = pma_subdomain_iterate(self->core);
    if (!PyArg_ParseTuple(args, "dOp", &scale, &entries, &twice))
        return NULL;
    if (!it)
        return PyErr_Format(PyExc_ValueError, "the subdomain is not iterated");
    if (entries != Py_None &&
        pma_take_doubles(entries, (npy_intp)pma_iterate_entries(it), "entries", NULL, &kept) < 0)
        return NULL;
    if (!pma_subdomain_claim(self))
        return NULL;
    pma_caller before = pma_gil_release(); /* factors as in a step */
    const pma_status status = pma_iterate_restore(it, scale, kept, twice);
    pma_gil_acquire(before);
    pma_subdomain_release(self);
    return status == PMA_OK ? Py_NewRef(Py_None) : pma_raise(status, "entries");
}
