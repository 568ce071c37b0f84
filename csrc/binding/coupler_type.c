/* The type Coupler. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- making ----------------------------------------------------------------------------- */

static int check_subdomains(PyTypeObject *type, PyObject *subdomains)
{
    module_state *state = PyType_GetModuleState(type);
    for (Py_ssize_t i = 0; i < PyTuple_Size(subdomains); i++) {
        PyObject *s = PyTuple_GetItem(subdomains, i);
        if (!Py_IS_TYPE(s, state->subdomain_type))
            return pma_refuse(PyExc_TypeError, "subdomains must be of type Subdomain, got %R",
                              Py_TYPE(s));
    }
    return 0;
}

static size_t nb_of(const void *of, size_t member)
{
    CouplerObject *self = (CouplerObject *)(uintptr_t)of;
    return pma_subdomain_parts(pma_subdomain_of(self, (Py_ssize_t)member)->core)->nb;
}

static int create_interface(const pma_factor *factor, const char *name, pma_interface *own,
                            pma_interface *out)
{
    const pma_status status = pma_interface_create(factor, own);
    *out = *own;
    return pma_check(status, name);
}

static int take_parts(CouplerObject *self, PyObject *fields, PyObject *processes)
{
    pma_coupler_taken taken;
    const pma_members members = {
        .count = (size_t)PyTuple_Size(self->subdomains), .nb = nb_of, .of = self};
    if (pma_take_processes(processes, self->arrays, &self->processes) < 0 ||
        pma_take_coupler(fields, self->arrays, &members, &taken) < 0 ||
        create_interface(&taken.H_start, "H_start", &self->H_start, &taken.parts.H_start) < 0 ||
        create_interface(&taken.H, "H", &self->H, &taken.parts.H) < 0)
        return -1;
    for (size_t i = 0; i < taken.parts.motion_count; i++) {
        if (PyList_Append(self->motions, Py_None) < 0)
            return -1;
    }
    return pma_coupler_fill(self, &taken.parts);
}

static PyObject *coupler_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"subdomains", "parts", "processes", NULL};
    PyObject *subdomains, *parts, *processes = Py_None;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!O!|O", names, &PyTuple_Type, &subdomains,
                                     &PyDict_Type, &parts, &processes) ||
        check_subdomains(type, subdomains) < 0)
        return NULL;
    if (PyTuple_Size(subdomains) == 0 && processes == Py_None)
        return PyErr_Format(PyExc_ValueError, "subdomains must not be empty");
    CouplerObject *self = (CouplerObject *)PyType_GenericAlloc(type, 0);
    if (!self)
        return NULL;
    self->subdomains = Py_NewRef(subdomains);
    self->arrays = PyList_New(0);
    self->motions = PyList_New(0);
    if (!self->arrays || !self->motions || take_parts(self, parts, processes) < 0)
        Py_CLEAR(self);
    return (PyObject *)self;
}

static int coupler_traverse(CouplerObject *self, visitproc visit, void *arg)
{
    Py_VISIT(Py_TYPE((PyObject *)self));
    Py_VISIT(self->subdomains);
    Py_VISIT(self->arrays);
    Py_VISIT(self->motions);
    Py_VISIT(self->pace);
    Py_VISIT(self->slots);
    Py_VISIT(self->obstacle);
    return 0;
}

static void coupler_dealloc(CouplerObject *self)
{
    PyTypeObject *type = Py_TYPE((PyObject *)self);
    PyObject_GC_UnTrack(self);
    pma_coupler_destroy(self->core);
    pma_release_processes(self->processes);
    pma_interface_destroy(&self->H_start);
    pma_interface_destroy(&self->H);
    Py_XDECREF(self->subdomains);
    Py_XDECREF(self->arrays);
    Py_XDECREF(self->motions);
    Py_XDECREF(self->pace);
    Py_XDECREF(self->slots);
    Py_XDECREF(self->obstacle);
    PyObject_GC_Del(self);
    Py_DECREF(type);
}

/* ---- stepping ------------------------------------------------------------------------------- */

/* Matrix entries that the core reads between two checks for signals. */
enum { POLL_ENTRIES = 20000 };

/* true unless a table lacks the loads of some substeps, `substeps` in a macro step */
static bool covers(const pma_load *load, int64_t begin, int64_t end, int64_t substeps)
{
    return pma_load_covers(load, begin * substeps, end * substeps);
}

static int check_tables(CouplerObject *self, int64_t steps)
{
    const int64_t begin = pma_coupler_step_count(self->core) - pma_coupler_origin(self->core);
    const int64_t end = begin + steps;
    const pma_coupler_parts *parts = pma_coupler_get_parts(self->core);
    const int64_t instants = (int64_t)pma_coupler_instants(self->core);
    bool all = true;
    for (Py_ssize_t i = 0; i < PyTuple_Size(self->subdomains); i++) {
        const pma_subdomain *s = pma_subdomain_of(self, i)->core;
        const int64_t substeps = (int64_t)pma_subdomain_parts(s)->substeps;
        all = all && covers(pma_subdomain_load(s), begin, end, substeps);
    }
    for (size_t i = 0; i < parts->motion_count; i++)
        all = all && covers(&parts->motions[i].load, begin, end, instants);
    const pma_load *obstacle = pma_coupler_obstacle(self->core);
    all = all && (!obstacle || covers(obstacle, begin, end, instants));
    if (!all)
        PyErr_SetString(PyExc_ValueError, "a load table does not cover the steps");
    return all ? 0 : -1;
}

static int check_steps(CouplerObject *self, long long steps)
{
    const int64_t most = pma_coupler_most_steps(self->core);
    if (steps >= 0 && steps <= most - pma_coupler_step_count(self->core))
        return 0;
    return pma_refuse(PyExc_ValueError,
                      "steps must not be negative nor overflow the step count, got %lld", steps);
}

/* The round before the first macro step: with another status than PMA_OK when an exception keeps
 * this process, not the others, from that step. */
static pma_status meet(CouplerObject *self, pma_status status)
{
    pma_caller before = pma_gil_release();
    status = pma_coupler_meet(self->core, status);
    pma_gil_acquire(before);
    return status;
}

/* None, or the result of pma_failure() */
static PyObject *coupler_advance(CouplerObject *self, PyObject *args)
{
    long long steps;
    PyObject *obj, *report = Py_None, *result = NULL;
    pma_record record = {0};
    pma_paced_run run = {.state = NULL};
    pma_status status = PMA_OK;
    if (!PyArg_ParseTuple(args, "LO|O", &steps, &obj, &report))
        return NULL;
    if (report != Py_None && !PyCallable_Check(report))
        return PyErr_Format(PyExc_TypeError, "report must be None or a callable, got %R", report);
    PyObject *arrays = PyList_New(0);
    if (!arrays || pma_coupler_claim(self) < 0) {
        Py_XDECREF(arrays);
        return NULL;
    }
    if (check_steps(self, steps) < 0 || check_tables(self, steps) < 0 ||
        (obj != Py_None && pma_take_record(self, obj, pma_coupler_step_count(self->core) + steps,
                                           arrays, &record) < 0) ||
        pma_take_pace(self, steps, arrays, &run) < 0) {
        if (self->processes && steps > 0)
            meet(self, PMA_NO_MEMORY);
        goto done;
    }

    pma_watch watch = {.last = pma_watch_milliseconds(),
                       .report = report == Py_None ? NULL : report,
                       .coupler = self->core,
                       .quiet = self->pace != NULL,
                       .signals = run.signals,
                       .woken = run.woken};
    const pma_poll poll = {pma_watch_signals, &watch, POLL_ENTRIES};
    pma_caller before = pma_gil_release();
    status = pma_coupler_advance(self->core, steps, obj == Py_None ? NULL : &record, &poll);
    pma_gil_acquire(before);

    result = status == PMA_OK ? Py_NewRef(Py_None) : pma_failure(self, status);
done:
    pma_release_pace(self, &run);
    pma_coupler_release(self);
    Py_DECREF(arrays);
    return result;
}

/* The same. */
static PyObject *coupler_record_present(CouplerObject *self, PyObject *obj)
{
    pma_record record = {0};
    PyObject *result = NULL;
    PyObject *arrays = PyList_New(0);
    if (!arrays || pma_coupler_claim(self) < 0) {
        Py_XDECREF(arrays);
        return NULL;
    }
    const bool taken =
        pma_take_record(self, obj, pma_coupler_step_count(self->core), arrays, &record) == 0;
    const bool met = !self->processes || meet(self, taken ? PMA_OK : PMA_NO_MEMORY) == PMA_OK;
    if (taken && met) {
        pma_coupler_record_present(self->core, &record);
        result = Py_NewRef(Py_None);
    } else if (taken) {
        result = pma_failure(self, PMA_ELSEWHERE);
    }
    pma_coupler_release(self);
    Py_DECREF(arrays);
    return result;
}

static PyObject *coupler_set_origin(CouplerObject *self, PyObject *args)
{
    long long number;
    double t;
    if (!PyArg_ParseTuple(args, "Ld", &number, &t))
        return NULL;
    if (number < 0 || number > pma_coupler_most_steps(self->core) || !isfinite(t))
        return PyErr_Format(PyExc_ValueError, "an origin must be a macro step and its time");
    if (pma_coupler_claim(self) < 0)
        return NULL;
    pma_coupler_set_origin(self->core, number, t);
    pma_coupler_release(self);
    Py_RETURN_NONE;
}

static PyObject *coupler_start(CouplerObject *self, PyObject *args)
{
    long long step_count;
    PyObject *lam_obj, *g_obj;
    const double *lam, *g;
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    if (!PyArg_ParseTuple(args, "LOO", &step_count, &lam_obj, &g_obj) ||
        pma_take_doubles(lam_obj, p, "lam", NULL, &lam) < 0 ||
        pma_take_doubles(g_obj, p, "g", NULL, &g) < 0)
        return NULL;
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const bool fits = step_count >= pma_coupler_origin(self->core) &&
                      step_count <= pma_coupler_most_steps(self->core);
    if (fits)
        pma_coupler_start(self->core, step_count, lam, g);
    pma_coupler_release(self);
    return fits ? Py_NewRef(Py_None)
                : PyErr_Format(PyExc_ValueError,
                               "step_count must not be before the origin nor overflow, got %lld",
                               step_count);
}

static PyObject *coupler_get_step_count(CouplerObject *self, void *Py_UNUSED(closure))
{
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const int64_t count = pma_coupler_step_count(self->core);
    pma_coupler_release(self);
    return PyLong_FromLongLong(count);
}

/* a copy of a (p,) array of the present time level */
static PyObject *copy_rows(CouplerObject *self, const double *(*get)(const pma_coupler *))
{
    if (pma_coupler_claim(self) < 0)
        return NULL;
    const npy_intp p = (npy_intp)pma_coupler_get_parts(self->core)->p;
    PyObject *copy = pma_new_vector(p, get(self->core));
    pma_coupler_release(self);
    return copy;
}

static PyObject *coupler_get_multipliers(CouplerObject *self, void *Py_UNUSED(closure))
{
    return copy_rows(self, pma_coupler_multipliers);
}

static PyObject *coupler_get_prescribed(CouplerObject *self, void *Py_UNUSED(closure))
{
    return copy_rows(self, pma_coupler_prescribed);
}

static PyObject *coupler_get_paced(CouplerObject *self, void *Py_UNUSED(closure))
{
    return PyBool_FromLong(self->pace != NULL);
}

static PyObject *coupler_get_threads(CouplerObject *self, void *Py_UNUSED(closure))
{
    return PyLong_FromSize_t(pma_coupler_threads(self->core));
}

static PyObject *coupler_get_instants(CouplerObject *self, void *Py_UNUSED(closure))
{
    return PyLong_FromSize_t(pma_coupler_instants(self->core));
}

static PyObject *coupler_get_workers(CouplerObject *self, void *Py_UNUSED(closure))
{
    const size_t count = (size_t)PyTuple_Size(self->subdomains);
    const size_t first = pma_processes_first(self->processes);
    PyObject *workers = PyTuple_New((Py_ssize_t)count);
    for (size_t i = 0; workers && i < count; i++) {
        const size_t worker = pma_coupler_worker(self->core, first + i);
        PyObject *entry =
            worker == PMA_ALL_WORKERS ? Py_NewRef(Py_None) : PyLong_FromSize_t(worker);
        if (entry)
            PyTuple_SetItem(workers, (Py_ssize_t)i, entry);
        else
            Py_CLEAR(workers);
    }
    return workers;
}

static PyMethodDef coupler_methods[] = {
    {"start", (PyCFunction)coupler_start, METH_VARARGS,
     "start(step_count, lam, g): sets the macro step, the multipliers and g"},
    {"set_origin", (PyCFunction)coupler_set_origin, METH_VARARGS,
     "set_origin(number, t): macro steps are counted from this one, at time t; before start"},
    {"set_motion", (PyCFunction)pma_coupler_object_set_motion, METH_VARARGS,
     "set_motion(i, load): the velocity of a prescribed motion, in the forms of a load"},
    {"advance", (PyCFunction)coupler_advance, METH_VARARGS,
     "advance(steps, record, report=None) -> None, or {kind, ...} of what ended it; "
     "report(step_count) is called about every 50 ms"},
    {"set_pace", (PyCFunction)pma_coupler_object_set_pace, METH_O,
     "set_pace(None | {period, stops, signals, woken, state, times, monitored, values}): fine "
     "steps of later advances begin every `period` ns; state (3,) has their beginning, number and "
     "shift in ns, times (5, rows) when they began, commanded, received and ended, and their "
     "shifts in s; signals is a file to which those are written, or -1: then woken() is called, "
     "which may raise; monitored has {positions, last} or None by subdomain, values their commands "
     "and forces"},
    {"set_ring", (PyCFunction)pma_coupler_object_set_ring, METH_O,
     "set_ring(None | steps): records have rows for steps.size recorded macro steps, used in turn; "
     "steps, of int64, begins with -1"},
    {"ring", (PyCFunction)pma_coupler_object_ring, METH_O,
     "ring(read) -> (written, lost): `read` recorded macro steps were read; all are written or "
     "lost up to step `written`, and `lost` were lost. From any thread"},
    {"record_present", (PyCFunction)coupler_record_present, METH_O,
     "record_present(record) -> None or {kind, rank}: writes the present time level into row 0"},
    {"in_lanes", (PyCFunction)pma_coupler_in_lanes, METH_O,
     "in_lanes(subdomains): the same problem PMA_LANES times, with the subdomains in lanes"},
    {"numbers", (PyCFunction)pma_coupler_object_numbers, METH_NOARGS,
     "numbers() -> {name: copy} of the present, beside the subdomains: pma_coupler_arrays"},
    {"check_numbers", (PyCFunction)pma_coupler_object_check_numbers, METH_O,
     "check_numbers(numbers): ValueError unless set_numbers takes them"},
    {"set_numbers", (PyCFunction)pma_coupler_object_set_numbers, METH_O,
     "set_numbers(numbers): the inverse, after start"},
    {"contact_compliance", (PyCFunction)pma_coupler_object_compliance, METH_O,
     "contact_compliance(start) -> (rows * rows,) W by columns, of the first macro step or later"},
    {"contact_turns", (PyCFunction)pma_coupler_object_turns, METH_NOARGS,
     "contact_turns() -> how often the last impulses without friction were solved for"},
    {"set_obstacle", (PyCFunction)pma_coupler_object_set_obstacle, METH_O,
     "set_obstacle(load): d and d' of the obstacles of contacts, in the forms of a load"},
    {NULL, NULL, 0, NULL},
};

static PyGetSetDef coupler_getset[] = {
    {"step_count", (getter)coupler_get_step_count, NULL, "macro steps done", NULL},
    {"multipliers", (getter)coupler_get_multipliers, NULL, "at the present, a copy", NULL},
    {"instants", (getter)coupler_get_instants, NULL, "interface problems in a macro step", NULL},
    {"paced", (getter)coupler_get_paced, NULL, "whether a pace is set", NULL},
    {"threads", (getter)coupler_get_threads, NULL, "number of threads", NULL},
    {"workers", (getter)coupler_get_workers, NULL,
     "the worker of each subdomain, 0 the caller; None where several share its rows", NULL},
    {"prescribed", (getter)coupler_get_prescribed, NULL, "g at the present, a copy", NULL},
    {NULL, NULL, NULL, NULL, NULL},
};

static PyType_Slot coupler_slots[] = {
    {Py_tp_doc, "Coupler(subdomains, parts, processes=None)\n\n"
                "The subdomains, the interface problem and the schedule."},
    {Py_tp_new, coupler_new},
    {Py_tp_traverse, coupler_traverse},
    {Py_tp_dealloc, coupler_dealloc},
    {Py_tp_methods, coupler_methods},
    {Py_tp_getset, coupler_getset},
    {0, NULL},
};

PyType_Spec pma_coupler_spec = {
    .name = "pmalpha._core.Coupler",
    .basicsize = sizeof(CouplerObject),
    .flags = Py_TPFLAGS_DEFAULT | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_IMMUTABLETYPE,
    .slots = coupler_slots,
};
