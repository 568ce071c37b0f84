/* The module: its types, functions and constants. */
#include "binding.h"

#include "solve/cone.h"
#include "solve/newton.h"

static PyTypeObject *add_type(PyObject *module, PyType_Spec *spec)
{
    PyTypeObject *type = (PyTypeObject *)PyType_FromModuleAndSpec(module, spec, NULL);
    if (type && PyModule_AddType(module, type) < 0)
        Py_CLEAR(type);
    return type;
}

/* NumPy has one table of functions for all interpreters, and a callback finds its thread state by
 * PyGILState, which knows the main interpreter only. */
static int check_interpreter(void)
{
    if (PyInterpreterState_GetID(PyInterpreterState_Get()) == 0)
        return 0;
    return pma_refuse(PyExc_ImportError, "pmalpha can be imported in the main interpreter only");
}

static int module_exec(PyObject *module)
{
    module_state *state = PyModule_GetState(module);
    if (check_interpreter() < 0)
        return -1;
    if (PyArray_ImportNumPyAPI() < 0 || PyModule_AddFunctions(module, pma_matrix_functions) < 0 ||
        PyModule_AddFunctions(module, pma_spring_functions) < 0 ||
        PyModule_AddFunctions(module, pma_specimen_functions) < 0 ||
        PyModule_AddFunctions(module, pma_frozen_functions) < 0 ||
        PyModule_AddFunctions(module, pma_estimate_functions) < 0 ||
        PyModule_AddFunctions(module, pma_case_functions) < 0 ||
        PyModule_AddIntConstant(module, "LANES", PMA_LANES) < 0 ||
        PyModule_AddIntConstant(module, "MOST_SWEEPS", PMA_MOST_SWEEPS) < 0 ||
        PyModule_AddIntConstant(module, "MOST_ITERATIONS", PMA_MOST_ITERATIONS) < 0)
        return -1;
    PyObject *laws = pma_spring_laws();
    const int failed = laws ? PyModule_AddObjectRef(module, "SPRING_LAWS", laws) : -1;
    Py_XDECREF(laws);
    if (failed)
        return -1;
    state->subdomain_type = add_type(module, &pma_subdomain_spec);
    if (!state->subdomain_type)
        return -1;
    state->coupler_type = add_type(module, &pma_coupler_spec);
    if (!state->coupler_type)
        return -1;
    state->guard_type = add_type(module, &pma_guard_spec);
    if (!state->guard_type)
        return -1;
    state->one_thread_type = add_type(module, &pma_one_thread_spec);
    return state->one_thread_type ? 0 : -1;
}

static int module_traverse(PyObject *module, visitproc visit, void *arg)
{
    module_state *state = PyModule_GetState(module);
    Py_VISIT(state->subdomain_type);
    Py_VISIT(state->coupler_type);
    Py_VISIT(state->guard_type);
    Py_VISIT(state->one_thread_type);
    return 0;
}

static int module_clear(PyObject *module)
{
    module_state *state = PyModule_GetState(module);
    Py_CLEAR(state->subdomain_type);
    Py_CLEAR(state->coupler_type);
    Py_CLEAR(state->guard_type);
    Py_CLEAR(state->one_thread_type);
    return 0;
}

static void module_free(void *module)
{
    module_clear(module);
}

static PyModuleDef_Slot module_slots[] = {
    {Py_mod_exec, module_exec},
/* Slots that the stable ABI of 3.11 does not have; there check_interpreter refuses. */
#if defined(Py_mod_multiple_interpreters)
    {Py_mod_multiple_interpreters, Py_MOD_MULTIPLE_INTERPRETERS_NOT_SUPPORTED},
#endif
#if defined(Py_mod_gil)
    {Py_mod_gil, Py_MOD_GIL_NOT_USED}, /* busy flags are atomic; the core has no globals */
#endif
    {0, NULL},
};

static PyModuleDef module_def = {
    PyModuleDef_HEAD_INIT,
    .m_name = "pmalpha._core",
    .m_doc = "The C core: time steps, schedule and sweeps over finished factors.",
    .m_size = sizeof(module_state),
    .m_methods = pma_factor_functions,
    .m_slots = module_slots,
    .m_traverse = module_traverse,
    .m_clear = module_clear,
    .m_free = module_free,
};

PyMODINIT_FUNC PyInit__core(void)
{
    return PyModuleDef_Init(&module_def);
}
