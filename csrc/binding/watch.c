/* The GIL let go, and now and then meanwhile a look at signals and a report. */
#define NO_IMPORT_ARRAY
#include "binding.h"

#include <time.h>

enum { WATCH_MILLISECONDS = 50 };

static long long milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (long long)now.tv_sec * 1000 + now.tv_nsec / 1000000;
}

pma_watch pma_watch_begin(void)
{
    return (pma_watch){.thread = PyEval_SaveThread(), .last = milliseconds()};
}

void pma_watch_end(pma_watch *watch)
{
    PyEval_RestoreThread(watch->thread);
}

static bool report_fails(const pma_watch *watch)
{
    if (!watch->report)
        return false;
    PyObject *answer = PyObject_CallFunction(watch->report, "L",
                                             (long long)pma_coupler_step_count(watch->coupler));
    Py_XDECREF(answer);
    return !answer;
}

bool pma_watch_signals(void *ctx)
{
    pma_watch *watch = ctx;
    const long long now = milliseconds();
    if (now - watch->last < WATCH_MILLISECONDS)
        return false;
    PyEval_RestoreThread(watch->thread);
    const bool came = PyErr_CheckSignals() < 0 || report_fails(watch);
    watch->thread = PyEval_SaveThread();
    watch->last = milliseconds();
    return came;
}
