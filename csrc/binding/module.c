#include "binding.h"
#include "symbolic.h"

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec)
{
    PyTypeObject *type = (PyTypeObject *)PyType_FromModuleAndSpec(module, spec, NULL);
    if (type && PyModule_AddType(module, type) < 0)
        Py_CLEAR(type);
    return type;
}

static int module_exec(PyObject *module)
{
    module_state *state = PyModule_GetState(module);
    if (PyArray_ImportNumPyAPI() < 0)
        return -1;
    state->subdomain_type = add_type(module, &pma_subdomain_spec);
    if (!state->subdomain_type)
        return -1;
    state->coupler_type = add_type(module, &pma_coupler_spec);
    return state->coupler_type ? 0 : -1;
}

static int check_pattern(npy_intp n, const int64_t *ptr, const int32_t *index)
{
    const pma_matrix pattern = {
        .form = PMA_SPARSE, .n = (size_t)n, .ptr = ptr, .index = index};
    if (pma_matrix_check(&pattern) == PMA_OK)
        return 0;
    pma_raise(PMA_BAD_INDEX, "count_factor");
    return -1;
}

/* count_factor(ptr, index) -> entries of the factor below the diagonal, column by column */
static PyObject *count_factor(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *ptr_obj, *index_obj;
    PyArrayObject *ptr, *index, *count;
    npy_intp any = -1;
    if (!PyArg_ParseTuple(args, "OO", &ptr_obj, &index_obj) ||
        pma_take_array(ptr_obj, NPY_INT64, 1, &any, "ptr", NULL, &ptr) < 0)
        return NULL;
    npy_intp n = PyArray_DIM(ptr, 0) - 1;
    if (n < 0)
        return PyErr_Format(PyExc_ValueError, "ptr must not be empty");
    const int64_t *starts = PyArray_DATA(ptr);
    npy_intp entries = starts[n] < 0 ? 0 : (npy_intp)starts[n];
    if (pma_take_array(index_obj, NPY_INT32, 1, &entries, "index", NULL, &index) < 0 ||
        check_pattern(n, starts, PyArray_DATA(index)) < 0)
        return NULL;
    int64_t *scratch = PyMem_Calloc(2 * (size_t)n + 1, sizeof *scratch);
    if (!scratch)
        return PyErr_NoMemory();
    count = (PyArrayObject *)PyArray_SimpleNew(1, &n, NPY_INT64);
    if (count) {
        Py_BEGIN_ALLOW_THREADS
        pma_symbolic_count((size_t)n, starts, PyArray_DATA(index), scratch, scratch + n,
                           PyArray_DATA(count));
        Py_END_ALLOW_THREADS
    }
    PyMem_Free(scratch);
    return (PyObject *)count;
}

static PyMethodDef module_methods[] = {
    {"count_factor", count_factor, METH_VARARGS,
     "count_factor(ptr, index) -> entries of the factor below the diagonal, column by column"},
    {NULL, NULL, 0, NULL},
};

static int module_traverse(PyObject *module, visitproc visit, void *arg)
{
    module_state *state = PyModule_GetState(module);
    Py_VISIT(state->subdomain_type);
    Py_VISIT(state->coupler_type);
    return 0;
}

static int module_clear(PyObject *module)
{
    module_state *state = PyModule_GetState(module);
    Py_CLEAR(state->subdomain_type);
    Py_CLEAR(state->coupler_type);
    return 0;
}

static void module_free(void *module)
{
    module_clear(module);
}

static PyModuleDef_Slot module_slots[] = {
    {Py_mod_exec, module_exec},
    {0, NULL},
};

static PyModuleDef module_def = {
    PyModuleDef_HEAD_INIT,
    .m_name = "pmalpha._core",
    .m_doc = "The C core: time steps, schedule and sweeps over finished factors.",
    .m_size = sizeof(module_state),
    .m_methods = module_methods,
    .m_slots = module_slots,
    .m_traverse = module_traverse,
    .m_clear = module_clear,
    .m_free = module_free,
};

PyMODINIT_FUNC PyInit__core(void)
{
    return PyModuleDef_Init(&module_def);
}
