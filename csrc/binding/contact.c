/* Contacts: what the core is given of them, and their part of the state of a Coupler. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- rows ----------------------------------------------------------------------------------- */

/* (member, N), N as link with `rows` rows on the interface dofs of the member */
static int take_side(CouplerObject *self, PyObject *obj, size_t rows, pma_contact_side *out)
{
    Py_ssize_t member;
    PyObject *N;
    if (!PyArg_ParseTuple(obj, "nO", &member, &N))
        return -1;
    if (member < 0 || member >= PyTuple_Size(self->subdomains))
        return pma_refuse(PyExc_ValueError, "contact: no subdomain %zd", member);
    const pma_parts *parts = pma_subdomain_parts(pma_subdomain_of(self, member)->core);
    out->member = (size_t)member;
    if (pma_take_link(N, parts->nb, self->arrays, &out->N) < 0)
        return -1;
    if (out->N.p == rows)
        return 0;
    return pma_refuse(PyExc_ValueError, "contact: the rows of a side do not agree");
}

static int take_rows(CouplerObject *self, PyObject *const *obj, pma_contact_parts *out)
{
    npy_intp starts = -1;
    if (pma_take_vector(obj[0], NPY_INT64, &starts, "first", self->arrays, &out->first) < 0)
        return -1;
    const npy_intp contacts = starts - 1;
    if (contacts < 1)
        return pma_refuse(PyExc_ValueError, "first must have at least two numbers");
    out->contacts = (size_t)contacts;
    if (pma_take_doubles(obj[1], contacts, "gap", self->arrays, &out->gap) < 0 ||
        pma_take_doubles(obj[2], contacts, "restitution", self->arrays, &out->restitution) < 0)
        return -1;
    return pma_take_doubles(obj[3], contacts, "friction", self->arrays, &out->friction);
}

int pma_take_contact(CouplerObject *self, PyObject *obj, pma_contact_parts *out,
                     pma_contact_side **sides)
{
    PyObject *rows[4], *list, *dgemm, *dtrsm;
    *out = (pma_contact_parts){.obstacle = {.kind = PMA_LOAD_NONE}};
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "contact must be None or a tuple");
    if (!PyArg_ParseTuple(obj, "OOOOO!OO", &rows[0], &rows[1], &rows[2], &rows[3], &PyTuple_Type,
                          &list, &dgemm, &dtrsm) ||
        take_rows(self, rows, out) < 0 || pma_take_blas(dgemm, dtrsm, &out->blas) < 0)
        return -1;
    out->sides = (size_t)PyTuple_Size(list);
    *sides = PyMem_Calloc(out->sides + 1, sizeof **sides);
    if (!*sides)
        return pma_check(PMA_NO_MEMORY, NULL);
    out->side = *sides;
    for (size_t i = 0; i < out->sides; i++) {
        PyObject *side = PyTuple_GetItem(list, (Py_ssize_t)i);
        if (take_side(self, side, (size_t)out->first[out->contacts], &(*sides)[i]) < 0)
            return -1;
    }
    return 0;
}

/* (inverse, alpha, beta, None or (ptr, index, values)) */
int pma_take_struck(PyObject *obj, size_t nb, PyObject *arrays, pma_struck *out)
{
    PyObject *inverse, *B;
    pma_link columns;
    *out = (pma_struck){.inverse = NULL};
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "struck must be None or a tuple");
    if (!PyArg_ParseTuple(obj, "OddO", &inverse, &out->alpha, &out->beta, &B) ||
        pma_take_doubles(inverse, (npy_intp)nb, "struck", arrays, &out->inverse) < 0)
        return -1;
    if (B == Py_None)
        return 0;
    if (pma_take_link(B, nb, arrays, &columns) < 0)
        return -1;
    out->ptr = columns.ptr;
    out->index = columns.index;
    out->values = columns.values;
    return 0;
}

/* ---- state ---------------------------------------------------------------------------------- */

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
    pma_load load = {.kind = PMA_LOAD_NONE, .n = 2 * pma_coupler_contacts(self->core)};
    PyObject *arrays = pma_take_load(obj, &load);
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
