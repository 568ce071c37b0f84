/* Python objects as a tree of fields (describe/field.h). */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* Dicts and tuples inside each other; one that contains itself ends here. */
enum { DEEPEST = 16 };

typedef struct {
    pma_node *nodes;
    size_t count, room;
    PyObject *arrays; /* list: what the nodes point into */
} growing;

/* The number of the first of `count` new nodes; SIZE_MAX with an exception. */
static size_t add_nodes(growing *tree, size_t count)
{
    const size_t first = tree->count;
    if (first + count > tree->room) {
        const size_t room = 2 * (first + count);
        pma_node *more = PyMem_Realloc(tree->nodes, room * sizeof *more);
        if (!more) {
            PyErr_NoMemory();
            return SIZE_MAX;
        }
        tree->nodes = more;
        tree->room = room;
    }
    tree->count += count;
    return first;
}

static int set_node(growing *tree, size_t at, PyObject *obj, int depth);

/* ---- leaves --------------------------------------------------------------------------------- */

static int set_foreign(pma_node *node, PyObject *obj, PyObject *arrays)
{
    *node = (pma_node){.kind = PMA_FOREIGN, .is.at = (uint64_t)(uintptr_t)obj};
    return PyList_Append(arrays, obj);
}

/* An array that the core cannot read stays an object. */
static int set_array(pma_node *node, PyArrayObject *array, PyObject *arrays)
{
    static const struct {
        int type;
        pma_kind kind;
    } KINDS[] = {{NPY_DOUBLE, PMA_DOUBLES}, {NPY_INT64, PMA_INT64S}, {NPY_INT32, PMA_INT32S}};
    const int axes = PyArray_NDIM(array);
    for (size_t i = 0; i < sizeof KINDS / sizeof *KINDS; i++) {
        /* 32 bits are int or long on Windows, 64 bits long or long long on Linux */
        if (!PyArray_EquivTypenums(PyArray_TYPE(array), KINDS[i].type) || axes < 1 ||
            axes > PMA_AXES || !PyArray_IS_C_CONTIGUOUS(array) || !PyArray_ISBEHAVED_RO(array))
            continue;
        *node = (pma_node){.kind = KINDS[i].kind,
                           .axes = (uint16_t)axes,
                           .is_writeable = PyArray_ISWRITEABLE(array) ? 1 : 0};
        for (int k = 0; k < axes; k++)
            node->extent[k] = PyArray_DIM(array, k);
        node->is.at = (uint64_t)(uintptr_t)PyArray_DATA(array);
        return PyList_Append(arrays, (PyObject *)array);
    }
    return set_foreign(node, (PyObject *)array, arrays);
}

static int set_word(pma_node *node, PyObject *obj, PyObject *arrays)
{
    Py_ssize_t length;
    const char *word = PyUnicode_AsUTF8AndSize(obj, &length);
    if (!word)
        return -1;
    *node = (pma_node){.kind = PMA_WORD, .extent = {length}, .is.at = (uint64_t)(uintptr_t)word};
    return PyList_Append(arrays, obj);
}

static int set_integer(pma_node *node, PyObject *obj)
{
    PyObject *number = PyNumber_Index(obj); /* of NumPy's integers too */
    const long long value = number ? PyLong_AsLongLong(number) : -1;
    Py_XDECREF(number);
    *node = (pma_node){.kind = PMA_INTEGER, .is.integer = value};
    return value == -1 && PyErr_Occurred() ? -1 : 0;
}

/* ---- tuples and dicts ----------------------------------------------------------------------- */

/* A tuple of this many objects from `first` on; `keys`, of a dict, come before each. */
static int set_children(growing *tree, size_t at, pma_kind kind, PyObject *keys, PyObject *values,
                        int depth)
{
    const Py_ssize_t size = PyTuple_Size(values), each = keys ? 2 : 1;
    const size_t first = add_nodes(tree, (size_t)(each * size));
    if (first == SIZE_MAX)
        return -1;
    tree->nodes[at] = (pma_node){.kind = kind, .extent = {each * size}, .is.at = first};
    for (Py_ssize_t i = 0; i < size; i++) {
        const size_t child = first + (size_t)(each * i);
        if (keys && set_node(tree, child, PyTuple_GetItem(keys, i), depth + 1) < 0)
            return -1;
        if (set_node(tree, child + (size_t)each - 1, PyTuple_GetItem(values, i), depth + 1) < 0)
            return -1;
    }
    return 0;
}

/* A named tuple is a dict. */
static int set_named(growing *tree, size_t at, PyObject *obj, int depth)
{
    PyObject *fields = PyObject_GetAttrString(obj, "_fields");
    if (!fields) {
        if (!PyErr_ExceptionMatches(PyExc_AttributeError)) /* Ctrl-C in a function of the class */
            return -1;
        PyErr_Clear();
        return set_children(tree, at, PMA_TUPLE, NULL, obj, depth);
    }
    int failed = -1;
    if (PyTuple_Check(fields) && PyTuple_Size(fields) == PyTuple_Size(obj))
        failed = set_children(tree, at, PMA_DICT, fields, obj, depth);
    else
        PyErr_SetString(PyExc_TypeError, "_fields must be the names of the items");
    Py_DECREF(fields);
    return failed;
}

static int set_tuple(growing *tree, size_t at, PyObject *obj, int depth)
{
    if (pma_is_compiled(obj))
        return set_foreign(&tree->nodes[at], obj, tree->arrays);
    return PyTuple_CheckExact(obj) ? set_children(tree, at, PMA_TUPLE, NULL, obj, depth)
                                   : set_named(tree, at, obj, depth);
}

/* As it is now: other threads may change it. */
static int set_dict(growing *tree, size_t at, PyObject *obj, int depth)
{
    PyObject *keys = PyDict_Keys(obj), *values = PyDict_Values(obj);
    PyObject *key_tuple = keys ? PyList_AsTuple(keys) : NULL;
    PyObject *value_tuple = values ? PyList_AsTuple(values) : NULL;
    int failed = -1;
    if (key_tuple && value_tuple && PyTuple_Size(key_tuple) == PyTuple_Size(value_tuple))
        failed = set_children(tree, at, PMA_DICT, key_tuple, value_tuple, depth);
    else if (key_tuple && value_tuple)
        PyErr_SetString(PyExc_RuntimeError, "a dict was changed while it was read");
    Py_XDECREF(keys);
    Py_XDECREF(values);
    Py_XDECREF(key_tuple);
    Py_XDECREF(value_tuple);
    return failed;
}

static int set_node(growing *tree, size_t at, PyObject *obj, int depth)
{
    pma_node *node = &tree->nodes[at];
    *node = (pma_node){.kind = PMA_NONE};
    if (depth > DEEPEST)
        return pma_refuse(PyExc_ValueError, "more than %d tuples in each other", DEEPEST);
    if (obj == Py_None)
        return 0;
    if (PyArray_Check(obj))
        return set_array(node, (PyArrayObject *)obj, tree->arrays);
    if (PyTuple_Check(obj))
        return set_tuple(tree, at, obj, depth);
    if (PyDict_Check(obj))
        return set_dict(tree, at, obj, depth);
    if (PyUnicode_Check(obj))
        return set_word(node, obj, tree->arrays);
    if (PyFloat_Check(obj)) {
        *node = (pma_node){.kind = PMA_REAL, .is.real = PyFloat_AsDouble(obj)};
        return 0;
    }
    if (PyBool_Check(obj) || PyIndex_Check(obj))
        return set_integer(node, obj);
    return set_foreign(node, obj, tree->arrays);
}

/* ---- functions ------------------------------------------------------------------------------ */

static pma_status find(pma_fields *fields, const pma_node *node, pma_role role, void *out)
{
    PyObject *obj = (PyObject *)(uintptr_t)node->is.at;
    switch (role) {
    case PMA_RESTORING_ROLE:
        return pma_find_restoring(obj, out) < 0 ? PMA_REFUSED : PMA_OK;
    case PMA_INTERNAL_ROLE:
        return pma_find_internal(obj, fields->store, out) < 0 ? PMA_REFUSED : PMA_OK;
    case PMA_POTENTIAL_ROLE:
        return pma_find_potential(obj, out) < 0 ? PMA_REFUSED : PMA_OK;
    case PMA_LOAD_ROLE:
        return pma_find_load(obj, out) < 0 ? PMA_REFUSED : PMA_OK;
    case PMA_OBJECT_ROLE:
        memcpy(out, &obj, sizeof obj);
        return PMA_OK;
    default:
        return pma_find_blas(obj, role == PMA_DGEMM_ROLE, out) < 0 ? PMA_REFUSED : PMA_OK;
    }
}

/* ---- an argument ---------------------------------------------------------------------------- */

static void release_store(PyObject *capsule)
{
    pma_store *store = PyCapsule_GetPointer(capsule, NULL);
    pma_store_release(store);
    PyMem_Free(store);
}

/* A store that lives as long as the list. */
static pma_store *new_store(PyObject *arrays)
{
    pma_store *store = PyMem_Calloc(1, sizeof *store);
    PyObject *capsule = store ? PyCapsule_New(store, NULL, release_store) : PyErr_NoMemory();
    if (!capsule) {
        PyMem_Free(store);
        return NULL;
    }
    const int failed = PyList_Append(arrays, capsule);
    Py_DECREF(capsule);
    return failed ? NULL : store;
}

pma_field pma_read(pma_argument *arg, PyObject *obj, const char *name, PyObject *arrays)
{
    static const pma_node none = {.kind = PMA_NONE};
    growing tree = {.arrays = arrays ? Py_NewRef(arrays) : PyList_New(0)};
    *arg = (pma_argument){.fields = {.nodes = &none, .find = find}, .arrays = tree.arrays};
    if (tree.arrays)
        arg->fields.store = new_store(tree.arrays);
    if (arg->fields.store && add_nodes(&tree, 1) != SIZE_MAX && set_node(&tree, 0, obj, 0) == 0)
        arg->fields.nodes = tree.nodes;
    arg->nodes = tree.nodes;
    return pma_field_root(&arg->fields, name);
}

int pma_end(pma_argument *arg, pma_status status)
{
    const pma_fields *fields = &arg->fields;
    PyMem_Free(arg->nodes);
    Py_XDECREF(arg->arrays);
    if (PyErr_Occurred())
        return -1;
    if (status == PMA_REFUSED)
        PyErr_SetString(fields->wrong_type ? PyExc_TypeError : PyExc_ValueError, fields->refusal);
    return status == PMA_REFUSED ? -1 : pma_check(status, "fields");
}
