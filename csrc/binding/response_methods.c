/* Methods of Subdomain that set-up calls: its compliance and its unit responses. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- compliance --------------------------------------------------------------------------- */

/* out (k, k): compliance between the constraints in `rows` (k) */
static void fill_compliance(pma_subdomain *s, bool twice, const int64_t *rows, npy_intp k,
                            double *lam, double *sum, double *out)
{
    const pma_member member = pma_subdomain_member(s);
    for (npy_intp c = 0; c < k; c++) {
        memset(sum, 0, member.p * sizeof(double));
        lam[rows[c]] = 1.0;
        member.table->compliance(member.self, twice, lam, sum);
        lam[rows[c]] = 0.0;
        for (npy_intp r = 0; r < k; r++)
            out[r * k + c] = sum[rows[r]];
    }
}

static int check_rows(const int64_t *rows, npy_intp k, size_t p)
{
    for (npy_intp c = 0; c < k; c++) {
        if (rows[c] < 0 || (size_t)rows[c] >= p) {
            PyErr_SetString(PyExc_ValueError, "rows: a constraint is out of range");
            return -1;
        }
    }
    return 0;
}

PyObject *pma_subdomain_compliance(SubdomainObject *self, PyObject *args)
{
    int twice;
    PyObject *obj, *out;
    PyArrayObject *rows;
    const npy_intp any = -1;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    if (!PyArg_ParseTuple(args, "pO", &twice, &obj) ||
        pma_take_array(obj, NPY_INT64, 1, &any, "rows", NULL, &rows) < 0)
        return NULL;
    if (twice && !parts->doubled) {
        PyErr_SetString(PyExc_ValueError, "the subdomain takes no double steps");
        return NULL;
    }
    const npy_intp shape[2] = {PyArray_DIM(rows, 0), PyArray_DIM(rows, 0)};
    if (check_rows(PyArray_DATA(rows), shape[0], parts->link.p) < 0)
        return NULL;
    double *scratch = PyMem_Calloc(2 * parts->link.p + 1, sizeof(double));
    if (!scratch)
        return PyErr_NoMemory();
    out = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    if (out && pma_subdomain_claim(self)) {
        PyThreadState *before = pma_gil_release();
        fill_compliance(self->core, twice, PyArray_DATA(rows), shape[0], scratch,
                        scratch + parts->link.p, PyArray_DATA((PyArrayObject *)out));
        pma_gil_acquire(before);
        pma_subdomain_release(self);
    } else {
        Py_CLEAR(out);
    }
    PyMem_Free(scratch);
    return out;
}

/* ---- unit responses (M3) ------------------------------------------------------------------ */

/* Inputs and outputs of a block of columns of H. */
typedef struct {
    const int64_t *rows;      /* k */
    npy_intp k, begin, count; /* columns begin..begin+count-1 of k */
    double *lam;              /* p: zero */
    double *sums;             /* 2 p: scratch */
    double *end, *mean;       /* count x k by rows */
    double *states;           /* count x 4 x n by rows, or NULL */
    bool twice;               /* of a double step */
} response_block;

static void copy_rows(const response_block *b, const double *sum, double *out)
{
    for (npy_intp r = 0; r < b->k; r++)
        out[r] = sum[b->rows[r]];
}

static pma_status fill_responses(pma_subdomain *s, const response_block *b)
{
    const size_t p = pma_subdomain_parts(s)->link.p, size = 4 * pma_subdomain_parts(s)->n;
    pma_response *response = pma_subdomain_response(s);
    for (npy_intp c = 0; c < b->count; c++) {
        const int64_t row = b->rows[b->begin + c];
        memset(b->sums, 0, 2 * p * sizeof(double));
        b->lam[row] = 1.0;
        const pma_status status =
            pma_response_run(response, b->twice, b->lam, b->sums, b->sums + p);
        b->lam[row] = 0.0;
        if (status != PMA_OK)
            return status;
        copy_rows(b, b->sums, b->end + c * b->k);
        copy_rows(b, b->sums + p, b->mean + c * b->k);
        if (b->states)
            memcpy(b->states + (size_t)c * size, pma_response_state(response)->u,
                   size * sizeof(double));
    }
    return PMA_OK;
}

/* A writeable array. */
static int take_output(PyObject *obj, int ndim, const npy_intp *shape, const char *name,
                       PyArrayObject **out)
{
    if (pma_take_array(obj, NPY_DOUBLE, ndim, shape, name, NULL, out) < 0)
        return -1;
    if (PyArray_ISWRITEABLE(*out))
        return 0;
    PyErr_Format(PyExc_ValueError, "%s must be writeable", name);
    return -1;
}

static int take_responses(SubdomainObject *self, PyObject *args, response_block *b)
{
    PyObject *rows, *end, *mean, *states;
    PyArrayObject *array;
    Py_ssize_t begin;
    const npy_intp any = -1;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    int twice = 0;
    if (!PyArg_ParseTuple(args, "OnOOO|p", &rows, &begin, &end, &mean, &states, &twice) ||
        pma_take_array(rows, NPY_INT64, 1, &any, "rows", NULL, &array) < 0)
        return -1;
    *b = (response_block){
        .rows = PyArray_DATA(array), .k = PyArray_DIM(array, 0), .begin = begin, .twice = twice};
    if (check_rows(b->rows, b->k, parts->link.p) < 0)
        return -1;
    npy_intp shape[3] = {-1, b->k, 0};
    if (take_output(end, 2, shape, "end", &array) < 0)
        return -1;
    b->end = PyArray_DATA(array);
    b->count = shape[0] = PyArray_DIM(array, 0);
    if (take_output(mean, 2, shape, "mean", &array) < 0)
        return -1;
    b->mean = PyArray_DATA(array);
    if (!parts->responds || (twice && !parts->doubled) || begin < 0 || b->count > b->k - begin) {
        PyErr_SetString(PyExc_ValueError, "begin: no such columns of the link response");
        return -1;
    }
    if (states == Py_None)
        return 0;
    shape[1] = 4;
    shape[2] = (npy_intp)parts->n;
    if (take_output(states, 3, shape, "states", &array) < 0)
        return -1;
    b->states = PyArray_DATA(array);
    return 0;
}

PyObject *pma_subdomain_unit_responses(SubdomainObject *self, PyObject *args)
{
    response_block b;
    const size_t p = pma_subdomain_parts(self->core)->link.p;
    if (take_responses(self, args, &b) < 0)
        return NULL;
    b.lam = PyMem_Calloc(3 * p + 1, sizeof(double));
    if (!b.lam)
        return PyErr_NoMemory();
    b.sums = b.lam + p;
    if (!pma_subdomain_claim(self)) {
        PyMem_Free(b.lam);
        return NULL;
    }
    PyThreadState *before = pma_gil_release();
    const pma_status status = fill_responses(self->core, &b);
    pma_gil_acquire(before);
    pma_subdomain_release(self);
    PyMem_Free(b.lam);
    return PyBool_FromLong(status == PMA_OK);
}

/* store_responses(rows, states): the states written by unit_responses for all of these rows */
PyObject *pma_subdomain_store_responses(SubdomainObject *self, PyObject *args)
{
    PyObject *rows_obj, *states_obj;
    PyArrayObject *rows, *states;
    const npy_intp any = -1;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    if (!PyArg_ParseTuple(args, "OO", &rows_obj, &states_obj))
        return NULL;
    PyObject *arrays = PyList_New(0);
    if (!arrays || pma_take_array(rows_obj, NPY_INT64, 1, &any, "rows", arrays, &rows) < 0)
        goto failed;
    const npy_intp shape[3] = {PyArray_DIM(rows, 0), 4, (npy_intp)parts->n};
    if (check_rows(PyArray_DATA(rows), shape[0], parts->link.p) < 0 ||
        pma_take_array(states_obj, NPY_DOUBLE, 3, shape, "states", arrays, &states) < 0)
        goto failed;
    if (!parts->responds) {
        PyErr_SetString(PyExc_ValueError, "the subdomain has no link response");
        goto failed;
    }
    if (pma_subdomain_is_busy(self))
        goto failed;
    pma_response_store(pma_subdomain_response(self->core),
                       (pma_unit_responses){.count = (size_t)shape[0],
                                            .rows = PyArray_DATA(rows),
                                            .values = PyArray_DATA(states)});
    Py_XSETREF(self->response, arrays);
    Py_RETURN_NONE;
failed:
    Py_XDECREF(arrays);
    return NULL;
}

PyObject *pma_subdomain_accelerate(SubdomainObject *self, PyObject *obj)
{
    const pma_parts *parts = pma_subdomain_parts(self->core);
    const double *lam;
    npy_intp n = (npy_intp)parts->n;
    if (pma_take_doubles(obj, (npy_intp)parts->link.p, "lam", NULL, &lam) < 0)
        return NULL;
    if (!parts->mean) {
        PyErr_SetString(PyExc_ValueError, "the subdomain is not under mean coupling");
        return NULL;
    }
    PyObject *y = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (!y || !pma_subdomain_claim(self)) {
        Py_XDECREF(y);
        return NULL;
    }
    pma_response_accelerate(pma_subdomain_response(self->core), lam,
                            PyArray_DATA((PyArrayObject *)y));
    pma_subdomain_release(self);
    return y;
}
