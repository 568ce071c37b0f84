/* A coupler in several processes: subdomains of the others, and the function that gathers. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* MPI_Allgatherv. Handles are passed as integers: an MPI whose handles are int takes the low half
 * of the register, one whose handles are pointers all of it. */
typedef int (*allgatherv)(const void *send, int count, intptr_t type, void *receive,
                          const int *counts, const int *starts, intptr_t receive_type,
                          intptr_t communicator);

struct pma_processes {
    pma_remote **remotes;
    size_t count; /* of them */
    pma_exchange_parts parts;
    PyObject *callable; /* gathers, unless there is an address */
    allgatherv address;
    intptr_t type, communicator;
    double *sent;
    npy_intp size; /* of `all` */
};

/* ---- gathering ------------------------------------------------------------------------------ */

static int call(void *ctx)
{
    const pma_processes *x = ctx;
    PyObject *type, *value, *traceback;
    PyErr_Fetch(&type, &value, &traceback); /* what has failed here, if anything */
    PyObject *result = PyObject_CallNoArgs(x->callable);
    if (type)
        PyErr_Restore(type, value, traceback);
    Py_XDECREF(result);
    return result ? 0 : -1;
}

static bool gather_by_callable(void *ctx, double *all, const int *counts, const int *starts)
{
    (void)all, (void)counts, (void)starts; /* the callable has the same arrays */
    return pma_gil_call(call, ctx) == 0;
}

static bool gather_by_address(void *ctx, double *all, const int *counts, const int *starts)
{
    const pma_processes *x = ctx;
    const int count = counts[x->parts.rank];
    memcpy(x->sent, all + starts[x->parts.rank], (size_t)count * sizeof(double));
    return x->address(x->sent, count, x->type, all, counts, starts, x->type, x->communicator) == 0;
}

/* ---- what Python gives ---------------------------------------------------------------------- */

/* the constraints of a subdomain whose steps are iterated; None for another */
static int take_iterated(PyObject *obj, PyObject *arrays, pma_remote_parts *parts)
{
    npy_intp count = -1;
    if (obj == Py_None)
        return 0;
    if (pma_take_vector(obj, NPY_INT64, &count, "rows", arrays, &parts->rows) < 0)
        return -1;
    parts->iterates = true;
    parts->count = (size_t)count;
    return 0;
}

/* (nb, substeps, h, doubled, continues, shoots, link, rows) */
static int take_remote(PyObject *obj, PyObject *arrays, pma_remote **out)
{
    pma_remote_parts parts = {.iterates = false};
    Py_ssize_t nb, substeps;
    int doubled, continues, shoots;
    PyObject *link, *rows;
    if (!PyTuple_Check(obj))
        return pma_refuse(PyExc_TypeError, "a remote subdomain must be a tuple");
    if (!PyArg_ParseTuple(obj, "nndpppOO", &nb, &substeps, &parts.h, &doubled, &continues, &shoots,
                          &link, &rows))
        return -1;
    if (nb < 0 || substeps < 1)
        return pma_refuse(PyExc_ValueError, "a remote subdomain must have substeps");
    if (pma_take_link(link, (size_t)nb, arrays, &parts.link) < 0 ||
        take_iterated(rows, arrays, &parts) < 0)
        return -1;
    parts.substeps = (size_t)substeps;
    parts.doubled = doubled;
    parts.continues = continues;
    parts.shoots = shoots;
    const pma_status status = pma_remote_create(&parts, out);
    return pma_check(status, "remote");
}

/* Remote subdomains, of which None stands for one of this process. */
static int take_remotes(PyObject *obj, PyObject *arrays, pma_processes *x)
{
    const Py_ssize_t count = PyTuple_Size(obj);
    x->remotes = PyMem_Calloc((size_t)count + 1, sizeof *x->remotes);
    if (!x->remotes)
        return pma_check(PMA_NO_MEMORY, NULL);
    x->count = (size_t)count;
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *entry = PyTuple_GetItem(obj, i);
        if (entry != Py_None && take_remote(entry, arrays, &x->remotes[i]) < 0)
            return -1;
    }
    return 0;
}

/* a callable, or (address, type, communicator) */
static int take_gather(PyObject *obj, PyObject *arrays, npy_intp size, pma_processes *x)
{
    x->parts.ctx = x;
    if (PyCallable_Check(obj)) {
        x->callable = obj;
        x->parts.gather = gather_by_callable;
        return PyList_Append(arrays, obj);
    }
    Py_ssize_t address, type, communicator;
    if (!PyArg_Parse(obj, "(nnn)", &address, &type, &communicator))
        return -1;
    x->sent = pma_add_scratch(size, arrays);
    if (!x->sent)
        return -1;
    memcpy(&x->address, &address, sizeof address);
    x->type = type;
    x->communicator = communicator;
    x->parts.gather = gather_by_address;
    return 0;
}

static int take_buffers(PyObject *first, PyObject *all, PyObject *counts, PyObject *starts,
                        PyObject *arrays, pma_processes *x)
{
    npy_intp ranks = -1;
    if (pma_take_vector(first, NPY_INT64, &ranks, "first", arrays, &x->parts.first) < 0)
        return -1;
    bool fits = --ranks >= 1 && (npy_intp)x->parts.rank < ranks;
    x->size = -1;
    if (pma_take_vector(counts, NPY_INT, &ranks, "counts", arrays, &x->parts.counts) < 0 ||
        pma_take_vector(starts, NPY_INT, &ranks, "starts", arrays, &x->parts.starts) < 0 ||
        pma_take_vector(all, NPY_DOUBLE, &x->size, "all", arrays, &x->parts.all) < 0)
        return -1;
    x->parts.ranks = (size_t)ranks;
    for (npy_intp r = 0; fits && r < ranks; r++)
        fits = x->parts.first[r] >= 0 && x->parts.first[r] <= x->parts.first[r + 1];
    if (fits)
        return 0;
    return pma_refuse(PyExc_ValueError, "first must rise, with a range for each rank");
}

int pma_take_processes(PyObject *obj, PyObject *arrays, pma_processes **out)
{
    PyObject *remotes, *first, *all, *counts, *starts, *gather;
    Py_ssize_t rank;
    *out = NULL;
    if (obj == Py_None)
        return 0;
    if (!PyArg_Parse(obj, "(nO!OOOOO)", &rank, &PyTuple_Type, &remotes, &first, &all, &counts,
                     &starts, &gather))
        return -1;
    pma_processes *x = PyMem_Calloc(1, sizeof *x);
    if (!x)
        return pma_check(PMA_NO_MEMORY, NULL);
    *out = x;
    x->parts.rank = (size_t)rank;
    if (take_remotes(remotes, arrays, x) < 0 ||
        take_buffers(first, all, counts, starts, arrays, x) < 0)
        return -1;
    return take_gather(gather, arrays, x->size, x);
}

void pma_release_processes(pma_processes *x)
{
    for (size_t i = 0; x && i < x->count; i++)
        pma_remote_destroy(x->remotes[i]);
    if (x)
        PyMem_Free(x->remotes);
    PyMem_Free(x);
}

/* ---- for the coupler ------------------------------------------------------------------------ */

size_t pma_processes_count(const pma_processes *x, size_t own)
{
    return x ? x->count : own;
}

size_t pma_processes_first(const pma_processes *x)
{
    return x ? (size_t)x->parts.first[x->parts.rank] : 0;
}

const pma_exchange_parts *pma_processes_parts(const pma_processes *x)
{
    return x ? &x->parts : NULL;
}

int pma_processes_check(const pma_processes *x, const pma_member *members)
{
    if (!x || pma_exchange_size(x->parts.ranks, x->count, members) <= (size_t)x->size)
        return 0;
    return pma_refuse(PyExc_ValueError, "all must have room for the values of all ranks");
}

/* The members of this process are set; the others become so. */
int pma_processes_fill(const pma_processes *x, size_t own, pma_member *members)
{
    if (!x)
        return 0;
    const size_t first = pma_processes_first(x);
    bool fits = (size_t)x->parts.first[x->parts.rank + 1] == first + own;
    for (size_t i = 0; fits && i < x->count; i++) {
        const bool is_own = i >= first && i < first + own;
        fits = is_own == !x->remotes[i];
        if (x->remotes[i])
            members[i] = pma_remote_member(x->remotes[i]);
    }
    if (fits)
        return 0;
    return pma_refuse(PyExc_ValueError, "the remote subdomains must be those of the other ranks");
}
