/* A run of given commands through a specimen, as a function of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* r and x (k, n), from their zeros; -1 with an exception set */
static int run_commands(const pma_specimen *own, npy_intp k, const double *t,
                        const pma_wanted *first, double *r, double *x)
{
    const size_t n = own->n;
    double *memory = PyMem_Calloc(pma_specimen_numbers(own), sizeof *memory);
    if (!memory)
        return pma_check(PMA_NO_MEMORY, NULL);
    const double *measured = memory + pma_specimen_trace(own).measured;
    int code = 0;
    for (size_t i = 0; i < (size_t)k && code == 0; i++) {
        const pma_wanted wanted = {
            .u = first->u + i * n, .v = first->v + i * n, .a = first->a + i * n};
        code = pma_specimen_evaluate(own, t[i], &wanted, r + i * n, memory);
        memcpy(x + i * n, measured, n * sizeof(double));
    }
    PyMem_Free(memory);
    if (code != 0 && !PyErr_Occurred())
        PyErr_Format(PyExc_RuntimeError, "the specimen returned %d", code);
    return code != 0 ? -1 : 0;
}

static PyObject *follow_in(PyObject *args, PyObject *arrays)
{
    PyObject *obj, *t_obj, *u_obj, *v_obj, *a_obj;
    PyArrayObject *u, *v, *a;
    const npy_intp any[2] = {-1, -1};
    const double *t;
    if (!PyArg_ParseTuple(args, "OOOOO", &obj, &t_obj, &u_obj, &v_obj, &a_obj) ||
        pma_take_array(u_obj, NPY_DOUBLE, 2, any, "u", NULL, &u) < 0)
        return NULL;
    const npy_intp *shape = PyArray_DIMS(u);
    if (pma_take_doubles(t_obj, shape[0], "t", NULL, &t) < 0 ||
        pma_take_array(v_obj, NPY_DOUBLE, 2, shape, "v", NULL, &v) < 0 ||
        pma_take_array(a_obj, NPY_DOUBLE, 2, shape, "a", NULL, &a) < 0)
        return NULL;
    pma_specimen *own;
    if (pma_take_specimen(obj, shape[1], arrays, &own) < 0)
        return NULL;
    if (own->dofs) {
        PyErr_SetString(PyExc_ValueError, "the specimen must have a dof for each command");
        return NULL;
    }
    PyObject *results[2] = {PyArray_ZEROS(2, shape, NPY_DOUBLE, 0),
                            PyArray_ZEROS(2, shape, NPY_DOUBLE, 0)};
    const pma_wanted first = {PyArray_DATA(u), PyArray_DATA(v), PyArray_DATA(a), 0.0};
    if (results[0] && results[1] &&
        run_commands(own, shape[0], t, &first, PyArray_DATA((PyArrayObject *)results[0]),
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
     "follow_specimen(specimen, t, u, v, a) -> (r, x): of one that is new, at commands u (k, n)"},
    {NULL, NULL, 0, NULL},
};
