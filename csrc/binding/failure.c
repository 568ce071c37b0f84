/* What ended an advance: an exception, or what Python needs for one. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* Subdomain i of all processes, which is one of this one. */
static SubdomainObject *own_subdomain(CouplerObject *self, size_t i)
{
    return pma_subdomain_of(self, (Py_ssize_t)(i - pma_processes_first(self->processes)));
}

static Py_ssize_t count_all(CouplerObject *self)
{
    return (Py_ssize_t)pma_coupler_get_parts(self->core)->count;
}

/* Subdomain i is one of this process, and iterated. */
static bool is_iterated(CouplerObject *self, size_t i)
{
    const size_t first = pma_processes_first(self->processes);
    const size_t own = (size_t)PyTuple_Size(self->subdomains);
    return i != PMA_INTERFACE && i >= first && i - first < own &&
           pma_subdomain_iterate(own_subdomain(self, i)->core);
}

/* True if the exception that is set is to be raised. Several threads may evaluate a callable in a
 * step that one thread would not have begun, after the failure of an earlier step or of another
 * subdomain; its exception is then cleared, except for KeyboardInterrupt. */
static bool is_raised(CouplerObject *self, pma_status status, size_t failed)
{
    if (status == PMA_NOT_FINITE || status == PMA_UNBOUNDED || status == PMA_FORCE_FAILED)
        return !PyErr_ExceptionMatches(PyExc_Exception);
    if (status != PMA_RESTORING_FAILED && status != PMA_INTERNAL_FAILED)
        return true;
    pma_subdomain *s = own_subdomain(self, failed)->core;
    return pma_subdomain_member(s).forces == PMA_BY_CALLER ||
           !PyErr_ExceptionMatches(PyExc_Exception);
}

/* A position in elimination order, None where there is none. */
static PyObject *position(bool known, size_t dof)
{
    return known && dof != SIZE_MAX ? PyLong_FromSize_t(dof) : Py_NewRef(Py_None);
}

/* The positions of the dofs where its tangent is singular, and where the force of its functions is
 * not finite; whether all values were finite. Of the interface only whether H is singular. */
static PyObject *iteration_failure(CouplerObject *self, size_t i, pma_status status)
{
    const bool singular = status == PMA_SINGULAR;
    PyObject *is_finite = status != PMA_NOT_FINITE ? Py_True : Py_False;
    if (i == PMA_INTERFACE)
        return Py_BuildValue("{sssO}", "kind", "interface", "singular",
                             singular ? Py_True : Py_False);
    const pma_iterate_failure at =
        pma_iterate_failed(pma_subdomain_iterate(own_subdomain(self, i)->core));
    return Py_BuildValue("{sssnsdsnsNsNsO}", "kind", "iteration", "subdomain", (Py_ssize_t)i, "t",
                         at.t, "corrections", (Py_ssize_t)at.iterations, "singular",
                         position(singular, at.dof), "spoiled", position(true, at.spoiled),
                         "finite", is_finite);
}

PyObject *pma_breach_of(const pma_subdomain *s, size_t i)
{
    static const char *const names[] = {"displacement", "velocity", "acceleration", "force",
                                        "energy"};
    const pma_breach b = pma_subdomain_breach(s);
    return Py_BuildValue("{sssnsssnsdsdsdsO}", "kind", "limit", "subdomain", (Py_ssize_t)i, "what",
                         names[b.what], "position", (Py_ssize_t)b.position, "value", b.value,
                         "limit", b.limit, "t", b.t, "by_clock", b.by_clock ? Py_True : Py_False);
}

/* What a function that returned a code is to a subdomain. */
static const char *what_failed(pma_status status)
{
    return status == PMA_FORCE_FAILED       ? "force"
           : status == PMA_RESTORING_FAILED ? "restoring force"
                                            : "internal force";
}

/* Of one subdomain of this process. */
static PyObject *failure_of(pma_subdomain *s, size_t i, pma_status status)
{
    if (status == PMA_LIMITED)
        return pma_breach_of(s, i);
    if (status == PMA_UNSYMMETRIC)
        return Py_BuildValue("{sssnsd}", "kind", "unsymmetric", "subdomain", (Py_ssize_t)i, "t",
                             pma_iterate_failed(pma_subdomain_iterate(s)).t);
    return Py_BuildValue("{sssnsiss}", "kind", "function", "subdomain", (Py_ssize_t)i, "code",
                         pma_subdomain_code(s), "what", what_failed(status));
}

PyObject *pma_failure(CouplerObject *self, pma_status status)
{
    const size_t i = pma_coupler_failed(self->core);
    if (PyErr_Occurred()) {
        if (is_raised(self, status, i))
            return NULL;
        PyErr_Clear();
    }
    switch (status) {
    case PMA_NOT_FINITE:
    case PMA_UNBOUNDED:
        if (status == PMA_NOT_FINITE && is_iterated(self, i))
            return iteration_failure(self, i, status);
        return Py_BuildValue("{sssn}", "kind", "unstable", "subdomain",
                             i == PMA_INTERFACE ? count_all(self) : (Py_ssize_t)i);
    case PMA_NOT_CONVERGED:
    case PMA_SINGULAR:
        return iteration_failure(self, i, status);
    case PMA_NO_IMPULSES:
        return Py_BuildValue("{sssn}", "kind", "contact", "row", (Py_ssize_t)i);
    case PMA_ELSEWHERE:
        return Py_BuildValue("{sssn}", "kind", "elsewhere", "rank",
                             (Py_ssize_t)pma_coupler_failed_rank(self->core));
    case PMA_LATE:
        return Py_BuildValue("{ss}", "kind", "late");
    case PMA_LIMITED:
    case PMA_UNSYMMETRIC:
    case PMA_FORCE_FAILED:
    case PMA_RESTORING_FAILED:
    case PMA_INTERNAL_FAILED:
        return failure_of(own_subdomain(self, i)->core, i, status);
    default:
        return pma_raise(status, "advance");
    }
}
