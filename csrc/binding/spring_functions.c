/* The laws of springs, as a function of the module, for set-up and static equilibrium. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "forces/laws.h"

/* (levels, slopes, f) of springs that go from `from` to u */
static PyObject *follow(const pma_springs *springs, npy_intp n, const double *u, const double *from)
{
    const npy_intp total = (npy_intp)springs->total,
                   shape[2] = {(npy_intp)pma_springs_fields(springs), total};
    double *slopes, *f;
    PyObject *arrays[3] = {PyArray_ZEROS(2, shape, NPY_DOUBLE, 0),
                           pma_new_array(total, NPY_DOUBLE, &slopes),
                           pma_new_array(n, NPY_DOUBLE, &f)};
    if (arrays[0] && arrays[1] && arrays[2]) {
        double *to = PyArray_DATA((PyArrayObject *)arrays[0]);
        pma_springs_subtract(springs, u, NULL, from, to, f);
        pma_springs_tangent(springs, from, to, 1.0, 0.0, slopes);
        for (npy_intp i = 0; i < n; i++)
            f[i] = 0.0 - f[i]; /* no negative zeros */
    }
    return pma_pack(3, arrays);
}

static PyObject *take_and_follow(PyObject *list, PyObject *u_obj, PyObject *from_obj,
                                 PyObject *arrays)
{
    const npy_intp any = -1;
    PyArrayObject *u, *from;
    pma_springs springs;
    if (pma_take_springs(list, arrays, &springs) < 0 ||
        pma_take_array(u_obj, NPY_DOUBLE, 1, &any, "u", NULL, &u) < 0)
        return NULL;
    const npy_intp n = PyArray_DIM(u, 0);
    const npy_intp shape[2] = {(npy_intp)pma_springs_fields(&springs), (npy_intp)springs.total};
    PyObject *zeros = from_obj == Py_None ? PyArray_ZEROS(2, shape, NPY_DOUBLE, 0) : NULL;
    if (zeros && PyList_Append(arrays, zeros) < 0) {
        Py_DECREF(zeros);
        return NULL;
    }
    Py_XDECREF(zeros);
    if ((from_obj == Py_None && !zeros) ||
        pma_take_array(zeros ? zeros : from_obj, NPY_DOUBLE, 2, shape, "levels", NULL, &from) < 0)
        return NULL;
    const pma_status status = pma_springs_check(&springs, (size_t)n);
    if (status != PMA_OK)
        return pma_raise(status, "springs");
    return follow(&springs, n, PyArray_DATA(u), PyArray_DATA(from));
}

static PyObject *follow_springs(PyObject *Py_UNUSED(module), PyObject *args)
{
    PyObject *list, *u, *from, *arrays;
    if (!PyArg_ParseTuple(args, "O!OO", &PyTuple_Type, &list, &u, &from) ||
        !(arrays = PyList_New(0)))
        return NULL;
    PyObject *result = take_and_follow(list, u, from, arrays);
    Py_DECREF(arrays);
    return result;
}

/* {name: number in the core} of all laws */
PyObject *pma_spring_laws(void)
{
    PyObject *laws = PyDict_New();
    for (int i = 0; laws && i < PMA_SPRING_LAWS; i++) {
        PyObject *number = PyLong_FromLong(i);
        if (!number || PyDict_SetItemString(laws, pma_laws[i].name, number) < 0)
            Py_CLEAR(laws);
        Py_XDECREF(number);
    }
    return laws;
}

PyMethodDef pma_spring_functions[] = {
    {"follow_springs", follow_springs, METH_VARARGS,
     "follow_springs(springs, u, levels) -> (levels, slopes, f): springs that go from what they "
     "remember, (fields, springs), to rest at u; None: that were never loaded"},
    {NULL, NULL, 0, NULL},
};
