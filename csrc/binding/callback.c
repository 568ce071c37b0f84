/* The user's functions that the core evaluates in a step. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* r := f(u, v, t), and u := x where the callable returns (r, x), what was measured; -1 with an
 * exception set. The callable gets copies of u and v. */
static int evaluate(PyObject *callable, double t, npy_intp n, double *u, const double *v, double *r)
{
    const double *values, *measured = NULL;
    int failed = -1;
    PyObject *result = NULL, *own_u = pma_new_vector(n, u), *own_v = pma_new_vector(n, v);
    if (own_u && own_v)
        result = PyObject_CallFunction(callable, "OOd", own_u, own_v, t);
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

/* n doubles of scratch, owned by the list of arrays */
double *pma_add_scratch(npy_intp n, PyObject *arrays)
{
    PyObject *work = PyArray_ZEROS(1, &n, NPY_DOUBLE, 0);
    double *data = NULL;
    if (work && PyList_Append(arrays, work) == 0)
        data = PyArray_DATA((PyArrayObject *)work);
    Py_XDECREF(work);
    return data;
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

/* the user's dof at each position of the elimination order */
int pma_take_order(PyObject *obj, npy_intp n, PyObject *arrays, const int64_t **out)
{
    PyArrayObject *order;
    if (pma_take_array(obj, NPY_INT64, 1, &n, "order", arrays, &order) < 0)
        return -1;
    *out = PyArray_DATA(order);
    for (npy_intp i = 0; i < n; i++) {
        if ((*out)[i] < 0 || (*out)[i] >= n) {
            PyErr_SetString(PyExc_ValueError, "order: a dof is out of range");
            return -1;
        }
    }
    return 0;
}

int pma_take_force(PyObject *obj, PyObject *arrays, pma_load *load)
{
    const npy_intp n = (npy_intp)load->n;
    PyObject *function, *order;
    if (!PyArg_ParseTuple(obj, "OO", &function, &order) ||
        pma_take_order(order, n, arrays, &load->order) < 0)
        return -1;
    load->kind = PMA_LOAD_CALLED;
    load->work = pma_add_scratch(n, arrays);
    load->function = (pma_force_function)pma_address_of(function, &load->user);
    return load->work && load->function ? PyList_Append(arrays, function) : -1;
}

/* ---- restoring forces ----------------------------------------------------------------------- */

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

/* A function of the user; *by_caller is set for a Python callable. */
int pma_take_callback(PyObject *function, pma_callback *out, bool *by_caller)
{
    out->function = (pma_restoring_function)pma_address_of(function, &out->user);
    if (out->function)
        return 0;
    if (!PyCallable_Check(function)) {
        PyErr_SetString(PyExc_TypeError, "restoring must be callable");
        return -1;
    }
    *out = (pma_callback){call_callable, function};
    *by_caller = true;
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
    PyObject *owner = all ? PyCapsule_New(all, NULL, free_series) : PyErr_NoMemory();
    if (!owner) {
        PyMem_Free(all);
        return NULL;
    }
    all->count = count;
    const int failed = PyList_Append(arrays, owner);
    Py_DECREF(owner);
    if (failed)
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
static int add_place(PyObject *arrays, pma_restoring *out)
{
    out->place = PyMem_Calloc(1, sizeof *out->place);
    PyObject *owner = out->place ? PyCapsule_New(out->place, NULL, free_series) : PyErr_NoMemory();
    if (!owner) {
        PyMem_Free(out->place);
        return -1;
    }
    const int failed = PyList_Append(arrays, owner);
    Py_DECREF(owner);
    return failed;
}

static int take_functions(PyObject *functions, npy_intp n, PyObject *arrays, pma_restoring *out)
{
    const Py_ssize_t count = PyTuple_Size(functions);
    if (count == 0) {
        PyErr_SetString(PyExc_ValueError, "restoring: a function is missing");
        return -1;
    }
    series *all = add_series(count, n, arrays);
    if (!all || add_place(arrays, out) < 0)
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
    if (!PyTuple_Check(obj)) {
        PyErr_SetString(PyExc_TypeError,
                        "restoring must be None or a tuple (functions, order, load)");
        return -1;
    }
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
