/* Methods that read and write what belongs to the present, by the names of its arrays. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* {name: copy} */
static PyObject *copy_arrays(const pma_state_array *arrays, size_t count)
{
    PyObject *dict = PyDict_New();
    for (size_t i = 0; dict && i < count; i++) {
        PyObject *copy = pma_new_vector((npy_intp)arrays[i].count, arrays[i].values);
        if (!copy || PyDict_SetItemString(dict, arrays[i].name, copy) < 0)
            Py_CLEAR(dict);
        Py_XDECREF(copy);
    }
    return dict;
}

/* pma_parts_arrays or pma_parts_check_arrays */
typedef pma_status take_arrays(const pma_field *f, const pma_state_array *arrays, size_t count);

static int read_arrays(PyObject *obj, const char *name, const pma_state_array *arrays, size_t count,
                       take_arrays *take)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, name, NULL);
    return pma_end(&arg, take(&root, arrays, count));
}

/* ---- of a subdomain ------------------------------------------------------------------------- */

PyObject *pma_subdomain_object_levels(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    if (!pma_subdomain_claim(self))
        return NULL;
    PyObject *levels = copy_arrays(arrays, pma_subdomain_arrays(self->core, arrays));
    pma_subdomain_release(self);
    return levels;
}

PyObject *pma_subdomain_object_check_levels(SubdomainObject *self, PyObject *obj)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    if (!pma_subdomain_claim(self))
        return NULL;
    const size_t count = pma_subdomain_kept(self->core, arrays);
    const int failed = read_arrays(obj, "levels", arrays, count, pma_parts_check_arrays);
    pma_subdomain_release(self);
    return failed ? NULL : Py_NewRef(Py_None);
}

PyObject *pma_subdomain_object_set_levels(SubdomainObject *self, PyObject *obj)
{
    pma_state_array arrays[PMA_LEVEL_ARRAYS];
    if (!pma_subdomain_claim(self))
        return NULL;
    const size_t count = pma_subdomain_arrays(self->core, arrays);
    const int failed = read_arrays(obj, "levels", arrays, count, pma_parts_arrays);
    if (!failed)
        pma_subdomain_watch_again(self->core);
    pma_subdomain_release(self);
    return failed ? NULL : Py_NewRef(Py_None);
}

PyObject *pma_subdomain_iteration(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    const pma_iterate *it = pma_subdomain_iterate(self->core);
    if (!it)
        Py_RETURN_NONE;
    if (!pma_subdomain_claim(self))
        return NULL;
    const pma_kept_iteration kept = pma_iterate_kept(it);
    PyObject *entries = kept.entries
                            ? pma_new_vector((npy_intp)pma_iterate_entries(it), kept.entries)
                            : Py_NewRef(Py_None);
    pma_subdomain_release(self);
    return entries ? Py_BuildValue("{sdsNsO}", "scale", kept.scale, "entries", entries, "twice",
                                   kept.twice ? Py_True : Py_False)
                   : NULL;
}

PyObject *pma_subdomain_set_iteration(SubdomainObject *self, PyObject *obj)
{
    pma_argument arg;
    pma_kept_iteration kept;
    pma_iterate *it = pma_subdomain_iterate(self->core);
    if (!it)
        return PyErr_Format(PyExc_ValueError, "the subdomain is not iterated");
    const pma_field root = pma_read(&arg, obj, "iteration", NULL);
    pma_status status = pma_parts_kept(&root, it, &kept);
    if (status != PMA_OK || !pma_subdomain_claim(self)) {
        (void)pma_end(&arg, status);
        return NULL;
    }
    pma_caller before = pma_gil_release(); /* factors as in a step */
    status = pma_iterate_restore(it, kept);
    pma_gil_acquire(before);
    pma_subdomain_release(self);
    (void)pma_end(&arg, PMA_OK);
    return status == PMA_OK ? Py_NewRef(Py_None) : pma_raise(status, "entries");
}

/* ---- of a coupler --------------------------------------------------------------------------- */

PyObject *pma_coupler_object_numbers(CouplerObject *self, PyObject *Py_UNUSED(ignored))
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    if (pma_coupler_claim(self) < 0)
        return NULL;
    PyObject *numbers = copy_arrays(arrays, pma_coupler_arrays(self->core, arrays));
    pma_coupler_release(self);
    return numbers;
}

static PyObject *read_numbers(CouplerObject *self, PyObject *obj, take_arrays *take)
{
    pma_state_array arrays[PMA_COUPLER_ARRAYS];
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const size_t count = pma_coupler_arrays(self->core, arrays);
    const int failed = read_arrays(obj, "numbers", arrays, count, take);
    pma_coupler_release(self);
    return failed ? NULL : Py_NewRef(Py_None);
}

PyObject *pma_coupler_object_check_numbers(CouplerObject *self, PyObject *obj)
{
    return read_numbers(self, obj, pma_parts_check_arrays);
}

PyObject *pma_coupler_object_set_numbers(CouplerObject *self, PyObject *obj)
{
    return read_numbers(self, obj, pma_parts_arrays);
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
