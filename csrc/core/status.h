/* status.h - what a call of the core can come back with.
 *
 * The core says which kind of thing went wrong; the binding, which knows the caller's values, says
 * what it was. */
#ifndef PMA_STATUS_H
#define PMA_STATUS_H

#include <float.h>

/* Registers of the x87 round to more digits than are written to memory: not the same numbers. */
#if FLT_EVAL_METHOD < 0 || FLT_EVAL_METHOD == 2
#error "doubles must be computed as doubles; for x86 of 32 bits: -msse2 -mfpmath=sse"
#endif

#define PMA_STATUS_LIST(X)                                        \
    X(PMA_OK, "no error")                                         \
    X(PMA_NO_MEMORY, "out of memory")                             \
    X(PMA_REFUSED, "a field is not as it has to be")              \
    X(PMA_BAD_SIZE, "sizes do not agree")                         \
    X(PMA_BAD_INDEX, "an index is out of range or not in order")  \
    X(PMA_BAD_STEP, "the lengths of steps do not agree")          \
    X(PMA_NOT_DEFINITE, "a pivot is not positive, or is lost")    \
    X(PMA_NOT_READY, "the coupler has no initial state yet")      \
    X(PMA_NOT_FINITE, "a value is not finite")                    \
    X(PMA_UNBOUNDED, "a scheme has added too much energy")        \
    X(PMA_FORCE_FAILED, "a force did not return 0")               \
    X(PMA_RESTORING_FAILED, "a restoring force did not return 0") \
    X(PMA_INTERNAL_FAILED, "an internal force did not return 0")  \
    X(PMA_UNSYMMETRIC, "a tangent is not symmetric")              \
    X(PMA_NOT_CONVERGED, "an iteration does not converge")        \
    X(PMA_SINGULAR, "a tangent is singular")                      \
    X(PMA_LIMITED, "a specimen would leave its limits")           \
    X(PMA_LATE, "a paced step has ended too late")                \
    X(PMA_NO_IMPULSES, "impulses of contacts do not converge")    \
    X(PMA_STOPPED, "stopped by the caller")                       \
    X(PMA_NO_THREADS, "the system makes no more threads")         \
    X(PMA_ELSEWHERE, "another process has failed")

#define PMA_STATUS_ENUM(code, text) code,
typedef enum { PMA_STATUS_LIST(PMA_STATUS_ENUM) } pma_status;
#undef PMA_STATUS_ENUM

/* Returns what a call has come back with, unless that is PMA_OK. */
#define PMA_TRY(call)                    \
    do {                                 \
        const pma_status tried = (call); \
        if (tried != PMA_OK)             \
            return tried;                \
    } while (0)

/* The text of a status; never NULL. */
const char *pma_status_text(pma_status status);

#endif
