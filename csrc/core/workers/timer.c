#define _POSIX_C_SOURCE 200809L
#include "workers/timer.h"

#if defined(_WIN32)

#define WIN32_LEAN_AND_MEAN
#include <windows.h>

int64_t pma_timer_now(void)
{
    LARGE_INTEGER count, second;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&second);
    return (int64_t)(1e9 * ((double)count.QuadPart / (double)second.QuadPart));
}

void pma_timer_sleep(int64_t until)
{
    const int64_t left = until - pma_timer_now();
    if (left > 0)
        Sleep((DWORD)((left + 999999) / 1000000));
}

#else

#include <time.h>

enum { SECOND = 1000000000 };

int64_t pma_timer_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * SECOND + now.tv_nsec;
}

#if defined(__APPLE__) /* has no clock_nanosleep */

void pma_timer_sleep(int64_t until)
{
    const int64_t left = until - pma_timer_now();
    if (left > 0)
        nanosleep(&(struct timespec){.tv_sec = left / SECOND, .tv_nsec = left % SECOND}, NULL);
}

#else

/* An absolute time: what happens between reading the clock and sleeping is not added. */
void pma_timer_sleep(int64_t until)
{
    const struct timespec end = {.tv_sec = until / SECOND, .tv_nsec = until % SECOND};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &end, NULL);
}

#endif

#endif
