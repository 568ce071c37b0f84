/* The subdomains of a coupler: claimed with it, and members of its core. */
#define NO_IMPORT_ARRAY
#include "binding.h"

/* ---- a busy flag, not a lock -------------------------------------------------------------- */

bool pma_subdomain_claim(SubdomainObject *self)
{
    if (!atomic_exchange(&self->busy, true))
        return true;
    PyErr_SetString(PyExc_RuntimeError, "the subdomain is being stepped");
    return false;
}

void pma_subdomain_release(SubdomainObject *self)
{
    atomic_store(&self->busy, false);
}

/* The coupler and the first `count` of its subdomains. The coupler is released last: a thread that
 * then claims it finds its subdomains free. */
static void release(CouplerObject *self, Py_ssize_t count)
{
    for (Py_ssize_t i = 0; i < count; i++)
        atomic_store(&pma_subdomain_of(self, i)->busy, false);
    atomic_store(&self->busy, false);
}

int pma_coupler_claim(CouplerObject *self)
{
    const Py_ssize_t count = PyTuple_Size(self->subdomains);
    Py_ssize_t claimed = 0;
    if (!atomic_exchange(&self->busy, true)) {
        while (claimed < count && !atomic_exchange(&pma_subdomain_of(self, claimed)->busy, true))
            claimed++;
        if (claimed == count)
            return 0;
        release(self, claimed);
    }
    return pma_refuse(PyExc_RuntimeError, "the coupler is being stepped");
}

void pma_coupler_release(CouplerObject *self)
{
    release(self, PyTuple_Size(self->subdomains));
}

/* ---- the core ------------------------------------------------------------------------------- */

/* The core, of `members`, those of this process set. */
static int create(CouplerObject *self, size_t count, pma_member *members, pma_coupler_parts *parts)
{
    if (pma_processes_fill(self->processes, (size_t)PyTuple_Size(self->subdomains), members) < 0 ||
        pma_processes_check(self->processes, members) < 0)
        return -1;
    parts->count = count;
    parts->members = members;
    parts->exchange = pma_processes_parts(self->processes);
    const pma_status status = pma_coupler_create(parts, &self->core);
    return pma_check(status, "Coupler");
}

int pma_coupler_fill(CouplerObject *self, pma_coupler_parts *parts)
{
    const size_t own = (size_t)PyTuple_Size(self->subdomains);
    const size_t count = pma_processes_count(self->processes, own);
    const size_t first = pma_processes_first(self->processes);
    pma_member *members = PyMem_Calloc(count + own + 1, sizeof *members);
    if (!members)
        return pma_check(PMA_NO_MEMORY, NULL);
    int failed = pma_coupler_claim(self);
    if (!failed) {
        for (size_t i = 0; i < own; i++)
            members[first + i] = pma_subdomain_member(pma_subdomain_of(self, (Py_ssize_t)i)->core);
        failed = create(self, count, members, parts);
        pma_coupler_release(self);
    }
    PyMem_Free(members);
    return failed;
}
