/* Methods that read and write what belongs to the present beside the levels of subdomains. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* Numbers of the present that belong to the coupler, none where its schedule has no such. */
static const struct {
    const char *name;
    double *(*get)(pma_coupler *c, size_t *size);
} NUMBERS[] = {{"shooting", pma_coupler_iteration},
               {"end_multipliers", pma_coupler_end_multipliers},
               {"contact", pma_coupler_contact}};

/* Those of a name; the caller has claimed the coupler. */
static double *find_numbers(CouplerObject *self, const char *name, size_t *size)
{
    *size = 0;
    for (size_t i = 0; i < sizeof NUMBERS / sizeof *NUMBERS; i++) {
        if (strcmp(name, NUMBERS[i].name) == 0)
            return NUMBERS[i].get(self->core, size);
    }
    PyErr_Format(PyExc_ValueError, "there are no numbers of this name: %s", name);
    return NULL;
}

PyObject *pma_coupler_object_numbers(CouplerObject *self, PyObject *args)
{
    const char *name;
    size_t size;
    if (!PyArg_ParseTuple(args, "s", &name) || pma_coupler_claim(self) < 0)
        return NULL;
    const double *present = find_numbers(self, name, &size);
    PyObject *copy = PyErr_Occurred() ? NULL : pma_new_vector((npy_intp)size, present);
    pma_coupler_release(self);
    return copy;
}

PyObject *pma_coupler_object_set_numbers(CouplerObject *self, PyObject *args)
{
    const char *name;
    PyObject *obj;
    size_t size;
    const double *values;
    if (!PyArg_ParseTuple(args, "sO", &name, &obj) || pma_coupler_claim(self) < 0)
        return NULL;
    double *present = find_numbers(self, name, &size);
    const bool failed =
        PyErr_Occurred() || pma_take_doubles(obj, (npy_intp)size, name, NULL, &values) < 0;
    if (!failed && size > 0)
        memcpy(present, values, size * sizeof(double));
    pma_coupler_release(self);
    return failed ? NULL : Py_NewRef(Py_None);
}

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
    pma_load load;
    PyObject *arrays = pma_take_load(obj, parts->motions[i].load.n, false, &load), *old = NULL;
    const bool fits = arrays && !pma_load_has(&load, PMA_LOAD_CALLED);
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

/* ---- what iterations keep ------------------------------------------------------------------- */

PyObject *pma_subdomain_iteration(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    pma_iterate *it = pma_subdomain_iterate(self->core);
    bool twice;
    if (!it)
        Py_RETURN_NONE;
    if (!pma_subdomain_claim(self))
        return NULL;
    const double *kept = pma_iterate_kept(it, &twice);
    const double scale = pma_iterate_scale(it);
    PyObject *entries =
        kept ? pma_new_vector((npy_intp)pma_iterate_entries(it), kept) : Py_NewRef(Py_None);
    pma_subdomain_release(self);
    return entries ? Py_BuildValue("(dNO)", scale, entries, twice ? Py_True : Py_False) : NULL;
}

PyObject *pma_subdomain_set_iteration(SubdomainObject *self, PyObject *args)
{
    PyObject *entries;
    const double *kept = NULL;
    double scale;
    int twice;
    pma_iterate *it = pma_subdomain_iterate(self->core);
    if (!PyArg_ParseTuple(args, "dOp", &scale, &entries, &twice))
        return NULL;
    if (!it)
        return PyErr_Format(PyExc_ValueError, "the subdomain is not iterated");
    if (entries != Py_None &&
        pma_take_doubles(entries, (npy_intp)pma_iterate_entries(it), "entries", NULL, &kept) < 0)
        return NULL;
    if (!pma_subdomain_claim(self))
        return NULL;
    pma_caller before = pma_gil_release(); /* factors as in a step */
    const pma_status status = pma_iterate_restore(it, scale, kept, twice);
    pma_gil_acquire(before);
    pma_subdomain_release(self);
    return status == PMA_OK ? Py_NewRef(Py_None) : pma_raise(status, "entries");
}
