/* Methods of Coupler that read and write what belongs to the present beside the subdomains. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* Numbers of the present that belong to the coupler: a copy, or all of them written, after
 * start. */

static PyObject *copy_numbers(CouplerObject *self, pma_numbers get)
{
    size_t size;
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const double *present = get(self->core, &size);
    PyObject *copy = pma_new_vector((npy_intp)size, present);
    pma_coupler_release(self);
    return copy;
}

static PyObject *set_numbers(CouplerObject *self, PyObject *obj, const char *name, pma_numbers get)
{
    size_t size;
    const double *values;
    if (pma_coupler_claim(self) < 0)
        return NULL;
    double *present = get(self->core, &size);
    const int failed = pma_take_doubles(obj, (npy_intp)size, name, NULL, &values);
    if (!failed && size > 0)
        memcpy(present, values, size * sizeof(double));
    pma_coupler_release(self);
    return failed ? NULL : Py_NewRef(Py_None);
}

#define NUMBERS(name, get)                                                                 \
    PyObject *pma_coupler_object_##name(CouplerObject *self, PyObject *Py_UNUSED(ignored)) \
    {                                                                                      \
        return copy_numbers(self, get);                                                    \
    }                                                                                      \
    PyObject *pma_coupler_object_set_##name(CouplerObject *self, PyObject *obj)            \
    {                                                                                      \
        return set_numbers(self, obj, #name, get);                                         \
    }

NUMBERS(end_multipliers, pma_coupler_end_multipliers)
NUMBERS(gap, pma_coupler_gap)
NUMBERS(iteration, pma_coupler_iteration)
NUMBERS(contact, pma_coupler_contact)

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
