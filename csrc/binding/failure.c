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

/* A position in elimination order for Python, -1 where there is none */
static Py_ssize_t position(bool known, size_t dof)
{
    return known && dof != SIZE_MAX ? (Py_ssize_t)dof : -1;
}

/* (index, t, corrections, position, spoiled, finite): of the subdomain that did not converge, or of
 * the interface (None for the rest); positions of the dofs where its tangent is singular, and where
 * the force of its functions is not finite, or -1; whether all values were finite */
static PyObject *iteration_failure(CouplerObject *self, size_t i, pma_status status)
{
    const bool singular = status == PMA_SINGULAR, finite = status != PMA_NOT_FINITE;
    PyObject *is_finite = finite ? Py_True : Py_False;
    if (i == PMA_INTERFACE)
        return Py_BuildValue("(nOOnnO)", count_all(self), Py_None, Py_None, position(singular, 0),
                             (Py_ssize_t)-1, is_finite);
    const pma_iterate_failure at =
        pma_iterate_failed(pma_subdomain_iterate(own_subdomain(self, i)->core));
    return Py_BuildValue("(ndnnnO)", (Py_ssize_t)i, at.t, (Py_ssize_t)at.iterations,
                         position(singular, at.dof), position(true, at.spoiled), is_finite);
}

PyObject *pma_breach_of(const pma_subdomain *s, size_t i)
{
    static const char *const names[] = {"displacement", "velocity", "acceleration", "force",
                                        "energy"};
    const pma_breach b = pma_subdomain_breach(s);
    return Py_BuildValue("(nsndddO)", (Py_ssize_t)i, names[b.what], (Py_ssize_t)b.position, b.value,
                         b.limit, b.t, b.by_clock ? Py_True : Py_False);
}

/* What a function that returned a code is to a subdomain; NULL for any other status. */
static const char *what_failed(pma_status status)
{
    return status == PMA_FORCE_FAILED       ? "force"
           : status == PMA_RESTORING_FAILED ? "restoring force"
           : status == PMA_INTERNAL_FAILED  ? "internal force"
                                            : NULL;
}

PyObject *pma_failure(CouplerObject *self, pma_status status)
{
    const size_t i = pma_coupler_failed(self->core);
    if (PyErr_Occurred()) {
        if (is_raised(self, status, i))
            return NULL;
        PyErr_Clear();
    }
    if (status == PMA_NOT_FINITE && is_iterated(self, i))
        return iteration_failure(self, i, status);
    if (status == PMA_NOT_FINITE || status == PMA_UNBOUNDED)
        return PyLong_FromSsize_t(i == PMA_INTERFACE ? count_all(self) : (Py_ssize_t)i);
    if (status == PMA_NO_IMPULSES)
        return Py_BuildValue("(sn)", "contact", (Py_ssize_t)i);
    if (status == PMA_ELSEWHERE)
        return Py_BuildValue("(n)", (Py_ssize_t)pma_coupler_failed_rank(self->core));
    if (status == PMA_NOT_CONVERGED || status == PMA_SINGULAR)
        return iteration_failure(self, i, status);
    if (status == PMA_UNSYMMETRIC) {
        pma_subdomain *s = own_subdomain(self, i)->core;
        return Py_BuildValue("(nd)", (Py_ssize_t)i, pma_iterate_failed(pma_subdomain_iterate(s)).t);
    }
    if (status == PMA_LATE)
        return PyTuple_New(0);
    if (status == PMA_LIMITED)
        return pma_breach_of(own_subdomain(self, i)->core, i);
    if (!what_failed(status))
        return pma_raise(status, "advance");
    const int code = pma_subdomain_code(own_subdomain(self, i)->core);
    return Py_BuildValue("(nis)", (Py_ssize_t)i, code, what_failed(status));
}
