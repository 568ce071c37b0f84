/* A context that one call at a time can be in: a busy flag for Python, not a lock.
 *
 * It is C, because Python can raise KeyboardInterrupt on entering any of its functions: a flag that
 * Python code clears could be left set. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <stdatomic.h>

typedef struct {
    PyObject_HEAD
    atomic_bool busy;
} GuardObject;

static PyObject *guard_enter(GuardObject *self, PyObject *ignored)
{
    (void)ignored;
    if (atomic_exchange(&self->busy, true)) {
        PyErr_SetString(PyExc_RuntimeError,
                        "the coupler is being stepped: a load, a restoring force or another thread "
                        "may not use it meanwhile");
        return NULL;
    }
    Py_RETURN_NONE;
}

static PyObject *guard_exit(GuardObject *self, PyObject *ignored)
{
    (void)ignored;
    atomic_store(&self->busy, false);
    Py_RETURN_NONE;
}

static void guard_dealloc(GuardObject *self)
{
    PyTypeObject *type = Py_TYPE(self);
    PyObject_Free(self);
    Py_DECREF(type);
}

static PyMethodDef guard_methods[] = {
    {"__enter__", (PyCFunction)guard_enter, METH_NOARGS, NULL},
    {"__exit__", (PyCFunction)guard_exit, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot guard_slots[] = {
    {Py_tp_doc, "A context that one call at a time can be in; a second one is a RuntimeError."},
    {Py_tp_new, PyType_GenericNew},
    {Py_tp_dealloc, guard_dealloc},
    {Py_tp_methods, guard_methods},
    {0, NULL},
};

PyType_Spec pma_guard_spec = {
    .name = "pmalpha._core.Guard",
    .basicsize = sizeof(GuardObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = guard_slots,
};
