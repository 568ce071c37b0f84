/* What the core takes from the fields of an argument. */
#define NO_IMPORT_ARRAY
#include "binding.h"

int pma_take_matrix(PyObject *obj, npy_intp n, const char *name, PyObject *arrays, pma_matrix *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, name, arrays);
    return pma_end(&arg, pma_parts_matrix(&root, (size_t)n, out));
}

int pma_take_factor(PyObject *obj, npy_intp n, pma_factor *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, "factor", NULL);
    return pma_end(&arg, pma_parts_factor(&root, (size_t)n, 0, out));
}

/* factor (n,), and link of its last nb unknowns */
int pma_take_bordered(PyObject *factor, PyObject *link, npy_intp n, npy_intp nb, pma_factor *f,
                      pma_link *L)
{
    pma_argument arg;
    pma_field root = pma_read(&arg, factor, "factor", NULL);
    if (pma_end(&arg, pma_parts_factor(&root, (size_t)n, (size_t)nb, f)) < 0)
        return -1;
    root = pma_read(&arg, link, "link", NULL);
    return pma_end(&arg, pma_parts_link(&root, (size_t)nb, L));
}

int pma_take_panels(PyObject *obj, PyObject *arrays, pma_panels *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, "structure", arrays);
    return pma_end(&arg, pma_parts_panels(&root, out));
}

int pma_take_springs(PyObject *obj, PyObject *arrays, pma_springs *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, "springs", arrays);
    return pma_end(&arg, pma_parts_springs(&root, out));
}

int pma_take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, pma_specimen **out)
{
    pma_argument arg;
    bool by_caller;
    const pma_field root = pma_read(&arg, obj, "specimen", arrays);
    return pma_end(&arg, pma_parts_specimen(&root, (size_t)n, out, &by_caller));
}

int pma_take_subdomain(PyObject *obj, PyObject *arrays, pma_subdomain_taken *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, NULL, arrays);
    return pma_end(&arg, pma_parts_subdomain(&root, out));
}

int pma_take_coupler(PyObject *obj, PyObject *arrays, const pma_members *members,
                     pma_coupler_taken *out)
{
    pma_argument arg;
    const pma_field root = pma_read(&arg, obj, NULL, arrays);
    return pma_end(&arg, pma_parts_coupler(&root, members, out));
}

PyObject *pma_take_load(PyObject *obj, size_t n, bool in_lanes, pma_load *out)
{
    pma_argument arg;
    PyObject *arrays = PyList_New(0);
    if (!arrays)
        return NULL;
    const pma_field root = pma_read(&arg, obj, "load", arrays);
    if (pma_end(&arg,
                in_lanes ? pma_parts_lane_loads(&root, n, out) : pma_parts_load(&root, n, out)) < 0)
        Py_CLEAR(arrays);
    return arrays;
}
