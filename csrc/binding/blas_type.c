/* A context in which BLAS has one thread.
 *
 * It is C, because Python can raise KeyboardInterrupt on entering any of its functions, here one
 * that restores the numbers of threads. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <stdatomic.h>

/* Functions of a library: the argument is an int or a 64-bit integer, in the same register. */
typedef struct {
    void (*set)(int64_t threads);
    int (*get)(void);
    int before; /* number of threads to be restored */
} library;

typedef struct {
    PyObject_HEAD
    atomic_flag taken; /* for a moment, where there is no GIL */
    size_t users;      /* threads of this process that are inside */
    size_t count;
    library *libraries;
} OneThreadObject;

/* How often this thread is inside; a process has one object. */
static _Thread_local size_t depth;

static void take(OneThreadObject *self)
{
    while (atomic_flag_test_and_set(&self->taken)) {
    }
}

static PyObject *one_thread_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    PyObject *pairs;
    if (kwargs || !PyArg_ParseTuple(args, "O!", &PyTuple_Type, &pairs))
        return PyErr_Occurred() ? NULL : PyErr_Format(PyExc_TypeError, "no keywords");
    OneThreadObject *self = (OneThreadObject *)PyType_GenericNew(type, NULL, NULL);
    if (!self)
        return NULL;
    atomic_flag_clear(&self->taken);
    const Py_ssize_t count = PyTuple_Size(pairs);
    self->libraries = PyMem_Calloc((size_t)count + 1, sizeof *self->libraries);
    if (!self->libraries) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        unsigned long long set, get;
        if (!PyArg_ParseTuple(PyTuple_GetItem(pairs, i), "KK", &set, &get)) {
            Py_DECREF(self);
            return NULL;
        }
        self->libraries[i] = (library){.set = (void (*)(int64_t))(uintptr_t)set,
                                       .get = (int (*)(void))(uintptr_t)get};
    }
    self->count = (size_t)count;
    return (PyObject *)self;
}

static void one_thread_dealloc(OneThreadObject *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyMem_Free(self->libraries);
    PyObject_Free(self);
    Py_DECREF(type);
}

/* In each thread: where OpenMP is below, the number belongs to it. */
static void limit(OneThreadObject *self)
{
    for (library *x = self->libraries; x < self->libraries + self->count; x++) {
        if (self->users == 0)
            x->before = x->get();
        x->set(1);
    }
}

static void restore(OneThreadObject *self)
{
    for (library *x = self->libraries; x < self->libraries + self->count; x++)
        x->set(x->before);
}

static PyObject *one_thread_enter(OneThreadObject *self, PyObject *ignored)
{
    (void)ignored;
    if (depth++ == 0) {
        take(self);
        limit(self);
        self->users++;
        atomic_flag_clear(&self->taken);
    }
    Py_RETURN_NONE;
}

static PyObject *one_thread_exit(OneThreadObject *self, PyObject *ignored)
{
    (void)ignored;
    if (--depth == 0) {
        take(self);
        if (--self->users == 0)
            restore(self);
        atomic_flag_clear(&self->taken);
    }
    Py_RETURN_NONE;
}

/* In a process forked off, whose one thread is this one: the others have left. */
static PyObject *one_thread_after_fork(OneThreadObject *self, PyObject *ignored)
{
    (void)ignored;
    const size_t users = self->users;
    self->users = depth > 0;
    if (users > 0 && depth == 0)
        restore(self);
    atomic_flag_clear(&self->taken);
    Py_RETURN_NONE;
}

static PyMethodDef one_thread_methods[] = {
    {"__enter__", (PyCFunction)one_thread_enter, METH_NOARGS, NULL},
    {"__exit__", (PyCFunction)one_thread_exit, METH_VARARGS, NULL},
    {"after_fork", (PyCFunction)one_thread_after_fork, METH_NOARGS,
     "after_fork(): in a process forked off no other thread is inside"},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot one_thread_slots[] = {
    {Py_tp_doc, "OneThread(((set, get), ...)): a context in which libraries of BLAS, given by the "
                "addresses of their functions, have one thread."},
    {Py_tp_new, one_thread_new},
    {Py_tp_dealloc, one_thread_dealloc},
    {Py_tp_methods, one_thread_methods},
    {0, NULL},
};

PyType_Spec pma_one_thread_spec = {
    .name = "pmalpha._core.OneThread",
    .basicsize = sizeof(OneThreadObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = one_thread_slots,
};
