/* Sparse matrices in other forms and orders, as functions of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "algebra/matrix.h"

/* ptr and start follow from the rows and columns of each strip. */
static void lay_out(const pma_strips *S, const int64_t *columns, int64_t *ptr, int64_t *start)
{
    ptr[0] = start[0] = 0;
    for (size_t s = 0; s < S->count; s++) {
        ptr[s + 1] = ptr[s] + columns[s];
        start[s + 1] = start[s] + columns[s] * (S->first[s + 1] - S->first[s]);
    }
}

/* (first, ptr, index, start, values) of `count` strips; scratch: columns (n), mark (n) */
static PyObject *new_strips(const pma_matrix *A, size_t count, const int64_t *first,
                            const int64_t *columns, int64_t *mark)
{
    int64_t *own_first, *ptr, *start;
    int32_t *index;
    double *values;
    const npy_intp starts = (npy_intp)count + 1;
    PyObject *arrays[5] = {pma_new_array(starts, NPY_INT64, &own_first),
                           pma_new_array(starts, NPY_INT64, &ptr), NULL,
                           pma_new_array(starts, NPY_INT64, &start), NULL};
    if (arrays[0] && arrays[1] && arrays[3]) {
        memcpy(own_first, first, (size_t)starts * sizeof *first);
        pma_strips S = {.count = count, .first = own_first, .ptr = ptr, .start = start};
        lay_out(&S, columns, ptr, start);
        arrays[2] = pma_new_array((npy_intp)ptr[count], NPY_INT32, &index);
        arrays[4] = pma_new_array((npy_intp)start[count], NPY_DOUBLE, &values);
        if (arrays[2] && arrays[4])
            pma_strips_fill(&S, A->n, A->ptr, A->index, A->values, mark, index, values);
    }
    return pma_pack(5, arrays);
}

/* (ptr, index, values) of any size */
static int take_by_rows(PyObject *obj, pma_matrix *A)
{
    if (!PyTuple_Check(obj) || PyTuple_Size(obj) != 3)
        return pma_refuse(PyExc_TypeError, "matrix must be a tuple (ptr, index, values)");
    PyObject *ptr = PyTuple_GetItem(obj, 0);
    if (!PyArray_Check(ptr) || PyArray_NDIM((PyArrayObject *)ptr) != 1 ||
        PyArray_DIM((PyArrayObject *)ptr, 0) < 1)
        return pma_refuse(PyExc_TypeError, "ptr must be an array with one axis, and not empty");
    const npy_intp n = PyArray_DIM((PyArrayObject *)ptr, 0) - 1;
    if (pma_take_matrix(obj, n, "matrix", NULL, A) < 0)
        return -1;
    const pma_status status = pma_matrix_check(A);
    if (status != PMA_OK)
        pma_raise(status, "matrix");
    return status == PMA_OK ? 0 : -1;
}

static PyObject *strips(PyObject *Py_UNUSED(module), PyObject *obj)
{
    pma_matrix A;
    if (take_by_rows(obj, &A) < 0)
        return NULL;
    int64_t *scratch = PyMem_Calloc(3 * A.n + 1, sizeof *scratch);
    if (!scratch)
        return PyErr_NoMemory();
    int64_t *first = scratch, *columns = scratch + A.n + 1, *mark = scratch + 2 * A.n + 1;
    const size_t count = pma_strips_group(A.n, A.ptr, A.index, first, columns, mark);
    PyObject *tuple = new_strips(&A, count, first, columns, mark);
    PyMem_Free(scratch);
    return tuple;
}

/* Fills position, the inverse of order; -1 unless order is a permutation. */
static int invert(size_t n, const int64_t *order, int32_t *position)
{
    for (size_t i = 0; i < n; i++)
        position[i] = -1;
    for (size_t k = 0; k < n; k++) {
        if (order[k] < 0 || (size_t)order[k] >= n || position[order[k]] >= 0)
            return pma_refuse(PyExc_ValueError, "order must be a permutation");
        position[order[k]] = (int32_t)k;
    }
    return 0;
}

/* (ptr, index, values) of A in this order; position (n) */
static PyObject *new_permuted(const pma_matrix *A, const int64_t *order, const int32_t *position)
{
    int64_t *ptr;
    int32_t *index;
    double *values;
    const npy_intp entries = (npy_intp)A->ptr[A->n];
    PyObject *arrays[3] = {pma_new_array((npy_intp)A->n + 1, NPY_INT64, &ptr),
                           pma_new_array(entries, NPY_INT32, &index),
                           pma_new_array(entries, NPY_DOUBLE, &values)};
    if (arrays[0] && arrays[1] && arrays[2]) {
        pma_caller before = pma_gil_release();
        pma_matrix_permute(A->n, A->ptr, A->index, A->values, order, position, ptr, index, values);
        pma_gil_acquire(before);
    }
    return pma_pack(3, arrays);
}

static PyObject *permuted(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *matrix, *order_obj, *tuple = NULL;
    pma_matrix A;
    const int64_t *order;
    if (!PyArg_ParseTuple(args, "OO", &matrix, &order_obj) || take_by_rows(matrix, &A) < 0 ||
        pma_take_order(order_obj, (npy_intp)A.n, NULL, &order) < 0)
        return NULL;
    int32_t *position = PyMem_Malloc((A.n + 1) * sizeof *position);
    if (!position)
        return PyErr_NoMemory();
    if (invert(A.n, order, position) == 0)
        tuple = new_permuted(&A, order, position);
    PyMem_Free(position);
    return tuple;
}

PyMethodDef pma_matrix_functions[] = {
    {"strips", strips, METH_O,
     "strips((ptr, index, values)) -> (first, ptr, index, start, values): adjacent rows with the "
     "same columns stored together"},
    {"permuted", permuted, METH_VARARGS,
     "permuted((ptr, index, values), order) -> (ptr, index, values): row and column k are row and "
     "column order[k], ascending in each row"},
    {NULL, NULL, 0, NULL},
};
