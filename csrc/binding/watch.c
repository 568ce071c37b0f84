/* Work without the GIL, interrupted every 50 ms to check signals and to report progress. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <time.h>
#include <unistd.h>

enum { WATCH_MILLISECONDS = 50 };

long long pma_watch_milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (long long)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

/* ---- the GIL ------------------------------------------------------------------------------ */

/* The thread state of this thread while it is in the core without the GIL, else NULL. */
static _Thread_local PyThreadState *released;

PyThreadState *pma_gil_release(void)
{
    PyThreadState *before = released;
    released = PyEval_SaveThread();
    return before;
}

void pma_gil_acquire(PyThreadState *before)
{
    PyThreadState *thread = released;
    released = before;
    PyEval_RestoreThread(thread);
}

int pma_gil_call(int (*call)(void *ctx), void *ctx)
{
    if (!released)
        return call(ctx);
    PyThreadState *before = released;
    released = NULL; /* what runs now may enter the core again */
    /* also where a compiled function holds the GIL that it has taken by itself */
    const PyGILState_STATE state = PyGILState_Ensure();
    const int result = call(ctx);
    PyGILState_Release(state);
    released = before;
    return result;
}

/* ---- signals and reports ------------------------------------------------------------------ */

static bool report_fails(const pma_watch *watch)
{
    if (!watch->report)
        return false;
    PyObject *result = PyObject_CallFunction(watch->report, "L",
                                             (long long)pma_coupler_step_count(watch->coupler));
    Py_XDECREF(result);
    return !result;
}

static int check_signals(void *ctx)
{
    return PyErr_Occurred() || PyErr_CheckSignals() < 0 || report_fails(ctx);
}

/* Is anything written in the file? Does not wait. */
static bool has_arrived(int fd)
{
    char buffer[64];
    return read(fd, buffer, sizeof buffer) > 0;
}

bool pma_watch_signals(void *ctx)
{
    pma_watch *watch = ctx;
    const long long now = pma_watch_milliseconds();
    if (now - watch->last < WATCH_MILLISECONDS)
        return false;
    if (watch->quiet && !watch->report && !has_arrived(watch->signals)) {
        watch->last = now;
        return false;
    }
    const int raised = pma_gil_call(check_signals, watch);
    watch->last = pma_watch_milliseconds();
    return raised != 0;
}
