/* Arguments of Python in the forms of the core, and results back. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "member/laws.h"

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

/* Doubles in up to two axes, or two such arrays in one with an axis more: where the second of them
 * begins goes to *second, 0 where there is none. An extent of -1 is any, and is set. */
static int take_once_or_twice(PyObject *obj, int ndim, npy_intp *shape, const char *name,
                              PyObject *arrays, const double **values, size_t *second)
{
    npy_intp pair[3] = {2, shape[0], ndim > 1 ? shape[1] : 0};
    PyArrayObject *array;
    const bool twice = PyArray_Check(obj) && PyArray_NDIM((PyArrayObject *)obj) == ndim + 1;
    if (pma_take_array(obj, NPY_DOUBLE, ndim + twice, twice ? pair : shape, name, arrays, &array) <
        0)
        return -1;
    for (int i = 0; i < ndim; i++)
        shape[i] = PyArray_DIM(array, i + twice);
    *values = PyArray_DATA(array);
    *second = twice ? (size_t)PyArray_SIZE(array) / 2 : 0;
    return 0;
}

/* (ptr, index, values) of a matrix by rows or by columns, with n of them; values of two matrices
 * only where `second` is not NULL */
static int take_compressed(PyObject *obj, npy_intp n, const char *name, PyObject *arrays,
                           const int64_t **ptr, const int32_t **index, const double **values,
                           size_t *second)
{
    npy_intp starts = n + 1;
    if (!PyTuple_Check(obj) || PyTuple_Size(obj) != 3)
        return pma_refuse(PyExc_TypeError, "%s must be a tuple (ptr, index, values)", name);
    if (pma_take_vector(PyTuple_GetItem(obj, 0), NPY_INT64, &starts, name, arrays, ptr) < 0)
        return -1;
    npy_intp entries = (npy_intp)(*ptr)[n];
    if (entries < 0)
        return pma_refuse(PyExc_ValueError, "%s: the last start must not be negative", name);
    if (pma_take_vector(PyTuple_GetItem(obj, 1), NPY_INT32, &entries, name, arrays, index) < 0)
        return -1;
    PyObject *numbers = PyTuple_GetItem(obj, 2);
    return second ? take_once_or_twice(numbers, 1, &entries, name, arrays, values, second)
                  : pma_take_doubles(numbers, entries, name, arrays, values);
}

static int take_square(PyObject *obj, npy_intp n, const char *name, PyObject *arrays,
                       const double **values)
{
    const npy_intp shape[2] = {n, n};
    PyArrayObject *array;
    if (pma_take_array(obj, NPY_DOUBLE, 2, shape, name, arrays, &array) < 0)
        return -1;
    *values = PyArray_DATA(array);
    return 0;
}

static int band_error(const char *name, npy_intp n, const npy_intp shape[2])
{
    return pma_refuse(PyExc_ValueError,
                      "%s: a band of %zd rows cannot have the extents %zd and %zd", name,
                      (Py_ssize_t)n, (Py_ssize_t)shape[0], (Py_ssize_t)shape[1]);
}

/* (values,), values[d, i] = A_i,i+d; unsymmetric: values[0, d, i] and
 * values[1, d, i] = A_i+d,i */
static int take_matrix_band(PyObject *obj, npy_intp n, const char *name, PyObject *arrays,
                            pma_matrix *out)
{
    npy_intp shape[2] = {-1, -1};
    out->form = PMA_BAND;
    if (take_once_or_twice(PyTuple_GetItem(obj, 0), 2, shape, name, arrays, &out->values,
                           &out->below) < 0)
        return -1;
    if (shape[1] != n || shape[0] < 1 || shape[0] > n)
        return band_error(name, n, shape);
    out->width = (size_t)shape[0] - 1;
    return 0;
}

/* (values,), values[j, k] = R_j+1+k,j; unsymmetric: values[0, j, k] and values[1, j, k] of
 * Q */
static int take_factor_band(PyObject *obj, npy_intp n, const char *name, PyObject *arrays,
                            pma_factor *out)
{
    npy_intp shape[2] = {-1, -1};
    out->form = PMA_BAND;
    if (take_once_or_twice(PyTuple_GetItem(obj, 0), 2, shape, name, arrays, &out->values, &out->Q) <
        0)
        return -1;
    if (shape[0] != n || shape[1] < 1 || shape[1] >= n)
        return band_error(name, n, shape);
    out->width = (size_t)shape[1];
    return 0;
}

/* (first, ptr, index, start, values), laid out like panels; not checked yet */
static int take_strips(PyObject *obj, const char *name, PyObject *arrays, pma_strips *out)
{
    pma_panels p;
    if (pma_take_panels(obj, name, arrays, &p) < 0)
        return -1;
    *out = (pma_strips){.count = p.count,
                        .first = p.first,
                        .ptr = p.row_ptr,
                        .index = p.rows,
                        .start = p.start,
                        .values = p.values};
    return 0;
}

int pma_take_matrix(PyObject *obj, npy_intp n, const char *name, PyObject *arrays, pma_matrix *out)
{
    *out = (pma_matrix){.form = PMA_ZERO, .n = (size_t)n};
    if (obj == Py_None)
        return 0;
    if (PyTuple_Check(obj) && PyTuple_Size(obj) == 1)
        return take_matrix_band(obj, n, name, arrays, out);
    if (PyTuple_Check(obj) && PyTuple_Size(obj) == 5) {
        out->form = PMA_STRIPS;
        return take_strips(obj, name, arrays, &out->strips);
    }
    if (PyTuple_Check(obj)) {
        out->form = PMA_SPARSE;
        return take_compressed(obj, n, name, arrays, &out->ptr, &out->index, &out->values, NULL);
    }
    if (PyArray_Check(obj) && PyArray_NDIM((PyArrayObject *)obj) == 2) {
        out->form = PMA_DENSE;
        return take_square(obj, n, name, arrays, &out->values);
    }
    out->form = PMA_DIAGONAL;
    return pma_take_doubles(obj, n, name, arrays, &out->values);
}

/* (first, row_ptr, rows, start) of a tuple of five */
int pma_take_structure(PyObject *obj, const char *name, PyObject *arrays, pma_panels *out)
{
    PyObject *first, *row_ptr, *rows, *start, *last;
    npy_intp starts = -1;
    *out = (pma_panels){.count = 0};
    if (!PyArg_ParseTuple(obj, "OOOOO", &first, &row_ptr, &rows, &start, &last) ||
        pma_take_vector(first, NPY_INT64, &starts, name, arrays, &out->first) < 0)
        return -1;
    if (starts == 0)
        return pma_refuse(PyExc_ValueError, "%s: first must not be empty", name);
    if (pma_take_vector(row_ptr, NPY_INT64, &starts, name, arrays, &out->row_ptr) < 0 ||
        pma_take_vector(start, NPY_INT64, &starts, name, arrays, &out->start) < 0)
        return -1;
    out->count = (size_t)starts - 1;
    npy_intp length = (npy_intp)out->row_ptr[out->count];
    if (length < 0 || out->start[out->count] < 0)
        return pma_refuse(PyExc_ValueError, "%s: the last start must not be negative", name);
    return pma_take_vector(rows, NPY_INT32, &length, name, arrays, &out->rows);
}

int pma_take_panels(PyObject *obj, const char *name, PyObject *arrays, pma_panels *out)
{
    const double *values;
    if (pma_take_structure(obj, name, arrays, out) < 0)
        return -1;
    npy_intp length = (npy_intp)out->start[out->count];
    if (take_once_or_twice(PyTuple_GetItem(obj, 4), 1, &length, name, arrays, &values, &out->Q) < 0)
        return -1;
    out->values = PyArray_DATA((PyArrayObject *)PyTuple_GetItem(obj, 4));
    return 0;
}

int pma_take_factor(PyObject *obj, npy_intp n, npy_intp nb, const char *name, PyObject *arrays,
                    pma_factor *out)
{
    PyObject *inverse, *R;
    npy_intp shape[2] = {n, n};
    *out = (pma_factor){.form = PMA_DIAGONAL, .n = (size_t)n, .nb = (size_t)nb};
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "%s must be a tuple (inverse, R)", name);
    if (!PyArg_ParseTuple(obj, "OO", &inverse, &R))
        return -1;
    if (pma_take_doubles(inverse, n, name, arrays, &out->inverse) < 0)
        return -1;
    if (R == Py_None)
        return 0;
    if (PyTuple_Check(R) && PyTuple_Size(R) == 5) {
        out->form = PMA_PANELS;
        return pma_take_panels(R, name, arrays, &out->panels);
    }
    if (PyTuple_Check(R) && PyTuple_Size(R) == 1)
        return take_factor_band(R, n, name, arrays, out);
    if (PyTuple_Check(R)) {
        out->form = PMA_SPARSE;
        return take_compressed(R, n, name, arrays, &out->ptr, &out->index, &out->values, &out->Q);
    }
    out->form = PMA_DENSE;
    return take_once_or_twice(R, 2, shape, name, arrays, &out->values, &out->Q);
}

/* As many elements as there are parameters for; -1 without an exception where these do not fit. */
static int take_elements(int law, PyObject *parameters, pma_spring_set *set)
{
    const size_t count = (size_t)PyTuple_Size(parameters), own = pma_laws[law].parameters;
    const size_t each = pma_laws[law].each_parameters;
    set->law = (pma_spring_law)law;
    set->elements = each > 0 && count > own ? (count - own) / each : 0;
    return count <= PMA_SPRING_PARAMETERS && pma_spring_parameters(set) == count ? 0 : -1;
}

/* (law, first, second, (parameter, ...)) */
static int take_spring_set(PyObject *obj, PyObject *arrays, pma_spring_set *set)
{
    int law;
    PyObject *first, *second, *parameters;
    npy_intp count = -1;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "springs must be tuples");
    if (!PyArg_ParseTuple(obj, "iOOO!", &law, &first, &second, &PyTuple_Type, &parameters) ||
        pma_take_vector(first, NPY_INT32, &count, "first", arrays, &set->first) < 0 ||
        pma_take_vector(second, NPY_INT32, &count, "second", arrays, &set->second) < 0)
        return -1;
    set->count = (size_t)count;
    if (law < 0 || law >= PMA_SPRING_LAWS || take_elements(law, parameters, set) < 0)
        return pma_refuse(PyExc_ValueError, "springs: law and number of parameters must agree");
    for (Py_ssize_t k = 0; k < PyTuple_Size(parameters); k++) {
        if (pma_take_doubles(PyTuple_GetItem(parameters, k), count, "parameter", arrays,
                             &set->parameters[k]) < 0)
            return -1;
    }
    return 0;
}

int pma_take_springs(PyObject *obj, PyObject *arrays, pma_spring_set **sets, pma_springs *out)
{
    const Py_ssize_t count = PyTuple_Size(obj);
    *out = (pma_springs){.count = (size_t)count};
    *sets = PyMem_Calloc((size_t)count + 1, sizeof **sets);
    out->sets = *sets;
    if (!*sets)
        return pma_check(PMA_NO_MEMORY, NULL);
    for (Py_ssize_t i = 0; i < count; i++) {
        if (take_spring_set(PyTuple_GetItem(obj, i), arrays, &(*sets)[i]) < 0)
            return -1;
        out->total += (*sets)[i].count;
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

int pma_take_link(PyObject *obj, size_t nb, PyObject *arrays, pma_link *out)
{
    Py_ssize_t p;
    PyObject *ptr, *index, *values;
    npy_intp starts = (npy_intp)nb + 1;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "link must be a tuple (p, ptr, index, values)");
    if (!PyArg_ParseTuple(obj, "nOOO", &p, &ptr, &index, &values))
        return -1;
    if (p < 0)
        return pma_refuse(PyExc_ValueError, "link: p must not be negative");
    *out = (pma_link){.p = (size_t)p, .nb = nb};
    if (pma_take_vector(ptr, NPY_INT64, &starts, "link", arrays, &out->ptr) < 0)
        return -1;
    npy_intp entries = (npy_intp)out->ptr[nb];
    if (pma_take_vector(index, NPY_INT32, &entries, "link", arrays, &out->index) < 0)
        return -1;
    return pma_take_doubles(values, entries, "link", arrays, &out->values);
}
