/* Local errors of recorded steps, as a function of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "subdomain/scheme.h"

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

PyMethodDef pma_estimate_functions[] = {
    {"step_errors", step_errors, METH_VARARGS,
     "step_errors((u, v, a), begin, end, h) -> (dofs, steps): the estimates (D1)"},
    {NULL, NULL, 0, NULL},
};
