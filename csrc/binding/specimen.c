/* A run of given commands through a specimen, as a function of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* r and x (k, n), from their zeros; -1 with an exception set */
static int run_commands(const pma_specimen *own, npy_intp k, const double *t, const double *u,
                        const double *v, double *r, double *x)
{
    const size_t n = own->n, bytes = n * sizeof(double);
    double *memory = PyMem_Calloc(pma_specimen_numbers(own) + n, sizeof *memory);
    if (!memory)
        return pma_check(PMA_NO_MEMORY, NULL);
    double *rate = memory + pma_specimen_numbers(own);
    int code = 0;
    for (npy_intp i = 0; i < k && code == 0; i++) {
        memcpy(x + (size_t)i * n, u + (size_t)i * n, bytes);
        memcpy(rate, v + (size_t)i * n, bytes);
        code = pma_specimen_evaluate(own, t[i], x + (size_t)i * n, rate, r + (size_t)i * n, memory);
    }
    PyMem_Free(memory);
    if (code != 0 && !PyErr_Occurred())
        PyErr_Format(PyExc_RuntimeError, "the specimen returned %d", code);
    return code != 0 ? -1 : 0;
}

static PyObject *follow_in(PyObject *args, PyObject *arrays)
{
    PyObject *obj, *t_obj, *u_obj, *v_obj;
    PyArrayObject *u;
    const npy_intp any[2] = {-1, -1};
    const double *t, *v;
    if (!PyArg_ParseTuple(args, "OOOO", &obj, &t_obj, &u_obj, &v_obj) ||
        pma_take_array(u_obj, NPY_DOUBLE, 2, any, "u", NULL, &u) < 0)
        return NULL;
    const npy_intp *shape = PyArray_DIMS(u);
    PyArrayObject *rates;
    if (pma_take_doubles(t_obj, shape[0], "t", NULL, &t) < 0 ||
        pma_take_array(v_obj, NPY_DOUBLE, 2, shape, "v", NULL, &rates) < 0)
        return NULL;
    v = PyArray_DATA(rates);
    pma_specimen *own;
    if (pma_take_specimen(obj, shape[1], arrays, &own) < 0)
        return NULL;
    PyObject *results[2] = {PyArray_ZEROS(2, shape, NPY_DOUBLE, 0),
                            PyArray_ZEROS(2, shape, NPY_DOUBLE, 0)};
    if (results[0] && results[1] &&
        run_commands(own, shape[0], t, PyArray_DATA(u), v,
                     PyArray_DATA((PyArrayObject *)results[0]),
                     PyArray_DATA((PyArrayObject *)results[1])) < 0)
        Py_CLEAR(results[1]);
    return pma_pack(2, results);
}

static PyObject *follow_specimen(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *arrays = PyList_New(0);
    PyObject *result = arrays ? follow_in(args, arrays) : NULL;
    Py_XDECREF(arrays);
    return result;
}

PyMethodDef pma_specimen_functions[] = {
    {"follow_specimen", follow_specimen, METH_VARARGS,
     "follow_specimen(specimen, t, u, v) -> (r, x): of one that is new, at commands u (k, n)"},
    {NULL, NULL, 0, NULL},
};
