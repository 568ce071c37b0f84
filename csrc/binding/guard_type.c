/* A context that one call at a time can be in: a busy flag for Python, not a lock.
 *
 * It is C, because Python can raise KeyboardInterrupt on entering any of its functions: a flag that
 * Python code clears could be left set. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <stdatomic.h>

typedef struct {
    PyObject_HEAD
    atomic_ulong turns; /* entries and exits so far: odd inside */
} GuardObject;

static PyObject *guard_enter(GuardObject *self, PyObject *ignored)
{
    (void)ignored;
    unsigned long turns = atomic_load(&self->turns);
    while (turns % 2 == 0 && !atomic_compare_exchange_weak(&self->turns, &turns, turns + 1)) {
    }
    if (turns % 2 != 0)
        return PyErr_Format(
            PyExc_RuntimeError,
            "the coupler is being stepped: a load, a restoring force or another thread "
            "may not use it meanwhile");
    Py_RETURN_NONE;
}

static PyObject *guard_exit(GuardObject *self, PyObject *ignored)
{
    (void)ignored;
    atomic_fetch_add(&self->turns, 1);
    Py_RETURN_NONE;
}

static PyObject *guard_turns(GuardObject *self, void *closure)
{
    (void)closure;
    return PyLong_FromUnsignedLong(atomic_load(&self->turns));
}

static void guard_dealloc(GuardObject *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_Free(self);
    Py_DECREF(type);
}

static PyMethodDef guard_methods[] = {
    {"__enter__", (PyCFunction)guard_enter, METH_NOARGS, NULL},
    {"__exit__", (PyCFunction)guard_exit, METH_VARARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef guard_getset[] = {
    {"turns", (getter)guard_turns, NULL, "Entries and exits so far: odd inside.", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot guard_slots[] = {
    {Py_tp_doc, "A context that one call at a time can be in; a second one is a RuntimeError."},
    {Py_tp_new, PyType_GenericNew},
    {Py_tp_dealloc, guard_dealloc},
    {Py_tp_methods, guard_methods},
    {Py_tp_getset, guard_getset},
    {0, NULL},
};

PyType_Spec pma_guard_spec = {
    .name = "pmalpha._core.Guard",
    .basicsize = sizeof(GuardObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = guard_slots,
};
