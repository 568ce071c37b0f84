/* Functions of the user's that the core asks in a step. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* r := f(u, v, t); -1 with an exception set. u and v are copies, which the callable may keep. */
static int ask_callable(PyObject *callable, double t, npy_intp n, const double *u, const double *v,
                        double *r)
{
    const double *values;
    int failed = -1;
    PyObject *result = NULL, *own_u = pma_new_vector(n, u), *own_v = pma_new_vector(n, v);
    if (own_u && own_v)
        result = PyObject_CallFunction(callable, "OOd", own_u, own_v, t);
    if (result && pma_take_doubles(result, n, "restoring", NULL, &values) == 0) {
        memcpy(r, values, (size_t)n * sizeof(double));
        failed = 0;
    }
    Py_XDECREF(result);
    Py_XDECREF(own_u);
    Py_XDECREF(own_v);
    return failed;
}

/* The core's view of a Python callable. The GIL is taken for the call only. Called by the thread
 * that called advance, in which an exception then stays set. */
static int call_callable(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const PyGILState_STATE gil = PyGILState_Ensure();
    const int failed = ask_callable(user, t, (npy_intp)n, u, v, r);
    PyGILState_Release(gil);
    return failed;
}

/* n doubles of scratch, kept with the arrays */
static double *add_scratch(npy_intp n, PyObject *arrays)
{
    PyObject *work = PyArray_ZEROS(1, &n, NPY_DOUBLE, 0);
    double *data = NULL;
    if (work && PyList_Append(arrays, work) == 0)
        data = PyArray_DATA((PyArrayObject *)work);
    Py_XDECREF(work);
    return data;
}

int pma_take_restoring(PyObject *obj, npy_intp n, PyObject *arrays, pma_restoring *out)
{
    PyObject *function, *order;
    PyArrayObject *places;
    *out = (pma_restoring){.n = (size_t)n};
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj)) {
        PyErr_SetString(PyExc_TypeError, "restoring must be None or a tuple (function, order)");
        return -1;
    }
    if (!PyArg_ParseTuple(obj, "OO", &function, &order) ||
        pma_take_array(order, NPY_INT64, 1, &n, "order", arrays, &places) < 0)
        return -1;
    if (!PyCallable_Check(function)) {
        PyErr_SetString(PyExc_TypeError, "restoring must be callable");
        return -1;
    }
    out->order = PyArray_DATA(places);
    out->work = add_scratch(3 * n, arrays);
    if (!out->work || PyList_Append(arrays, function) < 0)
        return -1;
    out->function = call_callable;
    out->user = function;
    out->by_caller = true;
    return 0;
}
