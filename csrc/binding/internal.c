/* Internal forces of a subdomain that are functions of the user. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- Python callables ----------------------------------------------------------------------- */

typedef struct {
    PyObject *callable, *potential; /* the latter is NULL where there is none */
    npy_intp history, entries;
} pma_callable;

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

/* (f, K, C, q1) := evaluate(t, u, v, q, wanted); -1 with an exception set */
static int evaluate(const evaluation *e)
{
    const npy_intp entries = e->of->entries, history = e->of->history;
    PyObject *u = pma_new_vector(e->n, e->u), *v = pma_new_vector(e->n, e->v);
    PyObject *q = pma_new_vector(history, e->q), *result = NULL;
    int failed = -1;
    if (u && v && q)
        result = PyObject_CallFunction(e->of->callable, "dOOOO", e->t, u, v, q,
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

int pma_find_internal(PyObject *obj, pma_store *store, pma_internal_force *out)
{
    out->function = (pma_internal_function)pma_address_of(obj, &out->user);
    if (out->function)
        return 0;
    if (!PyCallable_Check(obj))
        return pma_refuse(PyExc_TypeError, "internal must be callable");
    pma_callable *callable = pma_store_add(store, 1, sizeof *callable);
    if (!callable)
        return pma_check(PMA_NO_MEMORY, NULL);
    *callable = (pma_callable){
        .callable = obj, .history = (npy_intp)out->history, .entries = (npy_intp)out->entries};
    out->function = call_callable;
    out->user = callable;
    out->by_caller = true;
    return 0;
}

int pma_find_potential(PyObject *obj, pma_internal_force *out)
{
    if (!out->by_caller)
        return 0; /* of a compiled function there is none */
    pma_callable *callable = out->user;
    callable->potential = obj;
    out->potential = call_potential;
    return 0;
}
