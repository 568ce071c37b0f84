/* Local errors of recorded steps, as functions of the module, for several cases at once. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "member/estimate.h"

/* What all cases have in common. */
typedef struct {
    npy_intp cases, levels; /* levels: -1 until the first case is known */
    pma_motion_rows motion; /* of the case at hand */
    pma_recorded_steps steps;
    PyObject *arrays; /* list: what the case at hand points into */
} estimate;

/* An array of a case, levels x columns, converted only if it is one of a file of another program. */
static int take_rows(PyObject *obj, estimate *e, const double **out)
{
    PyObject *array = PyArray_FROMANY(obj, NPY_DOUBLE, 2, 2, NPY_ARRAY_CARRAY_RO);
    if (!array || PyList_Append(e->arrays, array) < 0) {
        Py_XDECREF(array);
        return -1;
    }
    Py_DECREF(array);
    const npy_intp *shape = PyArray_DIMS((PyArrayObject *)array);
    if (e->levels < 0) {
        e->levels = shape[0];
        e->motion.columns = (size_t)shape[1];
    }
    if (shape[0] != e->levels || (size_t)shape[1] != e->motion.columns) {
        PyErr_SetString(PyExc_ValueError, "motions must be of one shape");
        return -1;
    }
    *out = PyArray_DATA((PyArrayObject *)array);
    return 0;
}

static int take_motion(PyObject *motions, npy_intp k, estimate *e)
{
    PyObject *u, *v, *w, *motion = PyTuple_GetItem(motions, k);
    Py_XDECREF(e->arrays);
    e->arrays = PyList_New(0);
    if (!e->arrays)
        return -1;
    if (!PyTuple_Check(motion)) {
        PyErr_SetString(PyExc_TypeError, "motions must be tuples");
        return -1;
    }
    if (!PyArg_ParseTuple(motion, "OOO", &u, &v, &w) || take_rows(u, e, &e->motion.u) < 0 ||
        take_rows(v, e, &e->motion.v) < 0 || take_rows(w, e, &e->motion.w) < 0)
        return -1;
    return 0;
}

/* Some of the levels, `count` of them unless that is negative. */
static int take_levels(PyObject *obj, const char *name, const estimate *e, npy_intp count,
                       npy_intp *length, const int64_t **out)
{
    PyArrayObject *array;
    if (pma_take_array(obj, NPY_INT64, 1, &count, name, NULL, &array) < 0)
        return -1;
    *length = PyArray_DIM(array, 0);
    *out = PyArray_DATA(array);
    for (npy_intp i = 0; i < *length; i++) {
        if ((*out)[i] < 0 || (*out)[i] >= e->levels) {
            PyErr_Format(PyExc_ValueError, "%s must be levels in 0..%zd", name,
                         (Py_ssize_t)e->levels - 1);
            return -1;
        }
    }
    return 0;
}

/* The first case and its steps. */
static int take_steps(PyObject *motions, PyObject *begin, PyObject *end, estimate *e)
{
    npy_intp count;
    e->cases = (npy_intp)PyTuple_Size(motions);
    e->levels = -1;
    if (e->cases == 0) {
        PyErr_SetString(PyExc_ValueError, "motions must not be empty");
        return -1;
    }
    if (take_motion(motions, 0, e) < 0 ||
        take_levels(begin, "begin", e, -1, &count, &e->steps.begin) < 0 ||
        take_levels(end, "end", e, count, &count, &e->steps.end) < 0)
        return -1;
    e->steps.count = (size_t)count;
    return 0;
}

/* ---- errors ----------------------------------------------------------------------------------- */

static PyObject *errors_of(PyObject *motions, PyObject *begin, PyObject *end, estimate *e)
{
    if (take_steps(motions, begin, end, e) < 0)
        return NULL;
    const npy_intp count = (npy_intp)e->steps.count;
    const npy_intp shape[3] = {(npy_intp)e->motion.columns, e->cases, count};
    PyObject *errors = PyArray_SimpleNew(3, shape, NPY_DOUBLE);
    for (npy_intp k = 0; errors && k < e->cases; k++) {
        double *own = (double *)PyArray_DATA((PyArrayObject *)errors) + k * count;
        if (take_motion(motions, k, e) < 0)
            Py_CLEAR(errors);
        else
            pma_estimate_errors(&e->motion, &e->steps, (size_t)(e->cases * count), own);
    }
    return errors;
}

static PyObject *step_errors(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *motions, *begin, *end;
    estimate e = {.motion = {.stride = 1}};
    if (!PyArg_ParseTuple(args, "O!OOd", &PyTuple_Type, &motions, &begin, &end, &e.steps.h))
        return NULL;
    PyObject *errors = errors_of(motions, begin, end, &e);
    Py_XDECREF(e.arrays);
    return errors;
}

/* ---- norms ------------------------------------------------------------------------------------ */

enum { NORMS = 4 };

static void write_norms(const estimate *e, const double *mass, npy_intp count,
                        const int64_t *levels, double *mean, double *out)
{
    const pma_norms norms = pma_estimate_norms(&e->motion, &e->steps, mass, mean);
    out[0] = norms.rate;
    out[1] = norms.motion;
    out[2] = norms.speed;
    out[3] = norms.acceleration;
    pma_estimate_distance(&e->motion, (size_t)count, levels, mass, mean, out + NORMS);
}

static PyObject *norms_of(PyObject *motions, const double *mass, npy_intp count,
                          const int64_t *levels, double *mean, estimate *e)
{
    const npy_intp shape[2] = {e->cases, NORMS + count};
    PyObject *norms = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    for (npy_intp k = 0; norms && k < e->cases; k++) {
        if (take_motion(motions, k, e) < 0)
            Py_CLEAR(norms);
        else
            write_norms(e, mass, count, levels, mean,
                        (double *)PyArray_DATA((PyArrayObject *)norms) + k * shape[1]);
    }
    return norms;
}

static PyObject *take_norms(PyObject *motions, PyObject *mass_obj, PyObject *levels_obj,
                            estimate *e)
{
    const npy_intp read = (npy_intp)pma_motion_read(&e->motion);
    const int64_t *levels;
    const double *mass;
    npy_intp count;
    if (pma_take_doubles(mass_obj, read, "mass", NULL, &mass) < 0 ||
        take_levels(levels_obj, "levels", e, -1, &count, &levels) < 0)
        return NULL;
    double *mean = PyMem_Malloc(((size_t)read + 1) * sizeof *mean);
    if (!mean)
        return PyErr_NoMemory();
    PyObject *norms = norms_of(motions, mass, count, levels, mean, e);
    PyMem_Free(mean);
    return norms;
}

static PyObject *step_norms(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *motions, *begin, *end, *mass, *levels, *norms = NULL;
    Py_ssize_t stride;
    estimate e = {.levels = -1};
    if (!PyArg_ParseTuple(args, "O!OOdnOO", &PyTuple_Type, &motions, &begin, &end, &e.steps.h,
                          &stride, &mass, &levels))
        return NULL;
    if (stride < 1)
        return PyErr_Format(PyExc_ValueError, "stride must be positive, got %zd", stride);
    e.motion.stride = (size_t)stride;
    if (take_steps(motions, begin, end, &e) == 0)
        norms = take_norms(motions, mass, levels, &e);
    Py_XDECREF(e.arrays);
    return norms;
}

PyMethodDef pma_estimate_functions[] = {
    {"step_errors", step_errors, METH_VARARGS,
     "step_errors(((u, v, a), ...), begin, end, h) -> (dofs, cases, steps): the estimates (D1)"},
    {"step_norms", step_norms, METH_VARARGS,
     "step_norms(((u, v, a), ...), begin, end, h, stride, mass, levels) -> (cases, 4 + levels): "
     "mean error per unit of time, size of the motion, speed, acceleration; and the distance from "
     "the mean at some levels"},
    {NULL, NULL, 0, NULL},
};
