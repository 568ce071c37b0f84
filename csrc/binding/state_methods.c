/* Methods of Coupler that read and write what belongs to the present beside the subdomains. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* end_multipliers(): (2 p + 2,) of the accelerations at the present under mean coupling, a copy */
PyObject *pma_coupler_object_end_multipliers(CouplerObject *self, PyObject *Py_UNUSED(ignored))
{
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    PyObject *copy = pma_new_vector(2 * p + 2, pma_coupler_end_multipliers(self->core));
    pma_coupler_release(self);
    return copy;
}

/* set_end_multipliers(lam): after start */
PyObject *pma_coupler_object_set_end_multipliers(CouplerObject *self, PyObject *obj)
{
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    const double *values;
    if (pma_take_doubles(obj, 2 * p + 2, "lam", NULL, &values) < 0 || pma_coupler_claim(self) < 0)
        return NULL;
    memcpy(pma_coupler_end_multipliers(self->core), values, (2 * (size_t)p + 2) * sizeof(double));
    pma_coupler_release(self);
    Py_RETURN_NONE;
}

/* gap(): of the displacements at the present where they are tied under gc, a copy */
PyObject *pma_coupler_object_gap(CouplerObject *self, PyObject *Py_UNUSED(ignored))
{
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    PyObject *copy = pma_new_vector(p, pma_coupler_gap(self->core));
    pma_coupler_release(self);
    return copy;
}

/* set_gap(gap): after start */
PyObject *pma_coupler_object_set_gap(CouplerObject *self, PyObject *obj)
{
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    const double *values;
    if (pma_take_doubles(obj, p, "gap", NULL, &values) < 0 || pma_coupler_claim(self) < 0)
        return NULL;
    memcpy(pma_coupler_gap(self->core), values, (size_t)p * sizeof(double));
    pma_coupler_release(self);
    Py_RETURN_NONE;
}

/* iteration(): what shooting begins the next macro step with, a copy */
PyObject *pma_coupler_object_iteration(CouplerObject *self, PyObject *Py_UNUSED(ignored))
{
    size_t size;
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const double *present = pma_coupler_iteration(self->core, &size);
    PyObject *copy = pma_new_vector((npy_intp)size, present);
    pma_coupler_release(self);
    return copy;
}

/* set_iteration(numbers): after start */
PyObject *pma_coupler_object_set_iteration(CouplerObject *self, PyObject *obj)
{
    size_t size;
    const double *values;
    double *present = pma_coupler_iteration(self->core, &size);
    if (pma_take_doubles(obj, (npy_intp)size, "iteration", NULL, &values) < 0 ||
        pma_coupler_claim(self) < 0)
        return NULL;
    if (size > 0)
        memcpy(present, values, size * sizeof(double));
    pma_coupler_release(self);
    Py_RETURN_NONE;
}

/* set_motion(i, load): the velocity of a prescribed motion, in the forms of a load */
PyObject *pma_coupler_object_set_motion(CouplerObject *self, PyObject *args)
{
    Py_ssize_t i;
    PyObject *obj;
    const pma_coupler_parts *parts = pma_coupler_get_parts(self->core);
    if (!PyArg_ParseTuple(args, "nO", &i, &obj))
        return NULL;
    if (i < 0 || (size_t)i >= parts->motion_count)
        return PyErr_Format(PyExc_ValueError, "i must be the number of a motion, got %zd", i);
    if (pma_coupler_claim(self) < 0)
        return NULL;
    pma_load load = {.kind = PMA_LOAD_NONE, .n = parts->motions[i].load.n};
    PyObject *arrays = pma_take_load(obj, &load), *old = NULL;
    const bool fits = arrays && load.kind != PMA_LOAD_CALLED;
    if (fits) {
        old = Py_NewRef(PyList_GetItem(self->motions, i));
        pma_coupler_set_motion(self->core, (size_t)i, load);
        PyList_SetItem(self->motions, i, arrays);
    }
    pma_coupler_release(self);
    if (!fits && arrays)
        PyErr_SetString(PyExc_TypeError, "the velocity of a motion must not be compiled");
    Py_XDECREF(fits ? old : arrays);
    return fits ? Py_NewRef(Py_None) : NULL;
}
