/* Methods of Subdomain: what sums of works begin or go on with. */
#define NO_IMPORT_ARRAY
#include "binding.h"

PyObject *pma_subdomain_get_works(SubdomainObject *self, PyObject *none)
{
    (void)none;
    npy_intp size = (npy_intp)pma_subdomain_works(self->core);
    if (size == 0)
        Py_RETURN_NONE;
    PyObject *out = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (!out || pma_subdomain_keep_works(self->core, PyArray_DATA((PyArrayObject *)out)))
        return out;
    Py_DECREF(out);
    Py_RETURN_NONE;
}

PyObject *pma_subdomain_go_on(SubdomainObject *self, PyObject *obj)
{
    const double *in;
    const npy_intp size = (npy_intp)pma_subdomain_works(self->core);
    if (size == 0)
        return PyErr_Format(PyExc_ValueError, "resume_works needs begin_energy before");
    if (pma_take_doubles(obj, size, "works", NULL, &in) < 0)
        return NULL;
    pma_subdomain_resume_works(self->core, in);
    Py_RETURN_NONE;
}

PyObject *pma_subdomain_get_functions(SubdomainObject *self, PyObject *obj)
{
    const long long steps = PyLong_AsLongLong(obj);
    if (steps == -1 && PyErr_Occurred())
        return NULL;
    const double *functions = pma_subdomain_functions(self->core, steps);
    if (!functions)
        Py_RETURN_NONE;
    return pma_new_vector(2 * (npy_intp)pma_subdomain_parts(self->core)->n, functions);
}

PyObject *pma_subdomain_take_functions(SubdomainObject *self, PyObject *args)
{
    long long steps;
    PyObject *obj;
    const double *in;
    const npy_intp size = 2 * (npy_intp)pma_subdomain_parts(self->core)->n;
    if (!PyArg_ParseTuple(args, "LO", &steps, &obj) ||
        pma_take_doubles(obj, size, "functions", NULL, &in) < 0)
        return NULL;
    pma_subdomain_set_functions(self->core, steps, in);
    Py_RETURN_NONE;
}
