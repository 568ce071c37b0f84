/* Several load cases side by side: objects that are PMA_LANES times another one
 * (subdomain/cases.h). */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "subdomain/cases.h"

/* ---- a subdomain ---------------------------------------------------------------------------- */

PyObject *pma_subdomain_in_lanes(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    if (self->of || !pma_cases_are_possible(self->core))
        return PyErr_Format(PyExc_ValueError, "the subdomain must be one without functions, and "
                                              "not in lanes");
    SubdomainObject *lanes = (SubdomainObject *)PyType_GenericAlloc(type, 0);
    if (!lanes)
        return NULL;
    lanes->of = (SubdomainObject *)Py_NewRef((PyObject *)self);
    const pma_status status = pma_cases_create(self->core, &lanes->core);
    if (status == PMA_OK)
        return (PyObject *)lanes;
    Py_DECREF(lanes);
    return pma_raise(status, "in_lanes");
}

/* ---- a coupler ------------------------------------------------------------------------------ */

static int check_lanes(CouplerObject *self, PyObject *subdomains)
{
    const Py_ssize_t count = PyTuple_Size(self->subdomains);
    bool all = PyTuple_Size(subdomains) == count;
    for (Py_ssize_t i = 0; all && i < count; i++) {
        PyObject *s = PyTuple_GetItem(subdomains, i);
        all = Py_IS_TYPE(s, Py_TYPE((PyObject *)pma_subdomain_of(self, i))) &&
              ((SubdomainObject *)s)->of == pma_subdomain_of(self, i);
    }
    if (!all)
        PyErr_SetString(PyExc_ValueError, "need the subdomains of the coupler in lanes");
    return all ? 0 : -1;
}

/* A motion for each lane: row k of lane l is row k * PMA_LANES + l. */
static int spread_motions(const pma_coupler_parts *of, CouplerObject *self, pma_motion *motions)
{
    for (size_t i = 0; i < of->motion_count * PMA_LANES; i++) {
        const pma_motion *each = &of->motions[i / PMA_LANES];
        npy_intp size = (npy_intp)each->load.n;
        PyObject *rows = PyArray_SimpleNew(1, &size, NPY_INT64);
        if (!rows || PyList_Append(self->arrays, rows) < 0 ||
            PyList_Append(self->motions, Py_None) < 0) {
            Py_XDECREF(rows);
            return -1;
        }
        int64_t *values = PyArray_DATA((PyArrayObject *)rows);
        for (size_t k = 0; k < each->load.n; k++)
            values[k] = each->rows[k] * PMA_LANES + (int64_t)(i % PMA_LANES);
        motions[i] = (pma_motion){.rows = values, .load = {.n = each->load.n}};
        Py_DECREF(rows);
    }
    return 0;
}

static int take_interface(const pma_interface *of, pma_interface *own, pma_interface *out)
{
    const pma_factor factor = pma_factor_in_lanes(&of->factor);
    const pma_status status = pma_interface_create(&factor, own);
    *out = *own;
    return pma_check(status, "in_lanes");
}

static int fill_lanes(CouplerObject *of, CouplerObject *self)
{
    const pma_coupler_parts *each = pma_coupler_get_parts(of->core);
    pma_coupler_parts parts = *each; /* all options */
    parts.p *= PMA_LANES;
    parts.doubled = pma_matrix_in_lanes(&each->doubled);
    parts.motion_count *= PMA_LANES;
    parts.threads = 1;
    pma_motion *motions = PyMem_Calloc(parts.motion_count + 1, sizeof *motions);
    if (!motions)
        return pma_check(PMA_NO_MEMORY, NULL);
    parts.motions = motions;
    int failed = take_interface(&of->H_start, &self->H_start, &parts.H_start) < 0 ||
                 take_interface(&of->H, &self->H, &parts.H) < 0 ||
                 spread_motions(each, self, motions) < 0 || pma_coupler_fill(self, &parts) < 0;
    PyMem_Free(motions);
    return failed ? -1 : 0;
}

PyObject *pma_coupler_in_lanes(CouplerObject *self, PyObject *subdomains)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    if (!PyTuple_Check(subdomains))
        return PyErr_Format(PyExc_TypeError, "subdomains must be a tuple");
    if (check_lanes(self, subdomains) < 0)
        return NULL;
    CouplerObject *lanes = (CouplerObject *)PyType_GenericAlloc(type, 0);
    if (!lanes)
        return NULL;
    lanes->subdomains = Py_NewRef(subdomains);
    lanes->arrays = PyList_New(0);
    lanes->motions = PyList_New(0);
    if (!lanes->arrays || !lanes->motions ||
        PyList_Append(lanes->arrays, (PyObject *)self) < 0 || /* it has the factors */
        fill_lanes(self, lanes) < 0)
        Py_CLEAR(lanes);
    return (PyObject *)lanes;
}

/* ---- results -------------------------------------------------------------------------------- */

static PyObject *split_lanes(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *obj, *vectors;
    PyArrayObject *x, *own;
    double *out[PMA_LANES];
    npy_intp any[2] = {-1, -1};
    if (!PyArg_ParseTuple(args, "OO!", &obj, &PyTuple_Type, &vectors) ||
        pma_take_array(obj, NPY_DOUBLE, 2, any, "x", NULL, &x) < 0)
        return NULL;
    const npy_intp shape[2] = {PyArray_DIM(x, 0), PyArray_DIM(x, 1) / PMA_LANES};
    const Py_ssize_t count = PyTuple_Size(vectors);
    if (count > PMA_LANES || PyArray_DIM(x, 1) % PMA_LANES != 0)
        return PyErr_Format(PyExc_ValueError, "x must be in lanes, with up to %d vectors",
                            PMA_LANES);
    for (Py_ssize_t l = 0; l < count; l++) {
        PyObject *vector = PyTuple_GetItem(vectors, l);
        if (pma_take_output(vector, 2, shape, "a vector", &own) < 0)
            return NULL;
        out[l] = PyArray_DATA(own);
    }
    pma_lanes_split((size_t)(shape[0] * shape[1]), PyArray_DATA(x), (size_t)count, out);
    Py_RETURN_NONE;
}

PyMethodDef pma_case_functions[] = {
    {"split_lanes", split_lanes, METH_VARARGS,
     "split_lanes(x, vectors): the rows of the first lanes of x into arrays of their own"},
    {NULL, NULL, 0, NULL},
};
