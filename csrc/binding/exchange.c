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
    double *buffer;
    size_t size; /* of `all` */
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
    memcpy(x->buffer, all + starts[x->parts.rank], (size_t)count * sizeof(double));
    return x->address(x->buffer, count, x->type, all, counts, starts, x->type, x->communicator) ==
           0;
}

/* ---- its fields ----------------------------------------------------------------------------- */

static pma_status take_remote(const pma_field *f, pma_remote **out)
{
    const pma_field nb = pma_field_at(f, "nb"), substeps = pma_field_at(f, "substeps");
    const pma_field h = pma_field_at(f, "h"), doubled = pma_field_at(f, "doubled");
    const pma_field continues = pma_field_at(f, "continues"),
                    has_internal = pma_field_at(f, "has_internal");
    const pma_field link = pma_field_at(f, "link"), rows = pma_field_at(f, "rows");
    pma_remote_parts parts = {.iterates = !pma_field_is_none(&rows)};
    const void *data = NULL;
    size_t dofs;
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_count(&nb, 0, &dofs));
    PMA_TRY(pma_field_count(&substeps, 1, &parts.substeps));
    PMA_TRY(pma_field_real(&h, &parts.h));
    PMA_TRY(pma_field_flag(&doubled, &parts.doubled));
    PMA_TRY(pma_field_flag(&continues, &parts.continues));
    PMA_TRY(pma_field_flag(&has_internal, &parts.has_internal));
    PMA_TRY(pma_parts_link(&link, dofs, &parts.link));
    if (parts.iterates)
        PMA_TRY(pma_field_vector(&rows, PMA_INT64S, &parts.count, &data));
    parts.rows = data;
    return pma_remote_create(&parts, out);
}

/* Remote subdomains, of which None stands for one of this process. */
static pma_status take_remotes(const pma_field *f, pma_processes *x)
{
    PMA_TRY(pma_field_tuple(f, &x->count));
    x->remotes = PyMem_Calloc(x->count + 1, sizeof(pma_remote *));
    if (!x->remotes)
        return PMA_NO_MEMORY;
    for (size_t i = 0; i < x->count; i++) {
        const pma_field remote = pma_field_item(f, i);
        if (!pma_field_is_none(&remote))
            PMA_TRY(take_remote(&remote, &x->remotes[i]));
    }
    return PMA_OK;
}

/* {address, type, communicator}, or a callable */
static pma_status take_gather(const pma_field *f, pma_processes *x)
{
    const pma_field address = pma_field_at(f, "address"), type = pma_field_at(f, "type");
    const pma_field communicator = pma_field_at(f, "communicator");
    int64_t values[3];
    x->parts.ctx = x;
    x->parts.gather = gather_by_callable;
    if (f->node->kind == PMA_FOREIGN) {
        PMA_TRY(pma_field_find(f, PMA_OBJECT_ROLE, (void *)&x->callable));
        return PyCallable_Check(x->callable) ? PMA_OK : pma_field_refuse(f, "must be callable");
    }
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(pma_field_integer(&address, INTPTR_MIN, &values[0]));
    PMA_TRY(pma_field_integer(&type, INTPTR_MIN, &values[1]));
    PMA_TRY(pma_field_integer(&communicator, INTPTR_MIN, &values[2]));
    PMA_TRY(pma_field_allocate(f, x->size, sizeof *x->buffer, (void *)&x->buffer));
    const intptr_t function = (intptr_t)values[0];
    memcpy(&x->address, &function, sizeof function);
    x->type = (intptr_t)values[1];
    x->communicator = (intptr_t)values[2];
    x->parts.gather = gather_by_address;
    return PMA_OK;
}

static pma_status take_numbers(const pma_field *f, pma_processes *x)
{
    const pma_field first = pma_field_at(f, "first"), all = pma_field_at(f, "all");
    const pma_field counts = pma_field_at(f, "counts"), starts = pma_field_at(f, "starts");
    const pma_field rank = pma_field_at(f, "rank");
    pma_exchange_parts *parts = &x->parts;
    const int32_t *ints[2] = {NULL};
    const void *data = NULL;
    int64_t size = -1;
    PMA_TRY(pma_field_vector(&first, PMA_INT64S, &parts->ranks, &data));
    parts->first = data;
    if (parts->ranks-- < 2)
        return pma_field_refuse(&first, "must have a range for each rank");
    PMA_TRY(pma_field_count(&rank, 0, &parts->rank));
    if (parts->rank >= parts->ranks)
        return pma_field_refuse(&rank, "must be one of the ranks");
    PMA_TRY(pma_field_ints(&counts, parts->ranks, &ints[0]));
    PMA_TRY(pma_field_ints(&starts, parts->ranks, &ints[1]));
    PMA_TRY(pma_field_output(&all, 1, &size, &parts->all));
    parts->counts = (int *)(uintptr_t)ints[0];
    parts->starts = (int *)(uintptr_t)ints[1];
    x->size = (size_t)size;
    for (size_t r = 0; r < parts->ranks; r++) {
        if (parts->first[r] < 0 || parts->first[r] > parts->first[r + 1])
            return pma_field_refuse(&first, "must rise");
    }
    return PMA_OK;
}

static pma_status take(const pma_field *f, pma_processes *x)
{
    const pma_field remotes = pma_field_at(f, "remotes"), gather = pma_field_at(f, "gather");
    PMA_TRY(pma_field_dict(f));
    PMA_TRY(take_remotes(&remotes, x));
    PMA_TRY(take_numbers(f, x));
    return take_gather(&gather, x);
}

int pma_take_processes(PyObject *obj, PyObject *arrays, pma_processes **out)
{
    pma_argument arg;
    *out = NULL;
    if (obj == Py_None)
        return 0;
    *out = PyMem_Calloc(1, sizeof **out);
    if (!*out)
        return pma_check(PMA_NO_MEMORY, NULL);
    const pma_field root = pma_read(&arg, obj, "processes", arrays);
    return pma_end(&arg, take(&root, *out));
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
    if (!x || pma_exchange_size(x->parts.ranks, x->count, members) <= x->size)
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
