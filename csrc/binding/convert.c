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

/* What one taker of the core takes from an object; the memory that it points into goes to `store`,
 * which may be NULL where there is none. */
typedef pma_status taker(const pma_field *f, size_t n, size_t nb, void *out);

static int take(PyObject *obj, const char *name, PyObject *arrays, pma_store *store, taker *take_it,
                size_t n, size_t nb, void *out)
{
    pma_fields fields;
    PyObject *borrowed = arrays ? Py_NewRef(arrays) : PyList_New(0);
    int failed = borrowed ? pma_read_tree(obj, borrowed, store, &fields) : -1;
    if (!failed) {
        const pma_field root = pma_field_root(&fields, name);
        failed = pma_end_tree(&fields, take_it(&root, n, nb, out));
    }
    Py_XDECREF(borrowed);
    return failed;
}

static pma_status take_matrix(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)nb;
    return pma_parts_matrix(f, n, out);
}

int pma_take_matrix(PyObject *obj, npy_intp n, const char *name, PyObject *arrays, pma_matrix *out)
{
    return take(obj, name, arrays, NULL, take_matrix, (size_t)n, 0, out);
}

static pma_status take_factor(const pma_field *f, size_t n, size_t nb, void *out)
{
    return pma_parts_factor(f, n, nb, out);
}

int pma_take_factor(PyObject *obj, npy_intp n, npy_intp nb, const char *name, PyObject *arrays,
                    pma_factor *out)
{
    return take(obj, name, arrays, NULL, take_factor, (size_t)n, (size_t)nb, out);
}

static pma_status take_panels(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_panels(f, out);
}

int pma_take_panels(PyObject *obj, const char *name, PyObject *arrays, pma_panels *out)
{
    return take(obj, name, arrays, NULL, take_panels, 0, 0, out);
}

static pma_status take_link(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n;
    return pma_parts_link(f, nb, out);
}

int pma_take_link(PyObject *obj, size_t nb, PyObject *arrays, pma_link *out)
{
    return take(obj, "link", arrays, NULL, take_link, 0, nb, out);
}

static pma_status take_springs(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_springs(f, out);
}

int pma_take_springs(PyObject *obj, PyObject *arrays, pma_store *store, pma_springs *out)
{
    return take(obj, "springs", arrays, store, take_springs, 0, 0, out);
}

static pma_status take_specimen(const pma_field *f, size_t n, size_t nb, void *out)
{
    bool by_caller;
    (void)nb;
    return pma_parts_specimen(f, n, out, &by_caller);
}

int pma_take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, pma_store *store,
                      pma_specimen **out)
{
    return take(obj, "specimen", arrays, store, take_specimen, (size_t)n, 0, out);
}

static pma_status take_subdomain(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_subdomain(f, out);
}

int pma_take_subdomain(PyObject *obj, PyObject *arrays, pma_store *store, pma_subdomain_taken *out)
{
    return take(obj, NULL, arrays, store, take_subdomain, 0, 0, out);
}

int pma_take_coupler(PyObject *obj, PyObject *arrays, pma_store *store, const pma_members *members,
                     pma_coupler_taken *out)
{
    pma_fields fields;
    if (pma_read_tree(obj, arrays, store, &fields) < 0)
        return -1;
    const pma_field root = pma_field_root(&fields, NULL);
    return pma_end_tree(&fields, pma_parts_coupler(&root, members, out));
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
