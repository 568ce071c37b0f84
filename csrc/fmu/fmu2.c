/* fmu2.c - an FMU for co-simulation of FMI 2.0. The standard's headers are not needed. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fmu/fmu.h"

typedef void *component;
typedef int integer, boolean;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;
typedef void (*logger)(void *environment, const char *name, status status, const char *category,
                       const char *message, ...);
typedef struct {
    logger log;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, status status);
    void *environment;
} callbacks;

/* An instance: what it has of the model comes first. */
typedef struct {
    fmu base;
    logger log;
    void *environment;
    char *name;
} instance;

/* Names have the prefix of the compiler's command, or none. */
#if defined(FMI2_FUNCTION_PREFIX)
#define PASTE(a, b) a##b
#define PASTED(a, b) PASTE(a, b)
#define NAMED(name) PASTED(FMI2_FUNCTION_PREFIX, name)
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
        x->log(x->environment, x->name, s, "logStatusError", "%s", message);
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

/* ---- the library ---------------------------------------------------------------------------- */

EXPORT const char *NAMED(fmi2GetTypesPlatform)(void)
{
    return "default";
}

EXPORT const char *NAMED(fmi2GetVersion)(void)
{
    return "2.0";
}

EXPORT status NAMED(fmi2SetDebugLogging)(component c, boolean on, size_t count,
                                         const char *const categories[])
{
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

/* ---- an instance ---------------------------------------------------------------------------- */

static int hex(char digit)
{
    const char *const digits = "0123456789abcdef";
    const char *place =
        digit ? strchr(digits, digit >= 'A' && digit <= 'F' ? digit + 32 : digit) : NULL;
    return place ? (int)(place - digits) : -1;
}

/* The path of file:/x, file:///x or file:///C:/x, with its escapes undone, and a separator. */
static char *path_of(const char *uri)
{
    if (!uri || strncmp(uri, "file:", 5) != 0)
        return NULL;
    const char *from = uri + 5;
    if (strncmp(from, "//", 2) == 0)
        from = strchr(from + 2, '/');
    if (!from || !*from)
        return NULL;
    if (from[1] && from[2] == ':')
        from++; /* /C:/x */
    char *path = malloc(strlen(from) + 2), *to = path;
    if (!path)
        return NULL;
    while (*from) {
        const bool escaped = *from == '%' && hex(from[1]) >= 0 && hex(from[2]) >= 0;
        *to++ = escaped ? (char)(16 * hex(from[1]) + hex(from[2])) : *from;
        from += escaped ? 3 : 1;
    }
    if (to > path && to[-1] != '/')
        *to++ = '/';
    *to = '\0';
    return path;
}

EXPORT component NAMED(fmi2Instantiate)(const char *name, int type, const char *guid,
                                        const char *location, const callbacks *functions,
                                        boolean visible, boolean on)
{
    const char *const own = name ? name : "";
    instance *x = calloc(1, sizeof *x + strlen(own) + 1);
    (void)visible, (void)on;
    if (!x)
        return NULL;
    x->name = strcpy((char *)(x + 1), own);
    x->log = functions ? functions->log : NULL;
    x->environment = functions ? functions->environment : NULL;
    char *path = path_of(location);
    const bool opened = type == 1 && guid && fmu_open(&x->base, guid, path);
    free(path);
    if (opened)
        return x;
    report(x, ERROR, type == 1 ? x->base.message : "the FMU is one for co-simulation");
    fmu_close(&x->base);
    return NULL;
}

EXPORT void NAMED(fmi2FreeInstance)(component c)
{
    if (c)
        fmu_close(c);
}

EXPORT status NAMED(fmi2SetupExperiment)(component c, boolean has_tolerance, double tolerance,
                                         double start, boolean has_stop, double stop)
{
    instance *x = c;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return done(x, fmu_check_start(&x->base, start));
}

EXPORT status NAMED(fmi2EnterInitializationMode)(component c)
{
    instance *x = c;
    return done(x, fmu_enter(&x->base));
}

EXPORT status NAMED(fmi2ExitInitializationMode)(component c)
{
    instance *x = c;
    return done(x, fmu_exit(&x->base));
}

EXPORT status NAMED(fmi2Terminate)(component c)
{
    instance *x = c;
    return done(x, fmu_terminate(&x->base));
}

EXPORT status NAMED(fmi2Reset)(component c)
{
    instance *x = c;
    fmu_reset(&x->base);
    return OK;
}

/* ---- variables ------------------------------------------------------------------------------ */

EXPORT status NAMED(fmi2GetReal)(component c, const unsigned references[], size_t count,
                                 double values[])
{
    instance *x = c;
    for (size_t i = 0; i < count; i++) {
        if (!fmu_get(&x->base, references[i], &values[i]))
            return report(x, ERROR, x->base.message);
    }
    return OK;
}

EXPORT status NAMED(fmi2SetReal)(component c, const unsigned references[], size_t count,
                                 const double values[])
{
    instance *x = c;
    for (size_t i = 0; i < count; i++) {
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

EXPORT status NAMED(fmi2GetInteger)(component c, const unsigned r[], size_t count, integer v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2GetBoolean)(component c, const unsigned r[], size_t count, boolean v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2GetString)(component c, const unsigned r[], size_t count, const char *v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2SetInteger)(component c, const unsigned r[], size_t count,
                                    const integer v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2SetBoolean)(component c, const unsigned r[], size_t count,
                                    const boolean v[])
{
    (void)r, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2SetString)(component c, const unsigned r[], size_t count,
                                   const char *const v[])
{
    (void)r, (void)v;
    return none(c, count);
}

/* ---- states --------------------------------------------------------------------------------- */

EXPORT status NAMED(fmi2GetFMUstate)(component c, void **state)
{
    instance *x = c;
    return done(x, fmu_save(&x->base, state));
}

EXPORT status NAMED(fmi2SetFMUstate)(component c, void *state)
{
    instance *x = c;
    return done(x, fmu_restore(&x->base, state));
}

EXPORT status NAMED(fmi2FreeFMUstate)(component c, void **state)
{
    (void)c;
    fmu_free(state);
    return OK;
}

EXPORT status NAMED(fmi2SerializedFMUstateSize)(component c, void *state, size_t *size)
{
    (void)c;
    *size = fmu_state_size(state);
    return OK;
}

EXPORT status NAMED(fmi2SerializeFMUstate)(component c, void *state, char bytes[], size_t size)
{
    instance *x = c;
    return done(x, fmu_serialize(&x->base, state, bytes, size));
}

EXPORT status NAMED(fmi2DeSerializeFMUstate)(component c, const char bytes[], size_t size,
                                             void **state)
{
    instance *x = c;
    return done(x, fmu_deserialize(&x->base, bytes, size, state));
}

/* ---- steps ---------------------------------------------------------------------------------- */

EXPORT status NAMED(fmi2DoStep)(component c, double point, double length, boolean keeps)
{
    instance *x = c;
    (void)keeps;
    return done(x, fmu_step(&x->base, point, length));
}

EXPORT status NAMED(fmi2CancelStep)(component c)
{
    return unsupported(c);
}

EXPORT status NAMED(fmi2GetStatus)(component c, int kind, status *value)
{
    (void)kind, (void)value;
    return unsupported(c) == OK ? OK : DISCARD;
}

EXPORT status NAMED(fmi2GetRealStatus)(component c, int kind, double *value)
{
    const instance *x = c;
    if (kind != 2) /* the last successful time */
        return DISCARD;
    *value = pmalpha_time(x->base.model);
    return OK;
}

EXPORT status NAMED(fmi2GetIntegerStatus)(component c, int kind, integer *value)
{
    (void)c, (void)kind, (void)value;
    return DISCARD;
}

EXPORT status NAMED(fmi2GetBooleanStatus)(component c, int kind, boolean *value)
{
    (void)c;
    if (kind != 3) /* terminated */
        return DISCARD;
    *value = 0;
    return OK;
}

EXPORT status NAMED(fmi2GetStringStatus)(component c, int kind, const char **value)
{
    (void)c, (void)kind, (void)value;
    return DISCARD;
}

EXPORT status NAMED(fmi2SetRealInputDerivatives)(component c, const unsigned r[], size_t count,
                                                 const integer order[], const double v[])
{
    instance *x = c;
    for (size_t i = 0; i < count; i++) {
        if (!fmu_set_slope(&x->base, r[i], order[i], v[i]))
            return report(x, ERROR, x->base.message);
    }
    return OK;
}

EXPORT status NAMED(fmi2GetRealOutputDerivatives)(component c, const unsigned r[], size_t count,
                                                  const integer order[], double v[])
{
    (void)r, (void)order, (void)v;
    return none(c, count);
}

EXPORT status NAMED(fmi2GetDirectionalDerivative)(component c, const unsigned unknown[],
                                                  size_t unknowns, const unsigned known[],
                                                  size_t count, const double seed[],
                                                  double result[])
{
    (void)unknown, (void)unknowns, (void)known, (void)count, (void)seed, (void)result;
    return unsupported(c);
}
