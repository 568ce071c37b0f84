/* Methods of Subdomain: what sums of works begin or go on with. */
#define NO_IMPORT_ARRAY
#include "binding.h"

PyObject *pma_subdomain_get_works(SubdomainObject *self, PyObject *none)
{
    (void)none;
    const pma_energy *energy = pma_subdomain_energy(self->core);
    if (!energy)
        Py_RETURN_NONE;
    npy_intp size = (npy_intp)pma_energy_size(energy);
    PyObject *out = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (!out || pma_energy_keep(energy, PyArray_DATA((PyArrayObject *)out)))
        return out;
    Py_DECREF(out);
    Py_RETURN_NONE;
}

PyObject *pma_subdomain_go_on(SubdomainObject *self, PyObject *obj)
{
    const double *in;
    pma_energy *energy = pma_subdomain_energy(self->core);
    if (!energy)
        return PyErr_Format(PyExc_ValueError, "resume_works needs begin_energy before");
    if (pma_take_doubles(obj, (npy_intp)pma_energy_size(energy), "works", NULL, &in) < 0)
        return NULL;
    pma_energy_resume(energy, in);
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
