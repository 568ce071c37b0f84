/* Work without the GIL, interrupted every 50 ms to check signals and to report progress. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include "workers/thread.h"

#if defined(_WIN32)
#include <io.h>
#include <windows.h>
#else
#include <unistd.h>
#endif

enum { WATCH_MILLISECONDS = 50 };

long long pma_watch_milliseconds(void)
{
    return pma_timer_now() / 1000000;
}

/* ---- the GIL ------------------------------------------------------------------------------ */

/* What this thread had before it entered the core, while it is there without the GIL. */
static _Thread_local pma_caller released;

pma_caller pma_gil_release(void)
{
    const pma_caller before = released;
    released = (pma_caller){PyEval_SaveThread(), pma_denormals_flush()};
    return before;
}

void pma_gil_acquire(pma_caller before)
{
    const pma_caller caller = released;
    released = before;
    pma_denormals_restore(caller.denormals);
    PyEval_RestoreThread(caller.thread);
}

int pma_gil_call(int (*call)(void *ctx), void *ctx)
{
    if (!released.thread)
        return call(ctx);
    const pma_caller before = released;
    released.thread = NULL; /* what runs now may enter the core again */
    pma_denormals_restore(before.denormals);
    /* also where a compiled function holds the GIL that it has taken by itself */
    const PyGILState_STATE state = PyGILState_Ensure();
    const int result = call(ctx);
    PyGILState_Release(state);
    (void)pma_denormals_flush();
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

static bool woken_fails(const pma_watch *watch)
{
    if (!watch->woken)
        return false;
    PyObject *result = PyObject_CallNoArgs(watch->woken);
    Py_XDECREF(result);
    return !result;
}

static int check_signals(void *ctx)
{
    return PyErr_Occurred() || PyErr_CheckSignals() < 0 || woken_fails(ctx) || report_fails(ctx);
}

#if defined(_WIN32)

/* Is anything written in the pipe, if there is one? Does not wait, for which no flag is needed. */
static bool has_arrived(int fd)
{
    char buffer[64];
    DWORD count = 0;
    if (fd < 0 || !PeekNamedPipe((HANDLE)_get_osfhandle(fd), NULL, 0, NULL, &count, NULL))
        return false;
    return count > 0 && _read(fd, buffer, count < sizeof buffer ? count : sizeof buffer) > 0;
}

#else

/* The same; the file does not block. */
static bool has_arrived(int fd)
{
    char buffer[64];
    return read(fd, buffer, sizeof buffer) > 0;
}

#endif

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
