/* The type Subdomain. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- making ----------------------------------------------------------------------------- */

static PyObject *subdomain_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"parts", NULL};
    PyObject *parts;
    pma_subdomain_taken taken;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!", names, &PyDict_Type, &parts))
        return NULL;
    SubdomainObject *self = (SubdomainObject *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->arrays = PyList_New(0);
    if (!self->arrays || pma_take_subdomain(parts, self->arrays, &taken) < 0 ||
        pma_take_crew((Py_ssize_t)taken.threads, &self->team, &taken.iterate.tangent.crew) < 0)
        goto failed;
    const pma_status status = pma_parts_make_subdomain(&taken, &self->core);
    if (status == PMA_OK)
        return (PyObject *)self;
    pma_raise(status, "Subdomain");
failed:
    Py_DECREF(self);
    return NULL;
}

static int subdomain_traverse(SubdomainObject *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->arrays);
    Py_VISIT(self->load);
    Py_VISIT(self->mass);
    Py_VISIT(self->response);
    Py_VISIT((PyObject *)self->of);
    return 0;
}

static void subdomain_dealloc(SubdomainObject *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    pma_subdomain_destroy(self->core);
    pma_team_destroy(self->team);
    Py_XDECREF(self->arrays);
    Py_XDECREF(self->load);
    Py_XDECREF(self->mass);
    Py_XDECREF(self->response);
    Py_XDECREF((PyObject *)self->of);
    PyObject_GC_Del(self);
    Py_DECREF(type);
}

/* ---- loads -------------------------------------------------------------------------------- */

static PyObject *subdomain_set_load(SubdomainObject *self, PyObject *obj)
{
    pma_load load;
    PyObject *arrays =
        pma_take_load(obj, pma_subdomain_parts(self->core)->n, self->of != NULL, &load);
    if (!arrays || !pma_subdomain_claim(self)) {
        Py_XDECREF(arrays);
        return NULL;
    }
    pma_subdomain_set_load(self->core, load);
    pma_swap(&self->load, &arrays);
    pma_subdomain_release(self);
    Py_XDECREF(arrays);
    Py_RETURN_NONE;
}

/* Releases the subdomain after an evaluation of a function of the user. Its result, or the code
 * that it returned; NULL with the exception that it raised. Steals the reference to the result. */
static PyObject *result_of(SubdomainObject *self, pma_status status, PyObject *result)
{
    const int code = pma_subdomain_code(self->core);
    pma_subdomain_release(self);
    if (status == PMA_OK)
        return result;
    Py_DECREF(result);
    if (status == PMA_NO_MEMORY)
        return PyErr_NoMemory();
    if (PyErr_Occurred())
        return NULL;
    return status == PMA_LIMITED ? pma_breach_of(self->core, 0) : PyLong_FromLong(code);
}

/* ---- energy ------------------------------------------------------------------------------- */

/* *arrays becomes those that were in use before */
static int begin_energy(SubdomainObject *self, PyObject *args, PyObject **arrays)
{
    PyObject *M_obj, *skew_obj, *load_obj, *lam_obj, *functions_obj;
    const double *load, *lam, *functions = NULL;
    double weight = NAN;
    pma_matrix M, skew;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    const npy_intp n = (npy_intp)parts->n;
    if (!PyArg_ParseTuple(args, "OOOOO|d", &M_obj, &skew_obj, &load_obj, &lam_obj, &functions_obj,
                          &weight) ||
        pma_take_matrix(M_obj, n, "M", *arrays, &M) < 0 ||
        pma_take_matrix(skew_obj, n, "skew", *arrays, &skew) < 0 ||
        pma_take_doubles(load_obj, n, "load", NULL, &load) < 0 ||
        pma_take_doubles(lam_obj, (npy_intp)parts->link.p, "lam", NULL, &lam) < 0 ||
        (functions_obj != Py_None &&
         pma_take_doubles(functions_obj, 2 * n, "functions", NULL, &functions) < 0) ||
        !pma_subdomain_claim(self))
        return -1;
    const pma_status status = pma_subdomain_begin_energy(self->core, M, skew, load, lam, functions);
    if (status == PMA_OK && !isnan(weight))
        pma_energy_conserve(pma_subdomain_energy(self->core), weight);
    if (status == PMA_OK)
        pma_swap(&self->mass, arrays);
    pma_subdomain_release(self);
    return pma_check(status, "energy");
}

static PyObject *subdomain_evaluate_present(SubdomainObject *self, PyObject *args)
{
    double t;
    if (!PyArg_ParseTuple(args, "d", &t) || !pma_subdomain_claim(self))
        return NULL;
    const pma_status status = pma_subdomain_evaluate_present(self->core, t);
    return result_of(self, status, Py_NewRef(Py_None));
}

static PyObject *subdomain_begin_energy(SubdomainObject *self, PyObject *args)
{
    PyObject *arrays = PyList_New(0);
    if (!arrays)
        return NULL;
    const int failed = begin_energy(self, args, &arrays);
    Py_XDECREF(arrays);
    return failed ? NULL : Py_NewRef(Py_None);
}

static PyObject *subdomain_follow_energy(SubdomainObject *self, PyObject *obj)
{
    if (!Py_IS_TYPE(obj, Py_TYPE((PyObject *)self)))
        return PyErr_Format(PyExc_TypeError, "from must be a Subdomain, got %R", obj);
    SubdomainObject *from = (SubdomainObject *)obj;
    if (pma_subdomain_parts(from->core)->n != pma_subdomain_parts(self->core)->n ||
        pma_subdomain_parts(from->core)->nb != pma_subdomain_parts(self->core)->nb)
        return PyErr_Format(PyExc_ValueError, "from must be the same subdomain with other steps");
    if (!pma_subdomain_claim(self))
        return NULL;
    if (!pma_subdomain_claim(from)) {
        pma_subdomain_release(self);
        return NULL;
    }
    const pma_status status = pma_subdomain_follow_energy(self->core, from->core);
    PyObject *mass = NULL;
    if (status == PMA_OK) {
        mass = Py_XNewRef(from->mass);
        pma_swap(&self->mass, &mass);
    }
    pma_subdomain_release(from);
    pma_subdomain_release(self);
    Py_XDECREF(mass);
    return status == PMA_OK ? Py_NewRef(Py_None) : pma_raise(status, "energy");
}

static PyObject *subdomain_end_energy(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    PyObject *mass = NULL;
    if (!pma_subdomain_claim(self))
        return NULL;
    pma_subdomain_end_energy(self->core);
    pma_swap(&self->mass, &mass);
    pma_subdomain_release(self);
    Py_XDECREF(mass);
    Py_RETURN_NONE;
}

/* ---- state -------------------------------------------------------------------------------- */

static PyObject *subdomain_start(SubdomainObject *self, PyObject *args)
{
    PyObject *objs[4];
    const double *u, *v, *w, *lam;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    const npy_intp n = (npy_intp)parts->n;
    if (!PyArg_ParseTuple(args, "OOOO", &objs[0], &objs[1], &objs[2], &objs[3]) ||
        pma_take_doubles(objs[0], n, "u", NULL, &u) < 0 ||
        pma_take_doubles(objs[1], n, "v", NULL, &v) < 0 ||
        pma_take_doubles(objs[2], n, "w", NULL, &w) < 0 ||
        pma_take_doubles(objs[3], (npy_intp)parts->link.p, "lam", NULL, &lam) < 0 ||
        !pma_subdomain_claim(self))
        return NULL;
    pma_subdomain_start(self->core, u, v, w, lam);
    pma_subdomain_release(self);
    Py_RETURN_NONE;
}

static PyObject *subdomain_rebase(SubdomainObject *self, PyObject *args)
{
    int twice;
    PyObject *obj;
    const double *lam;
    const pma_parts *parts = pma_subdomain_parts(self->core);
    if (!PyArg_ParseTuple(args, "pO", &twice, &obj) ||
        pma_take_doubles(obj, (npy_intp)parts->link.p, "lam", NULL, &lam) < 0)
        return NULL;
    if (twice && !parts->doubled)
        return PyErr_Format(PyExc_ValueError, "the subdomain takes no double steps");
    if (!pma_subdomain_claim(self))
        return NULL;
    pma_subdomain_rebase(self->core, twice, lam);
    pma_subdomain_release(self);
    Py_RETURN_NONE;
}

static PyObject *subdomain_state(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    const npy_intp n = (npy_intp)pma_subdomain_parts(self->core)->n;
    if (!pma_subdomain_claim(self))
        return NULL;
    const pma_state *x = pma_subdomain_present(self->core);
    PyObject *arrays[3] = {pma_new_vector(n, x->u), pma_new_vector(n, x->v),
                           pma_new_vector(n, x->w)};
    pma_subdomain_release(self);
    return pma_pack(3, arrays);
}

static PyObject *subdomain_force(SubdomainObject *self, PyObject *args)
{
    double t;
    npy_intp n = (npy_intp)pma_subdomain_parts(self->core)->n;
    if (!PyArg_ParseTuple(args, "d", &t))
        return NULL;
    PyObject *F = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (!F || !pma_subdomain_claim(self)) {
        Py_XDECREF(F);
        return NULL;
    }
    const pma_status status = pma_subdomain_force(self->core, t, PyArray_DATA((PyArrayObject *)F));
    return result_of(self, status, F);
}

static PyObject *subdomain_restoring(SubdomainObject *self, PyObject *args)
{
    double t;
    PyObject *u_obj, *v_obj;
    const double *u, *v;
    npy_intp n = (npy_intp)pma_subdomain_parts(self->core)->n;
    if (!PyArg_ParseTuple(args, "dOO", &t, &u_obj, &v_obj) ||
        pma_take_doubles(u_obj, n, "u", NULL, &u) < 0 ||
        pma_take_doubles(v_obj, n, "v", NULL, &v) < 0)
        return NULL;
    PyObject *r = PyArray_SimpleNew(1, &n, NPY_DOUBLE);
    if (!r || !pma_subdomain_claim(self)) {
        Py_XDECREF(r);
        return NULL;
    }
    const pma_status status =
        pma_subdomain_evaluate_restoring(self->core, t, u, v, PyArray_DATA((PyArrayObject *)r));
    return result_of(self, status, r);
}

static PyObject *subdomain_springs(SubdomainObject *self, PyObject *Py_UNUSED(ignored))
{
    const pma_springs *springs = &pma_subdomain_parts(self->core)->springs;
    const npy_intp shape[2] = {(npy_intp)pma_springs_fields(springs), (npy_intp)springs->total};
    PyObject *out = PyArray_SimpleNew(2, shape, NPY_DOUBLE);
    if (!out || !pma_subdomain_claim(self)) {
        Py_XDECREF(out);
        return NULL;
    }
    if (springs->total > 0)
        memcpy(PyArray_DATA((PyArrayObject *)out), pma_subdomain_present(self->core)->springs,
               pma_springs_numbers(springs) * sizeof(double));
    pma_subdomain_release(self);
    return out;
}

static PyObject *subdomain_get_gain(SubdomainObject *self, void *Py_UNUSED(closure))
{
    const pma_balance *b = pma_subdomain_balance(self->core);
    const pma_gain gain = b ? pma_balance_gain(b) : (pma_gain){0};
    return Py_BuildValue("(ddd)", gain.added, gain.energy, gain.t);
}

static PyObject *subdomain_get_stiff(SubdomainObject *self, void *Py_UNUSED(closure))
{
    const pma_balance *b = pma_subdomain_balance(self->core);
    const pma_stiff x = b ? pma_balance_stiff(b) : (pma_stiff){.t = 0.0};
    return Py_BuildValue("(dddd)", x.excess.displacement, x.excess.velocity, x.h, x.t);
}

static PyObject *subdomain_get_added_mass(SubdomainObject *self, void *Py_UNUSED(closure))
{
    const pma_balance *b = pma_subdomain_balance(self->core);
    return PyFloat_FromDouble(b ? pma_balance_added_mass(b) : 0.0);
}

static PyObject *subdomain_get_entries(SubdomainObject *self, void *Py_UNUSED(closure))
{
    return PyLong_FromSize_t(pma_subdomain_member(self->core).entries);
}

static PyGetSetDef subdomain_getset[] = {
    {"stiff", (getter)subdomain_get_stiff, NULL,
     "the step over that which forces evaluated once allow, if they depend on displacements, "
     "squared, and on velocities; its length; since when the motion has grown, or zeros",
     NULL},
    {"gain", (getter)subdomain_get_gain, NULL,
     "the largest energy that evaluated forces have added to the motion, that it had, and since "
     "when the former is more than a tenth; zeros if it is not, and if not watched",
     NULL},
    {"added_mass", (getter)subdomain_get_added_mass, NULL,
     "as how much of the mass an estimate above the stiffness of functions has acted; or 0", NULL},
    {"entries", (getter)subdomain_get_entries, NULL, "matrix entries read by one substep", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyMethodDef subdomain_methods[] = {
    {"set_load", (PyCFunction)subdomain_set_load, METH_O,
     "set_load(load): in a form of csrc/core/describe; in lanes a tuple, one for each"},
    {"start", (PyCFunction)subdomain_start, METH_VARARGS, "start(u, v, w, lam): state at t = 0"},
    {"rebase", (PyCFunction)subdomain_rebase, METH_VARARGS,
     "rebase(twice, lam): the stored free velocity that gives the present velocity with lam"},
    {"state", (PyCFunction)subdomain_state, METH_NOARGS, "state() -> (u, v, w), copies"},
    {"force", (PyCFunction)subdomain_force, METH_VARARGS,
     "force(t) -> F(t) of a load that is no table, or the code that the function returned"},
    {"restoring", (PyCFunction)subdomain_restoring, METH_VARARGS,
     "restoring(t, u, v) -> r(t, u, v), the code that the function returned, or {kind, ...} of a "
     "force beyond the limits"},
    {"levels", (PyCFunction)pma_subdomain_object_levels, METH_NOARGS,
     "levels() -> {u, v, w, a, vf, springs, history} of the present time level, and if double "
     "{previous_u, ...} of the one before; copies"},
    {"springs", (PyCFunction)subdomain_springs, METH_NOARGS,
     "springs() -> (fields, springs) array: present deformation, force and inner variables, a "
     "copy"},
    {"check_levels", (PyCFunction)pma_subdomain_object_check_levels, METH_O,
     "check_levels(levels): ValueError unless set_levels takes them"},
    {"set_levels", (PyCFunction)pma_subdomain_object_set_levels, METH_O,
     "set_levels(levels): the inverse"},
    {"evaluate_present", (PyCFunction)subdomain_evaluate_present, METH_VARARGS,
     "evaluate_present(t): internal forces and their potential, for begin_energy; None, or the "
     "code that a function returned"},
    {"begin_energy", (PyCFunction)subdomain_begin_energy, METH_VARARGS,
     "begin_energy(M, skew, load, lam, functions, weight=nan): sums works from the present time "
     "level on, where restoring functions gave this, None: not known; with a weight also the share "
     "in E*, in which it multiplies K"},
    {"works", (PyCFunction)pma_subdomain_get_works, METH_NOARGS,
     "works() -> what works begun at the same present go on with; None without energy"},
    {"resume_works", (PyCFunction)pma_subdomain_go_on, METH_O,
     "resume_works(works): after begin_energy, works go on from there"},
    {"functions", (PyCFunction)pma_subdomain_get_functions, METH_O,
     "functions(steps) -> (2 n,) what restoring functions gave after this number of macro steps, "
     "the present, forces and loads that they contain; None where it is not known"},
    {"set_functions", (PyCFunction)pma_subdomain_take_functions, METH_VARARGS,
     "set_functions(steps, functions): the inverse, after set_levels"},
    {"follow_energy", (PyCFunction)subdomain_follow_energy, METH_O,
     "follow_energy(from): the works summed up for the same subdomain with other steps go on"},
    {"end_energy", (PyCFunction)subdomain_end_energy, METH_NOARGS, "end_energy(): stops the sums"},
    {"compliance", (PyCFunction)pma_subdomain_compliance, METH_VARARGS,
     "compliance(twice, rows) -> block of H on these constraints"},
    {"accelerate", (PyCFunction)pma_subdomain_accelerate, METH_O,
     "accelerate(lam) -> (n,) M^-1 L^T lam, under mean coupling"},
    {"unit_responses", (PyCFunction)pma_subdomain_unit_responses, METH_VARARGS,
     "unit_responses(rows, end, mean, states, twice=False, threads=1): writes the block of H under "
     "macro and mean coupling into end (k, k), the mean and the states; False when a value is not "
     "finite"},
    {"store_responses", (PyCFunction)pma_subdomain_store_responses, METH_O,
     "store_responses({rows, states}): those written by unit_responses for all of these rows"},
    {"in_lanes", (PyCFunction)pma_subdomain_in_lanes, METH_NOARGS,
     "in_lanes() -> the subdomain PMA_LANES times, for several cases side by side"},
    {"iteration", (PyCFunction)pma_subdomain_iteration, METH_NOARGS,
     "iteration() -> {scale, entries, twice} that the next step begins with, or None"},
    {"set_iteration", (PyCFunction)pma_subdomain_set_iteration, METH_O,
     "set_iteration(iteration): the inverse"},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot subdomain_slots[] = {
    {Py_tp_doc, "Subdomain(parts)\n\n"
                "A subdomain of the core, in elimination order."},
    {Py_tp_new, subdomain_new},
    {Py_tp_traverse, subdomain_traverse},
    {Py_tp_dealloc, subdomain_dealloc},
    {Py_tp_methods, subdomain_methods},
    {Py_tp_getset, subdomain_getset},
    {0, NULL},
};

PyType_Spec pma_subdomain_spec = {
    .name = "pmalpha._core.Subdomain",
    .basicsize = sizeof(SubdomainObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = subdomain_slots,
};
