/* fmu3.c - an FMU for co-simulation of FMI 3.0. The standard's headers are not needed. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

#include "fmu/fmu.h"

typedef void *component;
typedef uint32_t reference;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } status;
typedef void (*logger)(void *environment, status status, const char *category, const char *message);
typedef void (*function)(void);

/* An instance: what it has of the model comes first. */
typedef struct {
    fmu base;
    logger log;
    void *environment;
} instance;

/* Names have the prefix of the compiler's command, or none. */
#if defined(FMI3_FUNCTION_PREFIX)
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define NAMED(name) PASTED(FMI3_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

static status report(const instance *x, status s, const char *message)
{
    if (x->log)
        x->log(x->environment, s, "logStatusError", message);
    return s;
}

/* What a function of fmu.h has returned, and why. */
static status done(const instance *x, bool well)
{
    return well ? OK : report(x, ERROR, x->base.message);
}

static status unsupported(component c)
{
    return report(c, ERROR, "the FMU has no such function");
}

/* ---- an instance ---------------------------------------------------------------------------- */

EXPORT const char *NAMED(fmi3GetVersion)(void)
{
    return "3.0";
}

EXPORT status NAMED(fmi3SetDebugLogging)(component c, bool on, size_t count,
                                         const char *const categories[])
{
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORT component NAMED(fmi3InstantiateCoSimulation)(const char *name, const char *token,
                                                    const char *resources, bool visible, bool on,
                                                    bool events, bool returns,
                                                    const reference required[], size_t count,
                                                    void *environment, logger log, function update)
{
    instance *x = calloc(1, sizeof *x);
    (void)name, (void)visible, (void)on, (void)events, (void)returns, (void)required, (void)count;
    (void)update;
    if (!x)
        return NULL;
    x->log = log;
    x->environment = environment;
    if (token && fmu_open(&x->base, token, resources))
        return x;
    report(x, ERROR, x->base.message);
    fmu_close(&x->base);
    return NULL;
}

EXPORT component NAMED(fmi3InstantiateModelExchange)(const char *name, const char *token,
                                                     const char *resources, bool visible, bool on,
                                                     void *environment, logger log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)on;
    if (log)
        log(environment, ERROR, "logStatusError", "the FMU is one for co-simulation");
    return NULL;
}

EXPORT component NAMED(fmi3InstantiateScheduledExecution)(const char *name, const char *token,
                                                          const char *resources, bool visible,
                                                          bool on, void *environment, logger log,
                                                          function update, function lock,
                                                          function unlock)
{
    (void)update, (void)lock, (void)unlock;
    return NAMED(fmi3InstantiateModelExchange)(name, token, resources, visible, on, environment,
                                               log);
}

EXPORT void NAMED(fmi3FreeInstance)(component c)
{
    if (c)
        fmu_close(c);
}

EXPORT status NAMED(fmi3EnterInitializationMode)(component c, bool has_tolerance, double tolerance,
                                                 double start, bool has_stop, double stop)
{
    instance *x = c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return done(x, fmu_check_start(&x->base, start) && fmu_enter(&x->base));
}

EXPORT status NAMED(fmi3ExitInitializationMode)(component c)
{
    instance *x = c;
    return done(x, fmu_exit(&x->base));
}

EXPORT status NAMED(fmi3Terminate)(component c)
{
    instance *x = c;
    return done(x, fmu_terminate(&x->base));
}

EXPORT status NAMED(fmi3Reset)(component c)
{
    instance *x = c;
    fmu_reset(&x->base);
    return OK;
}

/* ---- variables ------------------------------------------------------------------------------ */

EXPORT status NAMED(fmi3GetFloat64)(component c, const reference references[], size_t count,
                                    double values[], size_t size)
{
    instance *x = c;
    for (size_t i = 0; i < count && i < size; i++) {
        if (!fmu_get(&x->base, references[i], &values[i]))
            return report(x, ERROR, x->base.message);
    }
    return OK;
}

EXPORT status NAMED(fmi3SetFloat64)(component c, const reference references[], size_t count,
                                    const double values[], size_t size)
{
    instance *x = c;
    for (size_t i = 0; i < count && i < size; i++) {
        if (!fmu_set(&x->base, references[i], values[i]))
            return report(x, ERROR, x->base.message);
    }
    return OK;
}

/* There are no variables of other types: none can be named. */
static status none(component c, size_t count)
{
    return count == 0 ? OK : unsupported(c);
}

#define OF_TYPE(type, number)                                                                      \
    EXPORT status NAMED(fmi3Get##type)(component c, const reference r[], size_t count, number v[], \
                                       size_t size)                                                \
    {                                                                                              \
        (void)r, (void)v, (void)size;                                                              \
        return none(c, count);                                                                     \
    }                                                                                              \
    EXPORT status NAMED(fmi3Set##type)(component c, const reference r[], size_t count,             \
                                       const number v[], size_t size)                              \
    {                                                                                              \
        (void)r, (void)v, (void)size;                                                              \
        return none(c, count);                                                                     \
    }

typedef const char *text;
typedef const uint8_t *binary;
OF_TYPE(Float32, float)
OF_TYPE(Int8, int8_t)
OF_TYPE(UInt8, uint8_t)
OF_TYPE(Int16, int16_t)
OF_TYPE(UInt16, uint16_t)
OF_TYPE(Int32, int32_t)
OF_TYPE(UInt32, uint32_t)
OF_TYPE(Int64, int64_t)
OF_TYPE(UInt64, uint64_t)
OF_TYPE(Boolean, bool)
OF_TYPE(String, text)

EXPORT status NAMED(fmi3GetBinary)(component c, const reference r[], size_t count, size_t sizes[],
                                   binary v[], size_t size)
{
    (void)r, (void)sizes, (void)v, (void)size;
    return none(c, count);
}

EXPORT status NAMED(fmi3SetBinary)(component c, const reference r[], size_t count,
                                   const size_t sizes[], const binary v[], size_t size)
{
    (void)r, (void)sizes, (void)v, (void)size;
    return none(c, count);
}

EXPORT status NAMED(fmi3GetClock)(component c, const reference r[], size_t count, bool v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi3SetClock)(component c, const reference r[], size_t count, const bool v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi3GetNumberOfVariableDependencies)(component c, reference r, size_t *count)
{
    (void)r, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetVariableDependencies)(component c, reference dependent,
                                                 size_t of_dependent[], reference independents[],
                                                 size_t of_independents[], int kinds[],
                                                 size_t count)
{
    (void)dependent, (void)of_dependent, (void)independents, (void)of_independents, (void)kinds;
    (void)count;
    return unsupported(c);
}

/* ---- states --------------------------------------------------------------------------------- */

EXPORT status NAMED(fmi3GetFMUState)(component c, void **state)
{
    instance *x = c;
    return done(x, fmu_save(&x->base, state));
}

EXPORT status NAMED(fmi3SetFMUState)(component c, void *state)
{
    instance *x = c;
    return done(x, fmu_restore(&x->base, state));
}

EXPORT status NAMED(fmi3FreeFMUState)(component c, void **state)
{
    (void)c;
    fmu_free(state);
    return OK;
}

EXPORT status NAMED(fmi3SerializedFMUStateSize)(component c, void *state, size_t *size)
{
    (void)c;
    *size = fmu_state_size(state);
    return OK;
}

EXPORT status NAMED(fmi3SerializeFMUState)(component c, void *state, uint8_t bytes[], size_t size)
{
    instance *x = c;
    return done(x, fmu_serialize(&x->base, state, bytes, size));
}

EXPORT status NAMED(fmi3DeserializeFMUState)(component c, const uint8_t bytes[], size_t size,
                                             void **state)
{
    instance *x = c;
    return done(x, fmu_deserialize(&x->base, bytes, size, state));
}

/* ---- steps ---------------------------------------------------------------------------------- */

EXPORT status NAMED(fmi3DoStep)(component c, double point, double length, bool keeps,
                                bool *needs_event, bool *terminates, bool *returned, double *last)
{
    instance *x = c;
    (void)keeps;
    *needs_event = *terminates = *returned = false;
    const bool stepped = fmu_step(&x->base, point, length);
    *last = stepped ? point + length : pmalpha_time(x->base.model);
    return done(x, stepped);
}

EXPORT status NAMED(fmi3GetOutputDerivatives)(component c, const reference r[], size_t count,
                                              const int32_t orders[], double v[], size_t size)
{
    (void)r, (void)orders, (void)v, (void)size;
    return none(c, count);
}

/* ---- what an FMU for co-simulation without events has not ---------------------------------- */

#define ABSENT(name)                       \
    EXPORT status NAMED(name)(component c) \
    {                                      \
        return unsupported(c);             \
    }

ABSENT(fmi3EnterEventMode)
ABSENT(fmi3EnterConfigurationMode)
ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3EnterStepMode)

EXPORT status NAMED(fmi3GetDirectionalDerivative)(component c, const reference a[], size_t b,
                                                  const reference d[], size_t e, const double f[],
                                                  size_t g, double h[], size_t i)
{
    (void)a, (void)b, (void)d, (void)e, (void)f, (void)g, (void)h, (void)i;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetAdjointDerivative)(component c, const reference a[], size_t b,
                                              const reference d[], size_t e, const double f[],
                                              size_t g, double h[], size_t i)
{
    (void)a, (void)b, (void)d, (void)e, (void)f, (void)g, (void)h, (void)i;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetIntervalDecimal)(component c, const reference r[], size_t count,
                                            double v[], int q[])
{
    (void)r, (void)count, (void)v, (void)q;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetIntervalFraction)(component c, const reference r[], size_t count,
                                             uint64_t n[], uint64_t v[], int q[])
{
    (void)r, (void)count, (void)n, (void)v, (void)q;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetShiftDecimal)(component c, const reference r[], size_t count, double v[])
{
    (void)r, (void)count, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetShiftFraction)(component c, const reference r[], size_t count,
                                          uint64_t n[], uint64_t v[])
{
    (void)r, (void)count, (void)n, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetIntervalDecimal)(component c, const reference r[], size_t count,
                                            const double v[])
{
    (void)r, (void)count, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetIntervalFraction)(component c, const reference r[], size_t count,
                                             const uint64_t n[], const uint64_t v[])
{
    (void)r, (void)count, (void)n, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetShiftDecimal)(component c, const reference r[], size_t count,
                                         const double v[])
{
    (void)r, (void)count, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetShiftFraction)(component c, const reference r[], size_t count,
                                          const uint64_t n[], const uint64_t v[])
{
    (void)r, (void)count, (void)n, (void)v;
    return unsupported(c);
}

EXPORT status NAMED(fmi3UpdateDiscreteStates)(component c, bool *a, bool *b, bool *d, bool *e,
                                              bool *f, double *t)
{
    (void)a, (void)b, (void)d, (void)e, (void)f, (void)t;
    return unsupported(c);
}

EXPORT status NAMED(fmi3CompletedIntegratorStep)(component c, bool keeps, bool *a, bool *b)
{
    (void)keeps, (void)a, (void)b;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetTime)(component c, double t)
{
    (void)t;
    return unsupported(c);
}

EXPORT status NAMED(fmi3SetContinuousStates)(component c, const double v[], size_t count)
{
    (void)v, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetContinuousStateDerivatives)(component c, double v[], size_t count)
{
    (void)v, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetEventIndicators)(component c, double v[], size_t count)
{
    (void)v, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetContinuousStates)(component c, double v[], size_t count)
{
    (void)v, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetNominalsOfContinuousStates)(component c, double v[], size_t count)
{
    (void)v, (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetNumberOfEventIndicators)(component c, size_t *count)
{
    (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3GetNumberOfContinuousStates)(component c, size_t *count)
{
    (void)count;
    return unsupported(c);
}

EXPORT status NAMED(fmi3ActivateModelPartition)(component c, reference r, double t)
{
    (void)r, (void)t;
    return unsupported(c);
}
