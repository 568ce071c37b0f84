/* Local errors of recorded steps, and the motion of a small system, as functions of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "member/scheme.h"

/* ---- errors ---------------------------------------------------------------------------------- */

/* An array, levels x columns, converted only if it is one of a file of another program. */
static int take_rows(PyObject *obj, PyObject *arrays, npy_intp *levels, pma_motion_rows *motion,
                     const double **out)
{
    PyObject *array = PyArray_FROMANY(obj, NPY_DOUBLE, 2, 2, NPY_ARRAY_CARRAY_RO);
    if (!array || PyList_Append(arrays, array) < 0) {
        Py_XDECREF(array);
        return -1;
    }
    Py_DECREF(array);
    const npy_intp *shape = PyArray_DIMS((PyArrayObject *)array);
    if (*levels < 0) {
        *levels = shape[0];
        motion->columns = (size_t)shape[1];
    }
    if (shape[0] != *levels || (size_t)shape[1] != motion->columns)
        return pma_refuse(PyExc_ValueError, "motions must be of one shape");
    *out = PyArray_DATA((PyArrayObject *)array);
    return 0;
}

static PyObject *errors_of(PyObject *motion, PyObject *begin, PyObject *end, double h,
                           PyObject *arrays)
{
    PyObject *u, *v, *w;
    pma_motion_rows x;
    pma_recorded_steps steps = {.h = h};
    npy_intp levels = -1;
    size_t ends;
    if (!PyArg_ParseTuple(motion, "OOO", &u, &v, &w) ||
        take_rows(u, arrays, &levels, &x, &x.u) < 0 ||
        take_rows(v, arrays, &levels, &x, &x.v) < 0 ||
        take_rows(w, arrays, &levels, &x, &x.w) < 0 ||
        pma_take_positions(begin, (size_t)levels, "begin", NULL, &steps.count, &steps.begin) < 0 ||
        pma_take_positions(end, (size_t)levels, "end", NULL, &ends, &steps.end) < 0)
        return NULL;
    if (ends != steps.count)
        return PyErr_Format(PyExc_ValueError, "begin and end must have one length");
    const npy_intp shape[2] = {(npy_intp)x.columns, (npy_intp)steps.count};
    PyObject *errors = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    if (errors)
        pma_estimate_errors(&x, &steps, PyArray_DATA((PyArrayObject *)errors));
    return errors;
}

static PyObject *step_errors(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *motion, *begin, *end;
    double h;
    if (!PyArg_ParseTuple(args, "O!OOd", &PyTuple_Type, &motion, &begin, &end, &h))
        return NULL;
    PyObject *arrays = PyList_New(0);
    PyObject *errors = arrays ? errors_of(motion, begin, end, h, arrays) : NULL;
    Py_XDECREF(arrays);
    return errors;
}

/* ---- a small system -------------------------------------------------------------------------- */

static PyObject *follow_recursion(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *P_obj, *x_obj;
    PyArrayObject *P, *given;
    const npy_intp any[2] = {-1, -1};
    if (!PyArg_ParseTuple(args, "OO", &P_obj, &x_obj) ||
        pma_take_array(x_obj, NPY_DOUBLE, 2, any, "x", NULL, &given) < 0)
        return NULL;
    const npy_intp n = PyArray_DIM(given, 1), square[2] = {n, n};
    if (pma_take_array(P_obj, NPY_DOUBLE, 2, square, "P", NULL, &P) < 0)
        return NULL;
    PyObject *x = PyArray_NewCopy(given, NPY_CORDER);
    if (x)
        pma_estimate_follow((size_t)n, (size_t)PyArray_DIM(given, 0), PyArray_DATA(P),
                            PyArray_DATA((PyArrayObject *)x));
    return x;
}

PyMethodDef pma_estimate_functions[] = {
    {"step_errors", step_errors, METH_VARARGS,
     "step_errors((u, v, a), begin, end, h) -> (dofs, steps): the estimates (D1)"},
    {"follow_recursion", follow_recursion, METH_VARARGS,
     "follow_recursion(P, x) -> y: y_0 = x_0, y_k = x_k + P y_{k-1}, by rows"},
    {NULL, NULL, 0, NULL},
};
