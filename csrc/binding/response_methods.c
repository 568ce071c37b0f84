/* Methods of Subdomain that set-up calls: its compliance and its unit responses. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <stdatomic.h>

#include "subdomain/cases.h"
#include "workers/team.h"

/* ---- compliance --------------------------------------------------------------------------- */

/* out (k, k): compliance between the constraints in `rows` (k) */
static void fill_compliance(pma_subdomain *s, bool twice, const int64_t *rows, npy_intp k,
                            double *lam, double *sum, double *out)
{
    const pma_member member = pma_subdomain_member(s);
    for (npy_intp c = 0; c < k; c++) {
        memset(sum, 0, member.link->p * sizeof(double));
        lam[rows[c]] = 1.0;
        pma_member_compliance(&member, twice, lam, sum);
        lam[rows[c]] = 0.0;
        for (npy_intp r = 0; r < k; r++)
            out[r * k + c] = sum[rows[r]];
    }
}

PyObject *pma_subdomain_compliance(SubdomainObject *self, PyObject *args)
{
    int twice;
    PyObject *obj, *out;
    const int64_t *rows;
    size_t k;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    if (!PyArg_ParseTuple(args, "pO", &twice, &obj) ||
        pma_take_positions(obj, parts->link.p, "rows", NULL, &k, &rows) < 0)
        return NULL;
    if (twice && !parts->doubled)
        return PyErr_Format(PyExc_ValueError, "the subdomain takes no double steps");
    const npy_intp shape[2] = {(npy_intp)k, (npy_intp)k};
    double *scratch = PyMem_Calloc(2 * parts->link.p + 1, sizeof(double));
    if (!scratch)
        return PyErr_NoMemory();
    out = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    if (out && pma_subdomain_claim(self)) {
        pma_caller before = pma_gil_release();
        fill_compliance(self->core, twice, rows, shape[0], scratch, scratch + parts->link.p,
                        PyArray_DATA((PyArrayObject *)out));
        pma_gil_acquire(before);
        pma_subdomain_release(self);
    } else {
        Py_CLEAR(out);
    }
    PyMem_Free(scratch);
    return out;
}

/* ---- unit responses (M3) ------------------------------------------------------------------ */

/* Inputs and outputs. */
typedef struct {
    const int64_t *rows; /* k */
    npy_intp k;
    double *end, *mean; /* k x k, each response a row */
    double *states;     /* k x 4 x n by rows, or NULL */
    bool twice;         /* of a double step */
    size_t threads;     /* at most */
} responses;

/* Those of the constraints begin..begin+count-1, which were taken together. */
static void copy_responses(const pma_unit_response *run, size_t n, npy_intp begin, npy_intp count,
                           const responses *b)
{
    for (npy_intp c = 0; c < count; c++) {
        for (npy_intp r = 0; r < b->k; r++) {
            b->end[(begin + c) * b->k + r] = pma_unit_response_end(run, (size_t)c, b->rows[r]);
            b->mean[(begin + c) * b->k + r] = pma_unit_response_mean(run, (size_t)c, b->rows[r]);
        }
        if (b->states)
            pma_unit_response_copy(run, (size_t)c, b->states + (size_t)(begin + c) * 4 * n);
    }
}

/* Several threads, each with a run of its own, which take PMA_LANES constraints one after
 * another. */
typedef struct {
    const pma_subdomain *of;
    const responses *b;
    size_t workers;
    pma_unit_response **runs; /* workers */
    atomic_size_t next;       /* block of constraints */
    atomic_bool stopped;      /* a signal has raised an exception */
    atomic_bool not_finite;   /* a response is not */
    pma_watch watch;          /* of worker 0, the thread that called */
} response_run;

static void look(void *ctx)
{
    response_run *r = ctx;
    if (!atomic_load(&r->stopped) && pma_watch_signals(&r->watch))
        atomic_store(&r->stopped, true);
}

static bool is_over(const response_run *r)
{
    return atomic_load(&r->stopped) || atomic_load(&r->not_finite);
}

static void run_responses(response_run *r, size_t worker, npy_intp begin)
{
    const pma_parts *parts = pma_subdomain_parts(r->of);
    pma_unit_response *run = r->runs[worker];
    const npy_intp left = r->b->k - begin, count = left < PMA_LANES ? left : PMA_LANES;
    pma_unit_response_begin(run, r->b->twice, (size_t)count, r->b->rows + begin);
    for (size_t j = 1; j <= parts->substeps; j++) {
        if (worker == 0)
            look(r);
        if (is_over(r))
            return;
        pma_unit_response_step(run, j);
    }
    if (pma_unit_response_is_finite(run))
        copy_responses(run, parts->n, begin, count, r->b);
    else
        atomic_store(&r->not_finite, true);
}

static void work(void *ctx, size_t worker)
{
    response_run *r = ctx;
    while (!is_over(r)) {
        const size_t begin = atomic_fetch_add(&r->next, 1) * PMA_LANES;
        if (begin >= (size_t)r->b->k)
            return;
        run_responses(r, worker, (npy_intp)begin);
    }
}

static pma_status create_runs(response_run *r)
{
    pma_status status = PMA_OK;
    r->runs = PyMem_Calloc(r->workers, sizeof(pma_unit_response *));
    if (!r->runs)
        return PMA_NO_MEMORY;
    for (size_t w = 0; w < r->workers && status == PMA_OK; w++)
        status = pma_unit_response_create(r->of, &r->runs[w]);
    return status;
}

/* PMA_STOPPED when a signal has raised an exception, PMA_NOT_FINITE for a response. */
static pma_status fill_responses(const pma_subdomain *s, const responses *b, size_t workers)
{
    response_run r = {.of = s, .b = b, .workers = workers};
    pma_team *team = NULL;
    pma_status status = create_runs(&r);
    if (status == PMA_OK)
        status = pma_team_create(workers, &team);
    if (status == PMA_OK) {
        r.watch = (pma_watch){.last = pma_watch_milliseconds()};
        pma_caller before = pma_gil_release();
        pma_work_together(team, work, look, &r);
        pma_gil_acquire(before);
    }
    pma_team_destroy(team);
    for (size_t w = 0; r.runs && w < workers; w++)
        pma_unit_response_destroy(r.runs[w]);
    PyMem_Free(r.runs);
    if (atomic_load(&r.stopped))
        return PMA_STOPPED;
    return atomic_load(&r.not_finite) ? PMA_NOT_FINITE : status;
}

static int take_responses(SubdomainObject *self, PyObject *args, responses *b)
{
    PyObject *rows, *end, *mean, *states;
    PyArrayObject *array;
    size_t k;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    int twice = 0;
    Py_ssize_t threads = 1;
    *b = (responses){.states = NULL};
    if (!PyArg_ParseTuple(args, "OOOO|pn", &rows, &end, &mean, &states, &twice, &threads) ||
        pma_take_positions(rows, parts->link.p, "rows", NULL, &k, &b->rows) < 0)
        return -1;
    if (threads < 1 || (size_t)threads > PMA_MOST_WORKERS)
        return pma_refuse(PyExc_ValueError, "threads must lie in 1..1024");
    b->k = (npy_intp)k;
    b->twice = twice;
    b->threads = (size_t)threads;
    if (!parts->has_responses || (twice && !parts->doubled))
        return pma_refuse(PyExc_ValueError, "the subdomain has no such link response");
    const npy_intp square[2] = {b->k, b->k}, cube[3] = {b->k, 4, (npy_intp)parts->n};
    if (pma_take_output(end, 2, square, "end", &array) < 0)
        return -1;
    b->end = PyArray_DATA(array);
    if (pma_take_output(mean, 2, square, "mean", &array) < 0)
        return -1;
    b->mean = PyArray_DATA(array);
    if (states == Py_None)
        return 0;
    if (pma_take_output(states, 3, cube, "states", &array) < 0)
        return -1;
    b->states = PyArray_DATA(array);
    return 0;
}

PyObject *pma_subdomain_unit_responses(SubdomainObject *self, PyObject *args)
{
    responses b;
    if (take_responses(self, args, &b) < 0 || !pma_subdomain_claim(self))
        return NULL;
    const size_t blocks = (size_t)(b.k + PMA_LANES - 1) / PMA_LANES;
    const size_t useful = blocks < 1 ? 1 : blocks;
    const size_t workers = b.threads < useful ? b.threads : useful;
    const pma_status status = fill_responses(self->core, &b, workers);
    pma_subdomain_release(self);
    if (status == PMA_NO_MEMORY)
        return PyErr_NoMemory();
    return status == PMA_STOPPED ? NULL : PyBool_FromLong(status == PMA_OK);
}

PyObject *pma_subdomain_store_responses(SubdomainObject *self, PyObject *obj)
{
    pma_argument arg;
    pma_unit_responses units;
    PyObject *arrays = PyList_New(0);
    if (!arrays)
        return NULL;
    const pma_field root = pma_read(&arg, obj, "responses", arrays);
    if (pma_end(&arg, pma_parts_responses(&root, pma_subdomain_parts(self->core), &units)) < 0 ||
        !pma_subdomain_claim(self)) {
        Py_DECREF(arrays);
        return NULL;
    }
    pma_response_store(pma_subdomain_response(self->core), units);
    pma_swap(&self->response, &arrays);
    pma_subdomain_release(self);
    Py_XDECREF(arrays);
    Py_RETURN_NONE;
}

PyObject *pma_subdomain_accelerate(SubdomainObject *self, PyObject *obj)
{
    const pma_parts *parts = pma_subdomain_parts(self->core);
    const double *lam;
    npy_intp n = (npy_intp)parts->n;
    if (pma_take_doubles(obj, (npy_intp)parts->link.p, "lam", NULL, &lam) < 0)
        return NULL;
    if (!parts->mean)
        return PyErr_Format(PyExc_ValueError, "the subdomain is not under mean coupling");
    PyObject *y = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (!y || !pma_subdomain_claim(self)) {
        Py_XDECREF(y);
        return NULL;
    }
    pma_subdomain_push(self->core, lam, PyArray_DATA((PyArrayObject *)y));
    pma_subdomain_release(self);
    return y;
}
