/* The check sum of frozen models. */
#define NO_IMPORT_ARRAY
#include "binding.h"
#include "describe/file.h"

static PyObject *check_sum(PyObject *Py_UNUSED(module), PyObject *obj)
{
    Py_buffer view;
    if (PyObject_GetBuffer(obj, &view, PyBUF_SIMPLE) < 0)
        return NULL;
    const bool fits = view.len % 8 == 0 && (uintptr_t)view.buf % 8 == 0;
    const uint64_t sum = fits ? pma_file_sum(view.buf, (size_t)view.len) : 0;
    PyBuffer_Release(&view);
    if (!fits)
        return PyErr_Format(PyExc_ValueError, "the bytes must be words of 64 bits, aligned");
    return PyLong_FromUnsignedLongLong(sum);
}

PyMethodDef pma_frozen_functions[] = {
    {"check_sum", check_sum, METH_O, "check_sum(bytes) -> int: of a frozen model, without header"},
    {NULL, NULL, 0, NULL},
};
