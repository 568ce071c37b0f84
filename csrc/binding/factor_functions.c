/* The symbolic and numeric factorization, as functions of the module. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "factor/elimination.h"
#include "factor/symbolic.h"
#include "factor/trapezoid.h"
#include "workers/team.h"
#include "workers/thread.h"

/* ---- patterns -------------------------------------------------------------------------------- */

typedef struct {
    size_t n;
    const int64_t *ptr;
    const int32_t *index;
} pattern;

static int take_pattern(PyObject *ptr_obj, PyObject *index_obj, pattern *out)
{
    npy_intp starts = -1;
    if (pma_take_vector(ptr_obj, NPY_INT64, &starts, "ptr", NULL, &out->ptr) < 0)
        return -1;
    if (starts == 0)
        return pma_refuse(PyExc_ValueError, "ptr must not be empty");
    out->n = (size_t)starts - 1;
    npy_intp entries = out->ptr[out->n] < 0 ? 0 : (npy_intp)out->ptr[out->n];
    if (pma_take_vector(index_obj, NPY_INT32, &entries, "index", NULL, &out->index) < 0)
        return -1;
    const pma_matrix A = {.form = PMA_SPARSE, .n = out->n, .ptr = out->ptr, .index = out->index};
    if (pma_matrix_check(&A) == PMA_OK)
        return 0;
    pma_raise(PMA_BAD_INDEX, "pattern");
    return -1;
}

static int take_pattern_and_border(PyObject *args, pattern *out, Py_ssize_t *nb)
{
    PyObject *ptr, *index;
    if (!PyArg_ParseTuple(args, "OOn", &ptr, &index, nb) || take_pattern(ptr, index, out) < 0)
        return -1;
    if (*nb >= 0 && (size_t)*nb <= out->n)
        return 0;
    return pma_refuse(PyExc_ValueError, "nb must lie in 0..n");
}

static PyObject *count_factor(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *ptr, *index, *array;
    pattern A;
    int64_t *count;
    if (!PyArg_ParseTuple(args, "OO", &ptr, &index) || take_pattern(ptr, index, &A) < 0)
        return NULL;
    int64_t *scratch = PyMem_Calloc(5 * A.n + 1, sizeof *scratch);
    if (!scratch)
        return PyErr_NoMemory();
    array = pma_new_array((npy_intp)A.n, NPY_INT64, &count);
    if (array) {
        pma_caller before = pma_gil_release();
        pma_symbolic_count(A.n, A.ptr, A.index, scratch, scratch + A.n, count);
        pma_gil_acquire(before);
    }
    PyMem_Free(scratch);
    return array;
}

static PyObject *postorder(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *array;
    pattern A;
    Py_ssize_t nb;
    int64_t *order;
    if (take_pattern_and_border(args, &A, &nb) < 0)
        return NULL;
    int64_t *scratch = PyMem_Calloc(6 * A.n + 1, sizeof *scratch);
    if (!scratch)
        return PyErr_NoMemory();
    array = pma_new_array((npy_intp)A.n, NPY_INT64, &order);
    if (array) {
        int64_t *parent = scratch, *count = scratch + A.n, *rest = scratch + 2 * A.n;
        pma_caller before = pma_gil_release();
        pma_symbolic_count(A.n, A.ptr, A.index, parent, rest, count);
        pma_symbolic_postorder(A.n, (size_t)nb, parent, count, rest, order);
        pma_gil_acquire(before);
    }
    PyMem_Free(scratch);
    return array;
}

/* ---- graphs ---------------------------------------------------------------------------------- */

static int take_groups(PyObject *group_obj, size_t n, Py_ssize_t groups, const int32_t **out)
{
    npy_intp length = (npy_intp)n;
    if (pma_take_vector(group_obj, NPY_INT32, &length, "group", NULL, out) < 0)
        return -1;
    bool right = groups >= 0 && groups <= INT32_MAX;
    for (size_t i = 0; right && i < n; i++)
        right = (*out)[i] >= 0 && (*out)[i] < groups;
    if (!right)
        PyErr_SetString(PyExc_ValueError, "group must lie in 0..groups-1");
    return right ? 0 : -1;
}

/* Scratch: integers 4 (groups + 1), indices n + 2 ptr[n]. */
static PyObject *new_graph(const pattern *A, size_t groups, const int32_t *group, int64_t *integers,
                           int32_t *indices)
{
    int64_t *ptr, *list_ptr = integers, *other_ptr = integers + groups + 1;
    int64_t *start = integers + 2 * (groups + 1), *mark = integers + 3 * (groups + 1);
    int32_t *list = indices + A->n, *other = list + A->ptr[A->n];
    int32_t *index;
    PyObject *graph[2] = {pma_new_array((npy_intp)(groups + 1), NPY_INT64, &ptr), NULL};
    if (!graph[0])
        return NULL;
    pma_caller before = pma_gil_release();
    pma_symbolic_merge(A->n, A->ptr, A->index, groups, group, start, indices, mark, list_ptr, list);
    pma_symbolic_transpose(groups, list_ptr, list, other_ptr, other);
    pma_symbolic_transpose(groups, other_ptr, other, list_ptr, list);
    pma_symbolic_unite(groups, list_ptr, list, other_ptr, other, ptr, NULL);
    pma_gil_acquire(before);
    graph[1] = pma_new_array((npy_intp)ptr[groups], NPY_INT32, &index);
    if (graph[1]) {
        before = pma_gil_release();
        pma_symbolic_unite(groups, list_ptr, list, other_ptr, other, ptr, index);
        pma_gil_acquire(before);
    }
    return pma_pack(2, graph);
}

static PyObject *graph_of_groups(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *ptr, *index, *group_obj, *graph = NULL;
    Py_ssize_t groups;
    pattern A;
    const int32_t *group;
    if (!PyArg_ParseTuple(args, "OOOn", &ptr, &index, &group_obj, &groups) ||
        take_pattern(ptr, index, &A) < 0 || take_groups(group_obj, A.n, groups, &group) < 0)
        return NULL;
    const size_t entries = (size_t)A.ptr[A.n];
    int64_t *integers = PyMem_Malloc(4 * ((size_t)groups + 1) * sizeof *integers);
    int32_t *indices = PyMem_Malloc((A.n + 2 * entries + 1) * sizeof *indices);
    if (integers && indices)
        graph = new_graph(&A, (size_t)groups, group, integers, indices);
    else
        PyErr_NoMemory();
    PyMem_Free(integers);
    PyMem_Free(indices);
    return graph;
}

/* ---- supernodes ------------------------------------------------------------------------------ */

/* The arrays of the structure, once the supernodes are known; scratch: 3 n. */
static PyObject *new_structure(const pattern *A, size_t s, const int64_t *columns,
                               const int64_t *count, int64_t *scratch)
{
    int64_t *first, *row_ptr, *start, *owner;
    PyObject *arrays[5] = {pma_new_array((npy_intp)(s + 1), NPY_INT64, &first),
                           pma_new_array((npy_intp)(s + 1), NPY_INT64, &row_ptr), NULL,
                           pma_new_array((npy_intp)(s + 1), NPY_INT64, &start),
                           pma_new_array((npy_intp)A->n, NPY_INT64, &owner)};
    if (arrays[0] && arrays[1] && arrays[3] && arrays[4]) {
        memcpy(first, columns, (s + 1) * sizeof *first);
        pma_symbolic_lay_out(s, first, count, row_ptr, start);
        npy_intp length = (npy_intp)row_ptr[s];
        arrays[2] = PyArray_ZEROS(1, &length, NPY_INT32, 0);
    }
    if (arrays[2]) {
        int32_t *rows = PyArray_DATA((PyArrayObject *)arrays[2]);
        pma_status status;
        pma_caller before = pma_gil_release();
        status = pma_symbolic_rows(A->n, A->ptr, A->index, s, first, row_ptr, owner, scratch,
                                   scratch + A->n, scratch + 2 * A->n, rows);
        pma_gil_acquire(before);
        if (status != PMA_OK) {
            pma_raise(status, "supernodes");
            Py_CLEAR(arrays[2]);
        }
    }
    return pma_pack(5, arrays);
}

static PyObject *supernodes(PyObject *Py_UNUSED(module), PyObject *args)
{
    pattern A;
    Py_ssize_t nb;
    if (take_pattern_and_border(args, &A, &nb) < 0)
        return NULL;
    int64_t *scratch = PyMem_Calloc(7 * A.n + 2, sizeof *scratch);
    if (!scratch)
        return PyErr_NoMemory();
    int64_t *parent = scratch, *count = scratch + A.n, *first = scratch + 2 * A.n;
    int64_t *rest = scratch + 3 * A.n + 1;
    size_t s;
    pma_caller before = pma_gil_release();
    pma_symbolic_count(A.n, A.ptr, A.index, parent, rest, count);
    s = pma_symbolic_supernodes(A.n, (size_t)nb, parent, count, rest, first);
    pma_gil_acquire(before);
    PyObject *structure = new_structure(&A, s, first, count, rest);
    PyMem_Free(scratch);
    return structure;
}

/* ---- numbers --------------------------------------------------------------------------------- */

static void work(void *ctx, size_t worker)
{
    pma_elimination_work(ctx, worker);
}

static void look(void *ctx)
{
    pma_elimination_look(ctx);
}

void pma_work_together(pma_team *team, pma_work work, void (*look)(void *ctx), void *ctx)
{
    const size_t others = pma_team_gather(team) == PMA_OK ? pma_team_workers(team) - 1 : 0;
    for (size_t w = 1; w <= others; w++)
        pma_team_post(team, w, work, ctx);
    work(ctx, 0);
    for (size_t w = 1; w <= others; w++)
        pma_team_await(team, w, look, ctx);
}

static void work_together(void *ctx, pma_elimination *e)
{
    pma_work_together(ctx, work, look, e);
}

int pma_take_crew(Py_ssize_t threads, pma_team **team, pma_crew *out)
{
    if (threads < 1)
        return pma_refuse(PyExc_ValueError, "threads must be at least 1, got %zd", threads);
    if (threads == 1)
        return 0;
    const pma_status status = pma_team_create((size_t)threads, team);
    if (pma_check(status, "threads") < 0)
        return -1;
    *out = (pma_crew){
        .workers = (size_t)threads, .work = work_together, .rest = pma_thread_rest, .ctx = *team};
    return 0;
}

static pma_status run_factor(const pma_panels_input *A, pma_elimination *e, pma_team *team,
                             double *inverse, size_t *column)
{
    pma_watch watch = {.last = pma_watch_milliseconds()};
    const pma_patience patience = {
        .stop = pma_watch_signals, .rest = pma_thread_rest, .ctx = &watch};
    pma_caller before = pma_gil_release();
    pma_elimination_begin(e, A, inverse, &patience);
    work_together(team, e);
    const pma_status status = pma_elimination_end(e, column);
    pma_gil_acquire(before);
    return status;
}

/* The same with its scratch; PMA_NO_MEMORY if that cannot be allocated. */
static pma_status factor(const pma_panels *p, const pma_panels_input *A, const int64_t *owner,
                         const pma_blas *blas, size_t workers, double *inverse, size_t *column)
{
    pma_elimination *e = NULL;
    pma_team *team = NULL;
    pma_status status = pma_elimination_create(p, A->n, owner, blas, workers, &e);
    if (status == PMA_OK)
        status = pma_team_create(workers, &team);
    if (status == PMA_OK)
        status = run_factor(A, e, team, inverse, column);
    pma_team_destroy(team);
    pma_elimination_destroy(e);
    return status;
}

/* What is factored, checked; where the panels are written, with R and, unsymmetric, Q after it */
static int take_problem(PyObject *pattern_obj, PyObject *entries, PyObject *values, npy_intp n,
                        PyObject *arrays, pma_numeric_parts *parts, pma_panels_input *A)
{
    if (pma_take_numeric(pattern_obj, n, arrays, parts) < 0 ||
        pma_take_doubles(entries, (npy_intp)parts->ptr[n], "entries", arrays, &A->values) < 0)
        return -1;
    pma_panels *p = &parts->panels;
    const pma_matrix pattern = {
        .form = PMA_SPARSE, .n = parts->n, .ptr = parts->ptr, .index = parts->index};
    if (!p->first || pma_matrix_check(&pattern) != PMA_OK ||
        pma_panels_check(p, parts->n, 0) != PMA_OK ||
        pma_panels_check_owners(p, parts->n, parts->owner) != PMA_OK) {
        pma_raise(PMA_BAD_INDEX, "structure");
        return -1;
    }
    const npy_intp size = (npy_intp)p->start[p->count], shape[2] = {2, size};
    PyArrayObject *panels;
    if (pma_take_output(values, parts->unsymmetric ? 2 : 1, parts->unsymmetric ? shape : shape + 1,
                        "values", &panels) < 0)
        return -1;
    p->values = PyArray_DATA(panels);
    p->Q = parts->unsymmetric ? (size_t)size : 0;
    A->n = parts->n;
    A->ptr = parts->ptr;
    A->index = parts->index;
    return 0;
}

/* Fills values, of R and after it of Q, and inverse */
static PyObject *factor_panels(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *pattern_obj, *entries, *values, *inverse_obj, *result = NULL;
    pma_panels_input A = {.indefinite = false};
    pma_numeric_parts parts;
    PyArrayObject *inverse;
    npy_intp n = -1;
    size_t column = 0;
    Py_ssize_t threads;
    if (!PyArg_ParseTuple(args, "OOOOddn", &pattern_obj, &entries, &values, &inverse_obj, &A.lost,
                          &A.growth, &threads))
        return NULL;
    if (threads < 1 || (size_t)threads > PMA_MOST_WORKERS)
        return PyErr_Format(PyExc_ValueError, "threads must lie in 1..1024");
    PyObject *arrays = PyList_New(0);
    if (!arrays || pma_take_output(inverse_obj, 1, &n, "inverse", &inverse) < 0 ||
        take_problem(pattern_obj, entries, values, PyArray_DIM(inverse, 0), arrays, &parts, &A) < 0)
        goto done;
    const pma_status status = factor(&parts.panels, &A, parts.owner, &parts.blas, (size_t)threads,
                                     PyArray_DATA(inverse), &column);
    if (status == PMA_OK)
        result = Py_NewRef(Py_None);
    else if (status == PMA_NOT_DEFINITE)
        result = PyLong_FromSize_t(column);
    else
        pma_raise(status, "factor_panels");
done:
    Py_XDECREF(arrays);
    return result;
}

/* ---- dense ----------------------------------------------------------------------------------- */

/* R (n, n) of A in place, by columns, zero above the diagonal; n, or the column whose pivot is
 * refused */
static size_t factor_in_place(size_t n, double *R, double *inverse, double lost,
                              const pma_blas *blas)
{
    for (size_t j = 0; j < n; j++)
        inverse[j] = R[j * n + j];
    const size_t good = pma_trapezoid_factor(R, n, n, inverse, lost, false, blas);
    if (good < n)
        return good;
    pma_trapezoid_scale(R, n, n, inverse);
    for (size_t j = 1; j < n; j++)
        memset(R + j * n, 0, j * sizeof *R);
    return n;
}

static PyObject *factor_dense(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *A_obj, *dgemm, *dtrsm, *R_obj = NULL, *inverse_obj = NULL, *result = NULL;
    double lost, *inverse;
    pma_blas blas;
    if (!PyArg_ParseTuple(args, "OdOO", &A_obj, &lost, &dgemm, &dtrsm) ||
        pma_take_blas(dgemm, dtrsm, &blas) < 0)
        return NULL;
    R_obj = PyArray_FROMANY(A_obj, NPY_DOUBLE, 2, 2, NPY_ARRAY_CARRAY | NPY_ARRAY_ENSURECOPY);
    if (!R_obj)
        return NULL;
    PyArrayObject *R = (PyArrayObject *)R_obj;
    const npy_intp n = PyArray_DIM(R, 0);
    if (PyArray_DIM(R, 1) != n)
        (void)pma_refuse(PyExc_ValueError, "A must be square");
    else
        inverse_obj = pma_new_array(n, NPY_DOUBLE, &inverse);
    if (inverse_obj) {
        pma_caller before = pma_gil_release();
        const size_t good = factor_in_place((size_t)n, PyArray_DATA(R), inverse, lost, &blas);
        pma_gil_acquire(before);
        result = good == (size_t)n ? Py_BuildValue("OOO", inverse_obj, R_obj, Py_None)
                                   : Py_BuildValue("OOn", inverse_obj, R_obj, (Py_ssize_t)good);
    }
    Py_DECREF(R_obj);
    Py_XDECREF(inverse_obj);
    return result;
}

/* ---- sweeps ---------------------------------------------------------------------------------- */

static PyObject *solve_checked(const pma_factor *factor, const double *b)
{
    double *work = PyMem_Malloc((pma_factor_scratch(factor) + 1) * sizeof *work);
    PyObject *x = work ? pma_new_vector((npy_intp)factor->n, b) : PyErr_NoMemory();
    if (x) {
        pma_caller before = pma_gil_release();
        pma_factor_solve(factor, PyArray_DATA((PyArrayObject *)x), work);
        pma_gil_acquire(before);
    }
    PyMem_Free(work);
    return x;
}

static PyObject *solve(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *factor_obj, *b_obj;
    npy_intp n = -1;
    const double *b;
    pma_factor factor;
    if (!PyArg_ParseTuple(args, "OO", &factor_obj, &b_obj) ||
        pma_take_vector(b_obj, NPY_DOUBLE, &n, "b", NULL, &b) < 0 ||
        pma_take_factor(factor_obj, n, &factor) < 0)
        return NULL;
    const pma_status status = pma_factor_check(&factor);
    return status == PMA_OK ? solve_checked(&factor, b) : pma_raise(status, "factor");
}

/* G_k = L_b S^-1 L_b^T e_k for all k, (p, p) by columns                                     (F6) */
static PyObject *compliance_checked(const pma_factor *f, const pma_link *L)
{
    const npy_intp sides[2] = {(npy_intp)L->p, (npy_intp)L->p};
    double *work = PyMem_Calloc(pma_factor_scratch(f) + f->nb + L->p + 1, sizeof *work);
    double *x = work + pma_factor_scratch(f), *unit = x + f->nb;
    PyObject *G = work ? PyArray_ZEROS(2, sides, NPY_DOUBLE, 1) : PyErr_NoMemory();
    if (G) {
        double *values = PyArray_DATA((PyArrayObject *)G);
        pma_caller before = pma_gil_release();
        for (size_t k = 0; k < L->p; k++) {
            unit[k] = 1.0;
            pma_link_load(L, unit, x);
            unit[k] = 0.0;
            pma_factor_interface(f, x, work);
            pma_link_gather(L, 1.0, x, values + k * L->p);
        }
        pma_gil_acquire(before);
    }
    PyMem_Free(work);
    return G;
}

static PyObject *compliance(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *factor, *link;
    Py_ssize_t n, nb;
    pma_factor f;
    pma_link L;
    if (!PyArg_ParseTuple(args, "OOnn", &factor, &link, &n, &nb))
        return NULL;
    if (nb < 0 || nb > n)
        return PyErr_Format(PyExc_ValueError, "nb must lie in 0..n");
    if (pma_take_bordered(factor, link, n, nb, &f, &L) < 0)
        return NULL;
    const pma_status factor_status = pma_factor_check(&f), link_status = pma_link_check(&L);
    if (factor_status != PMA_OK)
        return pma_raise(factor_status, "factor");
    return link_status == PMA_OK ? compliance_checked(&f, &L) : pma_raise(link_status, "link");
}

PyMethodDef pma_factor_functions[] = {
    {"graph_of_groups", graph_of_groups, METH_VARARGS,
     "graph_of_groups(ptr, index, group, groups) -> (ptr, index), symmetric, without loops"},
    {"count_factor", count_factor, METH_VARARGS,
     "count_factor(ptr, index) -> entries of the factor below the diagonal, column by column"},
    {"postorder", postorder, METH_VARARGS,
     "postorder(ptr, index, nb) -> order in which subtrees are contiguous; the last nb stay last"},
    {"supernodes", supernodes, METH_VARARGS,
     "supernodes(ptr, index, nb) -> (first, row_ptr, rows, start, owner)"},
    {"factor_panels", factor_panels, METH_VARARGS,
     "factor_panels(pattern, entries, values, inverse, lost, growth, threads) -> None, or the "
     "column whose pivot is refused"},
    {"factor_dense", factor_dense, METH_VARARGS,
     "factor_dense(A, lost, dgemm, dtrsm) -> (inverse, R by columns, None or a column)"},
    {"compliance", compliance, METH_VARARGS,
     "compliance(factor, link, n, nb) -> L_b S^-1 L_b^T of the last nb unknowns, (p, p)"},
    {"solve", solve, METH_VARARGS, "solve(factor, b) -> A^-1 b, (n,)"},
    {NULL, NULL, 0, NULL},
};
