/* Loads: constant, sampled, in a table, or a function of the user. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* (values, shape, dt, hold, begin) */
static int take_sampled(PyObject *obj, PyObject *arrays, pma_load *load)
{
    PyObject *values, *shape;
    PyArrayObject *array;
    const npy_intp any[2] = {-1, -1};
    int hold;
    if (!PyArg_ParseTuple(obj, "OOdpd", &values, &shape, &load->dt, &hold, &load->begin) ||
        pma_take_array(values, NPY_DOUBLE, 2, any, "values", arrays, &array) < 0)
        return -1;
    load->kind = PMA_LOAD_SAMPLED;
    load->hold = hold;
    load->values = PyArray_DATA(array);
    load->samples = (size_t)PyArray_DIM(array, 0);
    load->k = (size_t)PyArray_DIM(array, 1);
    if (load->samples == 0 || !(load->dt > 0.0))
        return pma_refuse(PyExc_ValueError, "a sampled load needs samples and a positive dt");
    if (shape == Py_None) {
        if (load->k == load->n)
            return 0;
        return pma_refuse(PyExc_ValueError, "values must have n columns when there is no shape");
    }
    const npy_intp extents[2] = {(npy_intp)load->k, (npy_intp)load->n};
    if (pma_take_array(shape, NPY_DOUBLE, 2, extents, "shape", arrays, &array) < 0)
        return -1;
    load->shape = PyArray_DATA(array);
    return 0;
}

/* (rows, first) */
static int take_table(PyObject *obj, PyObject *arrays, pma_load *load)
{
    PyObject *rows;
    PyArrayObject *array;
    long long first;
    const npy_intp extents[2] = {-1, (npy_intp)load->n};
    if (!PyArg_ParseTuple(obj, "OL", &rows, &first) ||
        pma_take_array(rows, NPY_DOUBLE, 2, extents, "rows", arrays, &array) < 0)
        return -1;
    load->kind = PMA_LOAD_TABLE;
    load->values = PyArray_DATA(array);
    load->rows = (size_t)PyArray_DIM(array, 0);
    load->first = first;
    return 0;
}

/* (function, order) */
static int take_force(PyObject *obj, PyObject *arrays, pma_load *load)
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

static int take_sum(PyObject *obj, PyObject *arrays, pma_load *load);

static int take_any_load(PyObject *obj, PyObject *arrays, pma_load *load)
{
    if (obj == Py_None)
        return 0;
    if (PyList_Check(obj))
        return take_sum(obj, arrays, load);
    if (!PyTuple_Check(obj)) {
        load->kind = PMA_LOAD_CONSTANT;
        return pma_take_doubles(obj, (npy_intp)load->n, "load", arrays, &load->values);
    }
    if (PyTuple_Size(obj) == 5)
        return take_sampled(obj, arrays, load);
    if (PyTuple_Size(obj) == 2 && pma_is_compiled(PyTuple_GetItem(obj, 0)))
        return take_force(obj, arrays, load);
    return take_table(obj, arrays, load);
}

/* A list of other loads, which is not changed meanwhile. */
static int take_sum(PyObject *obj, PyObject *arrays, pma_load *load)
{
    const size_t count = (size_t)PyList_Size(obj);
    const size_t size = (count * sizeof(pma_load) + sizeof(double)) / sizeof(double);
    pma_load *each = (pma_load *)(void *)pma_add_scratch((npy_intp)size, arrays);
    if (!each)
        return -1;
    for (size_t i = 0; i < count; i++) {
        PyObject *own = PyList_GetItem(obj, (Py_ssize_t)i);
        each[i] = (pma_load){.kind = PMA_LOAD_NONE, .n = load->n};
        if (!own)
            return -1;
        if (PyList_Check(own))
            return pma_refuse(PyExc_TypeError, "a load in a list must not be a list");
        if (take_any_load(own, arrays, &each[i]) < 0)
            return -1;
    }
    load->kind = PMA_LOAD_SUM;
    load->each = each;
    load->count = count;
    return 0;
}

PyObject *pma_take_load(PyObject *obj, pma_load *load)
{
    PyObject *arrays = PyList_New(0);
    if (arrays && take_any_load(obj, arrays, load) < 0)
        Py_CLEAR(arrays);
    return arrays;
}
