/* What the core takes from the fields of an object. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* What one taker of the core takes from an object; the memory that it points into goes to `store`,
 * which may be NULL where there is none. */
typedef pma_status taker(const pma_field *f, size_t n, size_t nb, void *out);

static int take(PyObject *obj, const char *name, PyObject *arrays, pma_store *store, taker *take_it,
                size_t n, size_t nb, void *out)
{
    pma_fields fields;
    PyObject *borrowed = arrays ? Py_NewRef(arrays) : PyList_New(0);
    int failed = borrowed ? pma_read_tree(obj, borrowed, store, &fields) : -1;
    if (!failed) {
        const pma_field root = pma_field_root(&fields, name);
        failed = pma_end_tree(&fields, take_it(&root, n, nb, out));
    }
    Py_XDECREF(borrowed);
    return failed;
}

static pma_status take_matrix(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)nb;
    return pma_parts_matrix(f, n, out);
}

int pma_take_matrix(PyObject *obj, npy_intp n, const char *name, PyObject *arrays, pma_matrix *out)
{
    return take(obj, name, arrays, NULL, take_matrix, (size_t)n, 0, out);
}

static pma_status take_factor(const pma_field *f, size_t n, size_t nb, void *out)
{
    return pma_parts_factor(f, n, nb, out);
}

int pma_take_factor(PyObject *obj, npy_intp n, npy_intp nb, const char *name, PyObject *arrays,
                    pma_factor *out)
{
    return take(obj, name, arrays, NULL, take_factor, (size_t)n, (size_t)nb, out);
}

static pma_status take_panels(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_panels(f, out);
}

int pma_take_panels(PyObject *obj, const char *name, PyObject *arrays, pma_panels *out)
{
    return take(obj, name, arrays, NULL, take_panels, 0, 0, out);
}

static pma_status take_link(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n;
    return pma_parts_link(f, nb, out);
}

int pma_take_link(PyObject *obj, size_t nb, PyObject *arrays, pma_link *out)
{
    return take(obj, "link", arrays, NULL, take_link, 0, nb, out);
}

static pma_status take_springs(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_springs(f, out);
}

int pma_take_springs(PyObject *obj, PyObject *arrays, pma_store *store, pma_springs *out)
{
    return take(obj, "springs", arrays, store, take_springs, 0, 0, out);
}

static pma_status take_specimen(const pma_field *f, size_t n, size_t nb, void *out)
{
    bool by_caller;
    (void)nb;
    return pma_parts_specimen(f, n, out, &by_caller);
}

int pma_take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, pma_store *store,
                      pma_specimen **out)
{
    return take(obj, "specimen", arrays, store, take_specimen, (size_t)n, 0, out);
}

static pma_status take_subdomain(const pma_field *f, size_t n, size_t nb, void *out)
{
    (void)n, (void)nb;
    return pma_parts_subdomain(f, out);
}

int pma_take_subdomain(PyObject *obj, PyObject *arrays, pma_store *store, pma_subdomain_taken *out)
{
    return take(obj, NULL, arrays, store, take_subdomain, 0, 0, out);
}

int pma_take_coupler(PyObject *obj, PyObject *arrays, pma_store *store, const pma_members *members,
                     pma_coupler_taken *out)
{
    pma_fields fields;
    if (pma_read_tree(obj, arrays, store, &fields) < 0)
        return -1;
    const pma_field root = pma_field_root(&fields, NULL);
    return pma_end_tree(&fields, pma_parts_coupler(&root, members, out));
}
