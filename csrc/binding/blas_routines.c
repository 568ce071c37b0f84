/* Routines of BLAS, which SciPy has in capsules. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* The routine in a capsule whose name is a signature, as written by SciPy's Cython interface, with
 * this number of arguments and 32-bit integers. */
static void *pointer_of(PyObject *capsule, size_t arguments)
{
    const char *name = PyCapsule_CheckExact(capsule) ? PyCapsule_GetName(capsule) : NULL;
    size_t commas = 0;
    for (const char *c = name; c && *c; c++)
        commas += *c == ',';
    if (name && commas + 1 == arguments && strstr(name, "int *") && !strstr(name, "int64"))
        return PyCapsule_GetPointer(capsule, name);
    PyErr_SetString(PyExc_TypeError, "dgemm and dtrsm must be capsules of scipy.linalg.cython_blas "
                                     "with 32-bit integers");
    return NULL;
}

/* A function pointer from a void pointer, which POSIX defines and C11 does not. */
int pma_find_blas(PyObject *capsule, bool dgemm, pma_blas *out)
{
    void *pointer = pointer_of(capsule, dgemm ? 13 : 11);
    if (!pointer)
        return -1;
    if (dgemm)
        memcpy(&out->dgemm, &pointer, sizeof pointer);
    else
        memcpy(&out->dtrsm, &pointer, sizeof pointer);
    return 0;
}

int pma_take_blas(PyObject *dgemm, PyObject *dtrsm, pma_blas *out)
{
    *out = (pma_blas){.from = PMA_BLAS_FROM};
    if (dgemm == Py_None && dtrsm == Py_None)
        return 0;
    return pma_find_blas(dgemm, true, out) < 0 ? -1 : pma_find_blas(dtrsm, false, out);
}
