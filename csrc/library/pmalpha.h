/* pmalpha.h - a frozen coupler, stepped without Python.
 *
 * Coupler.freeze("model.pma", inputs=..., outputs=...) writes a model; this library opens and
 * advances it, bitwise as Coupler.run does. C99 and C++.
 *
 *     pmalpha_model *m;
 *     char why[PMALPHA_MESSAGE];
 *     if (pmalpha_open("model.pma", why, &m) != PMALPHA_OK) { puts(why); return 1; }
 *     for (;;) {                                     once in each sample
 *         pmalpha_command(m, 0, c);                  where the specimen is to be, c[0]
 *         pmalpha_set(m, 0, measured(c[0]));         the force that it answers with
 *         if (pmalpha_advance(m, 1) != PMALPHA_OK) break;
 *     }
 *     pmalpha_close(m);
 *
 * Units are those of the model, times in those of its dt. Only open and close allocate, and only
 * open calls the operating system, for the file. Nothing prints. One thread at a time works with a
 * model; models are independent of each other, also those of the same bytes. */
#ifndef PMALPHA_H
#define PMALPHA_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32) && defined(PMALPHA_BUILD)
#define PMALPHA_API __declspec(dllexport)
#elif defined(__GNUC__)
#define PMALPHA_API __attribute__((visibility("default")))
#else
#define PMALPHA_API
#endif

/* Rises when a function below changes; functions may be added without. */
#define PMALPHA_ABI 1

/* Bytes of a message, with its zero. */
#define PMALPHA_MESSAGE 256

typedef struct pmalpha_model pmalpha_model;

typedef enum {
    PMALPHA_OK = 0,
    PMALPHA_NO_MEMORY = 1,
    PMALPHA_BAD_FILE = 2,     /* no frozen model, a damaged one, or one of a later version */
    PMALPHA_BAD_ARGUMENT = 3, /* nothing has changed */
    PMALPHA_LIMITED = 4,      /* the step is done; the next command would leave the limits of the
                                 specimen and is not given: pmalpha_command has the last one */
    PMALPHA_FAILED = 5        /* the model is at an earlier step; reset or restore leads back */
} pmalpha_status;

typedef enum { PMALPHA_SPECIMEN = 0, PMALPHA_FORCE = 1, PMALPHA_VELOCITY = 2 } pmalpha_kind;

/* ---- the library ---------------------------------------------------------------------------- */

PMALPHA_API int pmalpha_abi(void); /* compare with PMALPHA_ABI */
PMALPHA_API const char *pmalpha_version(void);

/* ---- a model -------------------------------------------------------------------------------- */

/* The model of a file, which is read whole. message (PMALPHA_MESSAGE, or NULL): why it is refused;
 * *out is then NULL. */
PMALPHA_API pmalpha_status pmalpha_open(const char *path, char *message, pmalpha_model **out);

/* The same of bytes in memory, at a multiple of 8. They are only read, also by several models at a
 * time, and have to outlive them. */
PMALPHA_API pmalpha_status pmalpha_open_memory(const void *bytes, size_t size, char *message,
                                               pmalpha_model **out);
PMALPHA_API void pmalpha_close(pmalpha_model *m); /* NULL is allowed */

/* Of the last status that was not PMALPHA_OK, until the next call. */
PMALPHA_API const char *pmalpha_message(const pmalpha_model *m);

/* ---- time ----------------------------------------------------------------------------------- */

PMALPHA_API double pmalpha_step_size(const pmalpha_model *m); /* of a fine step */
PMALPHA_API size_t pmalpha_substeps(const pmalpha_model *m);  /* fine steps in a macro step; 1 under
                                                                 macro and mean coupling */
PMALPHA_API int64_t pmalpha_count(const pmalpha_model *m);    /* fine steps since their first one */
PMALPHA_API double pmalpha_time(const pmalpha_model *m);

/* ---- inputs and outputs, in the order in which they were frozen ------------------------------ */

PMALPHA_API size_t pmalpha_inputs(const pmalpha_model *m);
PMALPHA_API size_t pmalpha_outputs(const pmalpha_model *m);
PMALPHA_API const char *pmalpha_input_name(const pmalpha_model *m, size_t i); /* NULL beyond */
PMALPHA_API const char *pmalpha_output_name(const pmalpha_model *m, size_t i);
PMALPHA_API int pmalpha_find_input(const pmalpha_model *m, const char *name); /* -1: none */
PMALPHA_API int pmalpha_find_output(const pmalpha_model *m, const char *name);
PMALPHA_API pmalpha_kind pmalpha_input_kind(const pmalpha_model *m, size_t i);

/* The command of a specimen for the coming substep: c[0] displacement, c[1] velocity, as its
 * compensators make them, c[2] acceleration, which is the structure's. 1: a new one; 0: that of a
 * substep which lasts on, or of no specimen (zeros). */
PMALPHA_API int pmalpha_command(const pmalpha_model *m, size_t i, double c[3]);

/* An input, held until it is set again: the force of a specimen at its command, as a restoring
 * force is; an external force or a velocity at the end of the coming step. It counts in the step in
 * which a substep begins. */
PMALPHA_API void pmalpha_set(pmalpha_model *m, size_t i, double value);
PMALPHA_API double pmalpha_given(const pmalpha_model *m, size_t i); /* NaN beyond */

/* An output at the time level that was reached last. NaN beyond. */
PMALPHA_API double pmalpha_get(const pmalpha_model *m, size_t i);

/* Takes this number of fine steps. */
PMALPHA_API pmalpha_status pmalpha_advance(pmalpha_model *m, size_t steps);

/* In place of pmalpha_set, for a specimen: called inside the step that ends at t, with the command.
 * Other than 0 ends the step with PMALPHA_FAILED. NULL: no longer. */
typedef int (*pmalpha_specimen)(double t, const double c[3], double *force, void *user);
PMALPHA_API void pmalpha_attach(pmalpha_model *m, size_t i, pmalpha_specimen f, void *user);

/* ---- states --------------------------------------------------------------------------------- */

/* A state is a block of bytes at a multiple of 8, of any instant, also inside a macro step; another
 * model of the same file may go on with it, in another process or machine too. Restoring takes up
 * to a macro step of time. A block of another model, a smaller or damaged one is
 * PMALPHA_BAD_ARGUMENT. */
PMALPHA_API size_t pmalpha_state_size(const pmalpha_model *m);
PMALPHA_API pmalpha_status pmalpha_save(const pmalpha_model *m, void *block, size_t size);
PMALPHA_API pmalpha_status pmalpha_restore(pmalpha_model *m, const void *block, size_t size);
PMALPHA_API void pmalpha_reset(pmalpha_model *m); /* to what was frozen */

/* ---- how long a step takes ------------------------------------------------------------------- */

/* now(user) returns ns; NULL: steps are not timed. The longest fine step since then, in ns. */
PMALPHA_API void pmalpha_clock(pmalpha_model *m, int64_t (*now)(void *user), void *user);
PMALPHA_API int64_t pmalpha_longest(const pmalpha_model *m);

#ifdef __cplusplus
}
#endif

#endif
