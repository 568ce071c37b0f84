/* binding.h - declarations shared by the files of the binding.
 *
 * The binding converts arguments and results and calls the core; it contains no algebra. Included
 * before any other header, since Python.h decides what these declare. */
#ifndef PMA_BINDING_H
#define PMA_BINDING_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>

#define PY_ARRAY_UNIQUE_SYMBOL pmalpha_core_array_api
#include <numpy/arrayobject.h>

#include <stdatomic.h>
#include <stdbool.h>
#include <string.h>

#include "algebra/lanes.h"
#include "couple/coupler.h"
#include "describe/describe.h"
#include "describe/field.h"
#include "factor/elimination.h"
#include "status.h"
#include "subdomain/remote.h"
#include "subdomain/subdomain.h"
#include "workers/denormals.h"
#include "workers/team.h"

/* ---- objects ---------------------------------------------------------------------------- */

typedef struct SubdomainObject {
    PyObject_HEAD
    pma_subdomain *core;
    PyObject *arrays;           /* list: the arrays that the core points into */
    PyObject *load;             /* list: the arrays of the load */
    pma_team *team;             /* of those that factor tangents, or NULL */
    PyObject *mass;             /* list: the arrays of M, while energies are summed */
    PyObject *response;         /* list: the arrays of the stored unit responses */
    struct SubdomainObject *of; /* in lanes: the subdomain of each; else NULL */
    atomic_bool busy;           /* in use by a call */
} SubdomainObject;

/* The subdomains of other processes, and how to reach them (exchange.c). */
typedef struct pma_processes pma_processes;

typedef struct {
    PyObject_HEAD
    pma_coupler *core;
    pma_interface H_start, H; /* factors of the interface matrix */
    PyObject *subdomains;     /* tuple of SubdomainObject */
    PyObject *arrays;         /* list: the arrays that the core points into */
    PyObject *motions;        /* list: the arrays of each prescribed motion */
    PyObject *obstacle;       /* list: the arrays of obstacles of contacts, or NULL */
    pma_processes *processes; /* the others, or NULL */
    PyObject *pace;           /* as set_pace describes it, or NULL */
    pma_ring ring;            /* of the record, if `slots` is set */
    PyObject *slots;          /* its array, or NULL */
    atomic_bool busy;
} CouplerObject;

/* Subdomain i of a coupler. */
static inline SubdomainObject *pma_subdomain_of(CouplerObject *self, Py_ssize_t i)
{
    return (SubdomainObject *)PyTuple_GetItem(self->subdomains, i);
}

typedef struct {
    PyTypeObject *subdomain_type;
    PyTypeObject *coupler_type;
    PyTypeObject *guard_type;
    PyTypeObject *one_thread_type;
} module_state;

/* Exchanges two references: the old one is dropped after the object is released, since that can run
 * Python code. */
static inline void pma_swap(PyObject **slot, PyObject **value)
{
    PyObject *old = *slot;
    *slot = *value;
    *value = old;
}

/* Marks the subdomain busy until `release`; false with a RuntimeError if it is so already. Whatever
 * reads or writes more than its constant parts claims it, also for a moment: other threads run
 * where the GIL is released or does not exist. In between no Python code runs but the user's
 * functions. */
bool pma_subdomain_claim(SubdomainObject *self);
void pma_subdomain_release(SubdomainObject *self);

/* The same of a coupler with all its subdomains; -1 with a RuntimeError if one of them is busy. */
int pma_coupler_claim(CouplerObject *self);
void pma_coupler_release(CouplerObject *self);

/* Methods of Coupler that are in a file of their own, state_methods.c. */
PyObject *pma_coupler_object_set_motion(CouplerObject *self, PyObject *args);
PyObject *pma_coupler_object_numbers(CouplerObject *self, PyObject *ignored);
PyObject *pma_coupler_object_check_numbers(CouplerObject *self, PyObject *obj);
PyObject *pma_coupler_object_set_numbers(CouplerObject *self, PyObject *obj);

/* ... and in contact.c. */
PyObject *pma_coupler_object_compliance(CouplerObject *self, PyObject *obj);
PyObject *pma_coupler_object_turns(CouplerObject *self, PyObject *ignored);
PyObject *pma_coupler_object_set_obstacle(CouplerObject *self, PyObject *obj);

/* Methods of the type that are in a file of their own, response_methods.c. */
PyObject *pma_subdomain_compliance(SubdomainObject *self, PyObject *args);
PyObject *pma_subdomain_unit_responses(SubdomainObject *self, PyObject *args);
PyObject *pma_subdomain_accelerate(SubdomainObject *self, PyObject *obj);
PyObject *pma_subdomain_store_responses(SubdomainObject *self, PyObject *obj);

/* ... and in works.c */
PyObject *pma_subdomain_get_works(SubdomainObject *self, PyObject *none);
PyObject *pma_subdomain_go_on(SubdomainObject *self, PyObject *works);
PyObject *pma_subdomain_get_functions(SubdomainObject *self, PyObject *steps);
PyObject *pma_subdomain_take_functions(SubdomainObject *self, PyObject *args);

/* ... in rig.c. */
PyObject *pma_coupler_object_set_pace(CouplerObject *self, PyObject *obj);
PyObject *pma_coupler_object_set_ring(CouplerObject *self, PyObject *obj);
PyObject *pma_coupler_object_ring(CouplerObject *self, PyObject *obj);

/* ... in cases.c: several load cases side by side. */
PyObject *pma_subdomain_in_lanes(SubdomainObject *self, PyObject *ignored);
PyObject *pma_coupler_in_lanes(CouplerObject *self, PyObject *subdomains);

/* The core of a coupler whose subdomains are set. */
int pma_coupler_fill(CouplerObject *self, pma_coupler_parts *parts);

/* ... and in state_methods.c. */
PyObject *pma_subdomain_iteration(SubdomainObject *self, PyObject *ignored);
PyObject *pma_subdomain_set_iteration(SubdomainObject *self, PyObject *obj);
PyObject *pma_subdomain_object_levels(SubdomainObject *self, PyObject *ignored);
PyObject *pma_subdomain_object_check_levels(SubdomainObject *self, PyObject *obj);
PyObject *pma_subdomain_object_set_levels(SubdomainObject *self, PyObject *obj);

extern PyMethodDef pma_factor_functions[];
extern PyMethodDef pma_matrix_functions[];
extern PyMethodDef pma_spring_functions[];
extern PyMethodDef pma_specimen_functions[];
extern PyMethodDef pma_frozen_functions[];
PyObject *pma_spring_laws(void);
extern PyMethodDef pma_estimate_functions[];
extern PyMethodDef pma_case_functions[];
extern PyType_Spec pma_subdomain_spec;
extern PyType_Spec pma_coupler_spec;
extern PyType_Spec pma_guard_spec;
extern PyType_Spec pma_one_thread_spec;

/* ---- work without the GIL -------------------------------------------------------------------- */

typedef struct {
    long long last;             /* ms */
    PyObject *report;           /* called with the macro steps done, or NULL */
    const pma_coupler *coupler; /* the coupler that counts these steps */
    bool quiet;                 /* the GIL is not taken until a signal arrives in `signals` */
    int signals;                /* a file, read without waiting */
    PyObject *woken;            /* called without arguments when anything arrived, or NULL */
} pma_watch;

/* A pace with its clock; zeroed but for the clock where none was set. */
typedef struct {
    pma_pace pace;
    int64_t *state;  /* 3: origin, done and shift of the pace, written when it is released */
    int signals;     /* a file to which signals are written, or -1 */
    PyObject *woken; /* called when anything was written there, or NULL */
} pma_paced_run;

/* The pace of the coupler and its subdomains for `steps` macro steps, if one was set, until it is
 * released, also after an error. Both with the coupler claimed. */
int pma_take_pace(CouplerObject *self, long long steps, PyObject *arrays, pma_paced_run *run);
void pma_release_pace(CouplerObject *self, pma_paced_run *run);

long long pma_watch_milliseconds(void); /* of a monotonic clock */

/* True if a signal or the report raised an exception; checked at most every 50 ms. Called without
 * the GIL. */
bool pma_watch_signals(void *watch);

/* What a thread had before it entered the core; no thread state where it is not in the core. */
typedef struct {
    PyThreadState *thread;
    pma_denormals denormals;
} pma_caller;

/* This thread releases the GIL to enter the core, where denormal numbers are zero, and takes it
 * again afterwards, given what release returned: a compiled function that takes the GIL by itself
 * may enter the core in between. */
pma_caller pma_gil_release(void);
void pma_gil_acquire(pma_caller before);

/* A callback from the core, in the thread that called it: acquires the GIL if it was released, runs
 * call(ctx) with the denormal numbers of the caller, and releases the GIL again. Returns the result
 * of call. */
int pma_gil_call(int (*call)(void *ctx), void *ctx);

/* ---- errors ------------------------------------------------------------------------------ */

/* Sets the exception of a status other than PMA_OK and returns NULL. */
PyObject *pma_raise(pma_status status, const char *what);

/* 0 for PMA_OK, else -1 with that exception; -1 with the exception of a type and a format. */
#define pma_check(status, what) ((status) == PMA_OK ? 0 : (pma_raise(status, what), -1))
#define pma_refuse(...) (PyErr_Format(__VA_ARGS__), -1)

/* {kind, ...} of what ended an advance, for Python to raise: see core_failure.py; NULL with the
 * exception of any other status. */
PyObject *pma_failure(CouplerObject *self, pma_status status);

/* ... of the limit that subdomain i exceeded last */
PyObject *pma_breach_of(const pma_subdomain *s, size_t i);

/* ---- conversion: each returns 0, or -1 with an exception set ------------------------------- */

/* A C-contiguous, aligned array of exactly this type, borrowed; keep it in `arrays`. A negative
 * extent accepts any. */
int pma_take_array(PyObject *obj, int type, int ndim, const npy_intp *shape, const char *name,
                   PyObject *arrays, PyArrayObject **out);

/* The data of one with a single axis; a length of -1 is any, and is set. */
int pma_take_vector(PyObject *obj, int type, npy_intp *length, const char *name, PyObject *arrays,
                    void *out);
int pma_take_doubles(PyObject *obj, npy_intp count, const char *name, PyObject *arrays,
                     const double **out);

/* A writeable array of doubles; an array of positions in 0..size-1. */
int pma_take_output(PyObject *obj, int ndim, const npy_intp *shape, const char *name,
                    PyArrayObject **out);
int pma_take_positions(PyObject *obj, size_t size, const char *name, PyObject *arrays,
                       size_t *count, const int64_t **out);

/* A new array of this type, zeroed; its data in *data. */
PyObject *pma_new_array(npy_intp length, int type, void *data);

/* A new tuple, which takes these references over; NULL where one of them is NULL. */
PyObject *pma_pack(Py_ssize_t count, PyObject *const *items);

/* ---- by named fields: describe/describe.h has what is taken from which ---------------------- */

/* An argument as a tree of fields. */
typedef struct {
    pma_fields fields;
    pma_node *nodes;
    PyObject *arrays; /* list: what it points into, and what is taken from it */
} pma_argument;

/* Its root; a new list for NULL. An argument that cannot be read is None, with an exception set. To
 * be ended with what came of it: 0, or -1 with an exception set. */
pma_field pma_read(pma_argument *arg, PyObject *obj, const char *name, PyObject *arrays);
int pma_end(pma_argument *arg, pma_status status);

/* What one taker of the core takes from an argument. */
int pma_take_matrix(PyObject *obj, npy_intp n, const char *name, PyObject *arrays, pma_matrix *out);
int pma_take_numeric(PyObject *obj, npy_intp n, PyObject *arrays, pma_numeric_parts *out);
int pma_take_factor(PyObject *obj, npy_intp n, pma_factor *out);
int pma_take_bordered(PyObject *factor, PyObject *link, npy_intp n, npy_intp nb, pma_factor *f,
                      pma_link *L); /* and the link of its last nb unknowns */
int pma_take_springs(PyObject *obj, PyObject *arrays, pma_springs *out);
int pma_take_specimen(PyObject *obj, npy_intp n, PyObject *arrays, pma_specimen **out);
int pma_take_coupler(PyObject *obj, PyObject *arrays, const pma_members *members,
                     pma_coupler_taken *out);
int pma_take_subdomain(PyObject *obj, PyObject *arrays, pma_subdomain_taken *out);

/* ... a load on n dofs, or PMA_LANES of them: a new list of what it points into, or NULL. */
PyObject *pma_take_load(PyObject *obj, size_t n, bool in_lanes, pma_load *out);

/* What a function of the user, or a capsule of BLAS, is to the core (field.h, pma_role). */
int pma_find_restoring(PyObject *obj, pma_function *out);
int pma_find_internal(PyObject *obj, pma_store *store, pma_internal_force *out);
int pma_find_potential(PyObject *obj, pma_internal_force *out);
int pma_find_load(PyObject *obj, pma_load *out);
int pma_find_blas(PyObject *capsule, bool dgemm, pma_blas *out);

/* Capsules of scipy.linalg.cython_blas */
int pma_take_blas(PyObject *dgemm, PyObject *dtrsm, pma_blas *blas);

/* work(ctx, worker) by this thread and the others of a team, by this one alone where the system
 * refuses threads; this one calls look(ctx) while it waits. */
void pma_work_together(pma_team *team, pma_work work, void (*look)(void *ctx), void *ctx);

/* A crew of these threads, which are those of *team, a new one; none for a single thread. */
int pma_take_crew(Py_ssize_t threads, pma_team **team, pma_crew *out);

/* the user's dof at each position of the elimination order */
int pma_take_order(PyObject *obj, npy_intp n, PyObject *arrays, const int64_t **out);

/* Address and user data of a scipy.LowLevelCallable; NULL without an exception for another object
 */
void *pma_address_of(PyObject *obj, void **user);

/* True for a scipy.LowLevelCallable */
bool pma_is_compiled(PyObject *obj);

/* {begin, every, selections, multipliers, velocity_jump, displacement_jump, energy, contacts} with
 * all rows up to macro step `end`; selections has for each subdomain None or {position, u, v, a,
 * springs, outputs, internal}, in lanes a tuple of them. It points into what is in `arrays`. */
int pma_take_record(CouplerObject *self, PyObject *obj, int64_t end, PyObject *arrays,
                    pma_record *record);

/* None, or {rank, remotes, first, all, counts, starts, gather}: remotes has None for the
 * subdomains of this process, else {nb, substeps, h, doubled, continues, has_internal, link,
 * rows}; first (ranks + 1) the subdomains of each rank; all, counts and starts as in
 * pma_exchange_parts; gather a callable that fills `all`, or {address, type, communicator} of
 * MPI_Allgatherv. *out is the caller's to release, also after an error. */
int pma_take_processes(PyObject *obj, PyObject *arrays, pma_processes **out);
void pma_release_processes(pma_processes *x); /* NULL is allowed, and means one process below */
size_t pma_processes_count(const pma_processes *x, size_t own); /* of subdomains in all of them */
size_t pma_processes_first(const pma_processes *x);             /* of these, the first one here */
int pma_processes_fill(const pma_processes *x, size_t own, pma_member *members);
int pma_processes_check(const pma_processes *x, const pma_member *members); /* 0, or -1 */
const pma_exchange_parts *pma_processes_parts(const pma_processes *x);

/* A new array of length n with a copy of x, or NULL. */
PyObject *pma_new_vector(npy_intp n, const double *x);

#endif
