/* The user's functions that the core evaluates in a step. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* r := f(t, u, v), and u := x where the callable returns (r, x), what was measured; -1 with an
 * exception set. The callable gets copies of u and v. */
static int evaluate(PyObject *callable, double t, npy_intp n, double *u, const double *v, double *r)
{
    const double *values, *measured = NULL;
    int failed = -1;
    PyObject *result = NULL, *own_u = pma_new_vector(n, u), *own_v = pma_new_vector(n, v);
    if (own_u && own_v)
        result = PyObject_CallFunction(callable, "dOO", t, own_u, own_v);
    const bool both = result && PyTuple_Check(result) && PyTuple_Size(result) == 2;
    PyObject *force = both ? PyTuple_GetItem(result, 0) : result;
    if (result && pma_take_doubles(force, n, "restoring", NULL, &values) == 0 &&
        (!both ||
         pma_take_doubles(PyTuple_GetItem(result, 1), n, "measured", NULL, &measured) == 0)) {
        memcpy(r, values, (size_t)n * sizeof(double));
        if (measured)
            memcpy(u, measured, (size_t)n * sizeof(double));
        failed = 0;
    }
    Py_XDECREF(result);
    Py_XDECREF(own_u);
    Py_XDECREF(own_v);
    return failed;
}

typedef struct {
    PyObject *callable;
    double t;
    npy_intp n;
    double *u;
    const double *v;
    double *r;
} evaluation;

static int run(void *ctx)
{
    const evaluation *e = ctx;
    if (PyErr_Occurred()) /* a poll has raised meanwhile */
        return -1;
    return evaluate(e->callable, e->t, e->n, e->u, e->v, e->r);
}

/* A Python callable as a pma_restoring_function, evaluated in the thread that called advance. An
 * exception stays set in that thread. */
static int call_callable(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    evaluation e = {user, t, (npy_intp)n, u, v, r};
    return pma_gil_call(run, &e);
}

/* Address and user data of a scipy.LowLevelCallable, a tuple that begins with a capsule; its
 * signature was checked in Python. NULL without an exception for any other object. */
void *pma_address_of(PyObject *obj, void **user)
{
    if (!PyTuple_Check(obj) || PyTuple_Size(obj) == 0 ||
        !PyCapsule_CheckExact(PyTuple_GetItem(obj, 0)))
        return NULL;
    PyObject *capsule = PyTuple_GetItem(obj, 0);
    *user = PyCapsule_GetContext(capsule);
    return PyCapsule_GetPointer(capsule, PyCapsule_GetName(capsule));
}

bool pma_is_compiled(PyObject *obj)
{
    void *user;
    return pma_address_of(obj, &user) != NULL;
}

int pma_take_order(PyObject *obj, npy_intp n, PyObject *arrays, const int64_t **out)
{
    size_t count;
    if (pma_take_vector(obj, NPY_INT64, &n, "order", arrays, out) < 0)
        return -1;
    return pma_take_positions(obj, (size_t)n, "order", NULL, &count, out);
}

int pma_find_load(PyObject *obj, pma_load *out)
{
    out->function = (pma_force_function)pma_address_of(obj, &out->user);
    return out->function ? 0 : pma_refuse(PyExc_TypeError, "load must be a compiled function");
}

int pma_find_restoring(PyObject *obj, pma_function *out)
{
    out->function = (pma_restoring_function)pma_address_of(obj, &out->user);
    if (out->function)
        return 0;
    if (!PyCallable_Check(obj))
        return pma_refuse(PyExc_TypeError, "restoring must be callable");
    *out = (pma_function){call_callable, obj, true};
    return 0;
}
