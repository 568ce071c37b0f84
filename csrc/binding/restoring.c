/* Restoring forces: functions of the user and specimens, and their sum. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* Several functions as one: their sum, in this order. */
typedef struct {
    double *work; /* 3 n: scratch */
    Py_ssize_t count;
    pma_callback each[];
} series;

static int call_series(double t, intptr_t n, double *u, double *v, double *r, void *user)
{
    const series *all = user;
    const size_t bytes = (size_t)n * sizeof(double);
    double *own_u = all->work, *own_v = own_u + n, *term = own_v + n;
    for (Py_ssize_t i = 0; i < all->count; i++) {
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

static void free_series(PyObject *owner)
{
    PyMem_Free(PyCapsule_GetPointer(owner, NULL));
}

/* Room for `count` functions, owned by the list of arrays. */
static series *add_series(Py_ssize_t count, npy_intp n, PyObject *arrays)
{
    series *all = PyMem_Calloc(1, sizeof *all + (size_t)count * sizeof all->each[0]);
    if (all)
        all->count = count;
    if (pma_keep(all, free_series, arrays) < 0)
        return NULL;
    all->work = pma_add_scratch(3 * n, arrays);
    return all->work ? all : NULL;
}

/* A tuple of tuples is a specimen, one that begins with a capsule a LowLevelCallable. */
static int take_function(PyObject *function, npy_intp n, PyObject *arrays, pma_restoring *restoring,
                         pma_callback *out)
{
    if (PyTuple_Check(function) && PyTuple_Size(function) > 0 &&
        PyTuple_Check(PyTuple_GetItem(function, 0)))
        return pma_take_specimen(function, n, arrays, restoring, out);
    return pma_take_callback(function, out, &restoring->by_caller);
}

/* The cell in which the functions find what they remember. */
static int add_cell(PyObject *arrays, pma_restoring *out)
{
    out->cell = PyMem_Calloc(1, sizeof *out->cell);
    return pma_keep(out->cell, free_series, arrays);
}

static int take_functions(PyObject *functions, npy_intp n, PyObject *arrays, pma_restoring *out)
{
    const Py_ssize_t count = PyTuple_Size(functions);
    if (count == 0)
        return pma_refuse(PyExc_ValueError, "restoring: a function is missing");
    series *all = add_series(count, n, arrays);
    if (!all || add_cell(arrays, out) < 0)
        return -1;
    for (Py_ssize_t i = 0; i < count; i++) {
        if (take_function(PyTuple_GetItem(functions, i), n, arrays, out, &all->each[i]) < 0)
            return -1;
    }
    const pma_callback whole = count == 1 ? all->each[0] : (pma_callback){call_series, all};
    out->function = whole.function;
    out->user = whole.user;
    return 0;
}

int pma_take_restoring(PyObject *obj, npy_intp n, PyObject *arrays, pma_restoring *out)
{
    PyObject *functions, *order, *load;
    *out = (pma_restoring){.n = (size_t)n};
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError,
                          "restoring must be None or a tuple (functions, order, load)");
    if (!PyArg_ParseTuple(obj, "O!OO", &PyTuple_Type, &functions, &order, &load) ||
        pma_take_order(order, n, arrays, &out->order) < 0)
        return -1;
    if (load != Py_None && pma_take_doubles(load, n, "load", arrays, &out->load) < 0)
        return -1;
    out->work = pma_add_scratch(3 * n, arrays);
    if (!out->work || PyList_Append(arrays, functions) < 0)
        return -1;
    return take_functions(functions, n, arrays, out);
}
