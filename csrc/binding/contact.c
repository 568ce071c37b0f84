/* Methods of Coupler that are of contacts. */
#define NO_IMPORT_ARRAY
#include "binding.h"

PyObject *pma_coupler_object_compliance(CouplerObject *self, PyObject *obj)
{
    size_t rows;
    const int start = PyObject_IsTrue(obj);
    if (start < 0 || pma_coupler_claim(self) < 0)
        return NULL;
    const double *W = pma_coupler_contact_compliance(self->core, start, &rows);
    PyObject *copy = pma_new_vector((npy_intp)(rows * rows), W);
    pma_coupler_release(self);
    return copy;
}

PyObject *pma_coupler_object_turns(CouplerObject *self, PyObject *Py_UNUSED(ignored))
{
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const size_t turns = pma_coupler_contact_turns(self->core);
    pma_coupler_release(self);
    return PyLong_FromSize_t(turns);
}

PyObject *pma_coupler_object_set_obstacle(CouplerObject *self, PyObject *obj)
{
    const pma_coupler_parts *parts = pma_coupler_get_parts(self->core);
    if (parts->schedule != &pma_contact_schedule)
        return PyErr_Format(PyExc_ValueError, "set_obstacle needs contacts");
    if (pma_coupler_claim(self) < 0)
        return NULL;
    pma_load load;
    PyObject *arrays = pma_take_load(obj, 2 * pma_coupler_contacts(self->core), false, &load);
    const bool fits = arrays && !pma_load_has(&load, PMA_LOAD_CALLED);
    if (fits) {
        pma_coupler_set_obstacle(self->core, load);
        pma_swap(&self->obstacle, &arrays);
    }
    pma_coupler_release(self);
    if (!fits && arrays)
        PyErr_SetString(PyExc_TypeError, "an obstacle must not be compiled");
    Py_XDECREF(arrays);
    return fits ? Py_NewRef(Py_None) : NULL;
}
