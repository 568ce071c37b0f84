/* Internal forces of a subdomain, and what their iteration needs. */
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
