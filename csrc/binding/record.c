/* The arrays of a record, as the core writes into them. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "algebra/lists.h"

static int take_rows(PyObject *obj, npy_intp *rows, npy_intp columns, const char *name,
                     double **out)
{
    PyArrayObject *array;
    const npy_intp shape[2] = {*rows, columns};
    if (pma_take_output(obj, 2, shape, name, &array) < 0)
        return -1;
    *rows = PyArray_DIM(array, 0);
    *out = PyArray_DATA(array);
    return 0;
}

/* (spring, deformation, force) */
static int take_springs(PyObject *obj, npy_intp *rows, pma_selection *selection)
{
    PyObject *spring, *deformation, *force;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "springs must be None or a tuple of arrays");
    if (!PyArg_ParseTuple(obj, "OOO", &spring, &deformation, &force))
        return -1;
    if (pma_take_positions(spring, selection->of_springs, "spring", NULL, &selection->springs,
                           &selection->spring) < 0)
        return -1;
    const npy_intp count = (npy_intp)selection->springs;
    if (take_rows(deformation, rows, count, "deformation", &selection->deformation) < 0)
        return -1;
    return take_rows(force, rows, count, "force", &selection->force);
}

/* None or (start, position, weight), the rows of a matrix with `size` columns */
static int take_combination(PyObject *obj, size_t size, size_t rows, pma_combination *out)
{
    npy_intp starts = (npy_intp)rows + 1;
    size_t count;
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj) || PyTuple_Size(obj) != 3)
        return pma_refuse(PyExc_TypeError, "a combination must be None or a tuple of three arrays");
    if (pma_take_vector(PyTuple_GetItem(obj, 0), NPY_INT64, &starts, "start", NULL, &out->start) <
            0 ||
        pma_take_positions(PyTuple_GetItem(obj, 1), size, "position", NULL, &count,
                           &out->position) < 0 ||
        pma_take_doubles(PyTuple_GetItem(obj, 2), (npy_intp)count, "weight", NULL, &out->weight) <
            0)
        return -1;
    if (pma_are_starts(rows, out->start) && out->start[rows] == (int64_t)count)
        return 0;
    return pma_refuse(PyExc_ValueError, "start must rise from 0 to the number of weights");
}

/* (output, of_u, of_v, of_w) */
static int take_outputs(PyObject *obj, size_t size, npy_intp *rows, pma_selection *selection)
{
    PyObject *output, *of_u, *of_v, *of_w;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "outputs must be None or a tuple");
    if (!PyArg_ParseTuple(obj, "OOOO", &output, &of_u, &of_v, &of_w) ||
        take_rows(output, rows, -1, "output", &selection->output) < 0)
        return -1;
    selection->outputs = (size_t)PyArray_DIM((PyArrayObject *)output, 1);
    if (take_combination(of_u, size, selection->outputs, &selection->of_u) < 0 ||
        take_combination(of_v, size, selection->outputs, &selection->of_v) < 0)
        return -1;
    return take_combination(of_w, size, selection->outputs, &selection->of_w);
}

/* (corrections or None, q or None) */
static int take_history(PyObject *obj, const pma_parts *parts, npy_intp *rows,
                        pma_selection *selection)
{
    PyObject *corrections, *q;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "history must be None or a tuple");
    if (!PyArg_ParseTuple(obj, "OO", &corrections, &q))
        return -1;
    if (corrections != Py_None && !parts->iterate)
        return pma_refuse(PyExc_ValueError, "the subdomain is not iterated");
    if (corrections != Py_None &&
        take_rows(corrections, rows, 1, "iterations", &selection->corrections) < 0)
        return -1;
    if (q == Py_None)
        return 0;
    selection->history = selection->of_history;
    return take_rows(q, rows, (npy_intp)selection->history, "q", &selection->q);
}

/* None or (position, u, v, w, springs=None, outputs=None, history=None), with all rows that the
 * interval writes; springs are (spring, deformation, force) */
static int take_selection(PyObject *obj, const pma_parts *parts, size_t last_row,
                          pma_selection *selection)
{
    PyObject *position, *u, *v, *w, *springs = Py_None, *outputs = Py_None;
    PyObject *history = Py_None;
    npy_intp rows = -1;
    *selection =
        (pma_selection){.of_springs = parts->springs.total, .of_history = parts->internal.history};
    if (obj == Py_None)
        return 0;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "selections must be None or a tuple of arrays");
    if (!PyArg_ParseTuple(obj, "OOOO|OOO", &position, &u, &v, &w, &springs, &outputs, &history) ||
        pma_take_positions(position, parts->n, "position", NULL, &selection->count,
                           &selection->position) < 0)
        return -1;
    const npy_intp count = (npy_intp)selection->count;
    if (take_rows(u, &rows, count, "u", &selection->u) < 0 ||
        take_rows(v, &rows, count, "v", &selection->v) < 0 ||
        take_rows(w, &rows, count, "w", &selection->w) < 0)
        return -1;
    if (springs != Py_None && take_springs(springs, &rows, selection) < 0)
        return -1;
    if (history != Py_None && take_history(history, parts, &rows, selection) < 0)
        return -1;
    if (outputs != Py_None && take_outputs(outputs, parts->n, &rows, selection) < 0)
        return -1;
    if (rows >= 0 && (size_t)rows > last_row)
        return 0;
    return pma_refuse(PyExc_ValueError, "the record has too few rows");
}

/* The selection of a subdomain; in lanes a tuple of PMA_LANES of them, the others of which are in
 * `more` */
static int take_selections(PyObject *obj, SubdomainObject *s, size_t last, pma_selection *first,
                           pma_selection *more)
{
    const pma_parts *parts = pma_subdomain_parts(s->core);
    if (!s->of)
        return take_selection(obj, parts, last, first);
    if (!PyTuple_Check(obj) || PyTuple_Size(obj) != PMA_LANES)
        return pma_refuse(PyExc_TypeError, "selections in lanes must be tuples, one for each lane");
    pma_selection *selection = first;
    for (Py_ssize_t l = 0; l < PMA_LANES; l++) {
        if (take_selection(PyTuple_GetItem(obj, l), parts, last, selection) < 0)
            return -1;
        selection->next = l + 1 < PMA_LANES ? more + l : NULL;
        selection = more + l;
    }
    return 0;
}

/* The last row written by an interval up to macro step `end`, with `levels` time levels in a macro
 * step. */
static size_t last_row(const pma_record *record, int64_t end, size_t levels)
{
    if (record->ring)
        return (size_t)record->ring->size * (record->every == 0 ? levels : 1);
    if (record->every == 0) {
        const size_t steps = (size_t)(end - record->begin);
        return steps > SIZE_MAX / levels ? SIZE_MAX : steps * levels;
    }
    return (size_t)(end / record->every - record->begin / record->every);
}

/* None or (impulse, gap): rows of contacts */
static int take_contacts(CouplerObject *self, PyObject *obj, size_t last, pma_record *record)
{
    size_t rows;
    npy_intp count = -1;
    PyObject *impulse, *gap;
    if (obj == Py_None)
        return 0;
    (void)pma_coupler_contact_compliance(self->core, true, &rows);
    if (!PyArg_ParseTuple(obj, "OO", &impulse, &gap) ||
        take_rows(impulse, &count, (npy_intp)rows, "impulse", &record->contact_impulse) < 0 ||
        take_rows(gap, &count, (npy_intp)pma_coupler_contacts(self->core), "gap",
                  &record->contact_gap) < 0)
        return -1;
    if (rows > 0 && (size_t)count > last)
        return 0;
    return pma_refuse(PyExc_ValueError, "the record has too few rows, or no contacts");
}

static int take_interface(CouplerObject *self, PyObject *const *obj, int64_t end, size_t fine,
                          pma_record *record)
{
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    npy_intp rows = -1, macro_rows = -1;
    if (take_rows(obj[0], &rows, p, "multipliers", &record->multipliers) < 0 ||
        take_rows(obj[1], &rows, p, "velocity_jump", &record->velocity_jump) < 0 ||
        take_rows(obj[2], &macro_rows, p, "displacement_jump", &record->displacement_jump) < 0)
        return -1;
    if ((size_t)rows > last_row(record, end, fine) && (size_t)macro_rows > last_row(record, end, 1))
        return 0;
    return pma_refuse(PyExc_ValueError, "the record has too few rows");
}

/* None or an array (rows, subdomains, PMA_ENERGIES), if all subdomains sum their works */
static int take_energy(CouplerObject *self, PyObject *obj, int64_t end, pma_record *record)
{
    const npy_intp shape[3] = {-1, PyTuple_Size(self->subdomains), PMA_ENERGIES};
    PyArrayObject *array;
    bool all = true;
    if (obj == Py_None)
        return 0;
    if (pma_take_array(obj, NPY_DOUBLE, 3, shape, "energy", NULL, &array) < 0)
        return -1;
    for (npy_intp i = 0; i < shape[1]; i++)
        all = all && pma_subdomain_has_energy(pma_subdomain_of(self, i)->core);
    record->energy = PyArray_DATA(array);
    if (all && PyArray_ISWRITEABLE(array) &&
        (size_t)PyArray_DIM(array, 0) > last_row(record, end, 1))
        return 0;
    return pma_refuse(PyExc_ValueError, "energy must be writeable and have enough rows, "
                                        "after begin_energy of all subdomains");
}

/* (begin, every, (selection, ...), multipliers, velocity_jump, displacement_jump, energy=None,
 * contacts=None); the caller frees record->selections */
int pma_take_record(CouplerObject *self, PyObject *obj, int64_t end, pma_record *record)
{
    const Py_ssize_t count = PyTuple_Size(self->subdomains);
    long long begin, every;
    PyObject *selections, *interface[3], *energy = Py_None, *contacts = Py_None;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "a record must be a tuple");
    if (!PyArg_ParseTuple(obj, "LLO!OOO|OO", &begin, &every, &PyTuple_Type, &selections,
                          &interface[0], &interface[1], &interface[2], &energy, &contacts))
        return -1;
    if (begin < 0 || every < 0 || begin > pma_coupler_step_count(self->core) ||
        PyTuple_Size(selections) != count)
        return pma_refuse(PyExc_ValueError, "the record does not fit the coupler");
    record->begin = begin;
    record->every = every;
    record->ring = self->slots ? &self->ring : NULL;
    const size_t lanes = count > 0 && pma_subdomain_of(self, 0)->of ? PMA_LANES : 1;
    const size_t first = pma_processes_first(self->processes);
    const size_t all = pma_processes_count(self->processes, (size_t)count);
    record->selections = PyMem_Calloc(all * lanes + 1, sizeof *record->selections);
    if (!record->selections)
        return pma_check(PMA_NO_MEMORY, NULL);
    for (Py_ssize_t i = 0; i < count; i++) {
        SubdomainObject *s = pma_subdomain_of(self, i);
        const size_t last = last_row(record, end, pma_subdomain_parts(s->core)->substeps);
        pma_selection *more = record->selections + all + (size_t)i * (lanes - 1);
        if (take_selections(PyTuple_GetItem(selections, i), s, last,
                            &record->selections[first + (size_t)i], more) < 0)
            return -1;
    }
    const size_t fine = pma_coupler_instants(self->core);
    if (take_energy(self, energy, end, record) < 0 ||
        take_contacts(self, contacts, last_row(record, end, fine), record) < 0)
        return -1;
    return take_interface(self, interface, end, fine, record);
}
