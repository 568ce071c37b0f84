/* Arguments of Python in the forms of the core, and results back. */
#define NO_IMPORT_ARRAY
#include "binding.h"

PyObject *pma_raise(pma_status status, const char *what)
{
    if (PyErr_Occurred())
        return NULL;
    if (status == PMA_NO_MEMORY)
        return PyErr_NoMemory();
    const bool bad_value =
        status == PMA_BAD_SIZE || status == PMA_BAD_INDEX || status == PMA_BAD_STEP;
    PyObject *type = bad_value ? PyExc_ValueError : PyExc_RuntimeError;
    return PyErr_Format(type, "%s: %s", what, pma_status_text(status));
}

static int shape_error(PyArrayObject *array, int ndim, const npy_intp *shape, const char *name)
{
    if (PyArray_NDIM(array) != ndim)
        return pma_refuse(PyExc_ValueError, "%s must have %d dimensions, got %d", name, ndim,
                          PyArray_NDIM(array));
    for (int i = 0; i < ndim; i++) {
        if (shape[i] >= 0 && PyArray_DIM(array, i) != shape[i])
            return pma_refuse(PyExc_ValueError, "%s must have extent %zd along axis %d, got %zd",
                              name, (Py_ssize_t)shape[i], i, (Py_ssize_t)PyArray_DIM(array, i));
    }
    return 0;
}

int pma_take_array(PyObject *obj, int type, int ndim, const npy_intp *shape, const char *name,
                   PyObject *arrays, PyArrayObject **out)
{
    if (!PyArray_Check(obj))
        return pma_refuse(PyExc_TypeError, "%s must be an array, got %R", name, Py_TYPE(obj));
    PyArrayObject *array = (PyArrayObject *)obj;
    /* 32 bits are int or long on Windows, 64 bits long or long long on Linux */
    if (!PyArray_EquivTypenums(PyArray_TYPE(array), type) || !PyArray_IS_C_CONTIGUOUS(array) ||
        !PyArray_ISBEHAVED_RO(array))
        return pma_refuse(PyExc_TypeError, "%s must be C-contiguous, aligned and of type %d", name,
                          type);
    if (shape_error(array, ndim, shape, name) < 0)
        return -1;
    if (arrays && PyList_Append(arrays, obj) < 0)
        return -1;
    *out = array;
    return 0;
}

int pma_take_vector(PyObject *obj, int type, npy_intp *length, const char *name, PyObject *arrays,
                    void *out)
{
    PyArrayObject *array;
    if (pma_take_array(obj, type, 1, length, name, arrays, &array) < 0)
        return -1;
    *length = PyArray_DIM(array, 0);
    void *data = PyArray_DATA(array);
    memcpy(out, &data, sizeof data);
    return 0;
}

int pma_take_doubles(PyObject *obj, npy_intp count, const char *name, PyObject *arrays,
                     const double **out)
{
    return pma_take_vector(obj, NPY_DOUBLE, &count, name, arrays, out);
}

int pma_take_output(PyObject *obj, int ndim, const npy_intp *shape, const char *name,
                    PyArrayObject **out)
{
    if (pma_take_array(obj, NPY_DOUBLE, ndim, shape, name, NULL, out) < 0)
        return -1;
    if (!PyArray_ISWRITEABLE(*out))
        return pma_refuse(PyExc_ValueError, "%s must be writeable", name);
    return 0;
}

int pma_take_positions(PyObject *obj, size_t size, const char *name, PyObject *arrays,
                       size_t *count, const int64_t **out)
{
    npy_intp length = -1;
    if (pma_take_vector(obj, NPY_INT64, &length, name, arrays, out) < 0)
        return -1;
    *count = (size_t)length;
    for (size_t i = 0; i < *count; i++) {
        if ((*out)[i] < 0 || (size_t)(*out)[i] >= size)
            return pma_refuse(PyExc_ValueError, "%s: a position is out of range", name);
    }
    return 0;
}

PyObject *pma_new_array(npy_intp length, int type, void *data)
{
    PyObject *array = PyArray_ZEROS(1, &length, type, 0);
    void *own = array ? PyArray_DATA((PyArrayObject *)array) : NULL;
    memcpy(data, &own, sizeof own);
    return array;
}

PyObject *pma_pack(Py_ssize_t count, PyObject *const *items)
{
    PyObject *tuple = PyTuple_New(count);
    for (Py_ssize_t i = 0; i < count; i++) {
        if (!items[i])
            Py_CLEAR(tuple);
        if (tuple)
            PyTuple_SetItem(tuple, i, items[i]);
        else
            Py_XDECREF(items[i]);
    }
    return tuple;
}

PyObject *pma_new_vector(npy_intp n, const double *x)
{
    PyObject *out = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (out && n > 0)
        memcpy(PyArray_DATA((PyArrayObject *)out), x, (size_t)n * sizeof(double));
    return out;
}
