/* pmalpha.h - a frozen coupler, stepped without Python.
 *
 * Coupler.freeze("model.pma", inputs=..., outputs=...) writes a model; this library opens and
 * advances it, bitwise as Coupler.run does. C99 and C++.
 *
 *     pmalpha_model *m;
 *     char why[PMALPHA_MESSAGE];
 *     double c[3];
 *     if (pmalpha_open("model.pma", why, &m) != PMALPHA_OK) return puts(why), 1;
 *     const int column = pmalpha_find_input(m, "column");
 *     do {                                      // once in each sample
 *         pmalpha_command(m, column, c);
 *         give(c[0]);                           // where the specimen is to be
 *         if (pmalpha_set(m, column, measured()) != PMALPHA_OK) break; // its force there
 *     } while (pmalpha_advance(m, 1) == PMALPHA_OK);
 *     puts(pmalpha_message(m));
 *     pmalpha_close(m);
 *
 * Units are those of the model, times in those of its dt. Only open and close allocate, and only
 * pmalpha_open calls the operating system, for the file. Nothing prints. One thread at a time works
 * with a model; models are independent of each other, also those of the same bytes. A number of an
 * input or output that is not there, such as the -1 of a name that was not found, is no input. */
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
#define PMALPHA_ABI 2

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

/* The same in memory of the caller's, aligned as that of malloc, without allocation; closing it
 * does nothing. It has to have the bytes that pmalpha_room returns, which allocates and releases
 * them (0: the file would be refused); fewer are PMALPHA_NO_MEMORY. A model that needs them on 64
 * bits needs no more on 32. */
PMALPHA_API size_t pmalpha_room(const void *bytes, size_t size);
PMALPHA_API pmalpha_status pmalpha_open_in(const void *bytes, size_t size, void *room,
                                           size_t room_size, char *message, pmalpha_model **out);

/* Of the last call that returned a status: what was wrong, or "". Until the next call. */
PMALPHA_API const char *pmalpha_message(const pmalpha_model *m);

/* ---- time ----------------------------------------------------------------------------------- */

/* Of a fine step; of the two unequal stages of a step of Bathe the mean, pmalpha_time has both. */
PMALPHA_API double pmalpha_step_size(const pmalpha_model *m);
PMALPHA_API size_t pmalpha_substeps(const pmalpha_model *m);  /* fine steps in a macro step; 1 under
                                                                 macro and mean coupling */
PMALPHA_API int64_t pmalpha_count(const pmalpha_model *m);    /* fine steps since their first one */
PMALPHA_API double pmalpha_time(const pmalpha_model *m);

/* ---- inputs and outputs, in the order in which they were frozen ------------------------------ */

PMALPHA_API size_t pmalpha_inputs(const pmalpha_model *m);
PMALPHA_API size_t pmalpha_outputs(const pmalpha_model *m);
PMALPHA_API const char *pmalpha_input_name(const pmalpha_model *m, int i); /* NULL: none */
PMALPHA_API const char *pmalpha_output_name(const pmalpha_model *m, int i);
PMALPHA_API int pmalpha_find_input(const pmalpha_model *m, const char *name); /* -1: none */
PMALPHA_API int pmalpha_find_output(const pmalpha_model *m, const char *name);
PMALPHA_API pmalpha_kind pmalpha_input_kind(const pmalpha_model *m, int i);

/* The command of a specimen for the coming substep: c[0] displacement, c[1] velocity, as its
 * compensators make them, c[2] acceleration, which is the structure's. 1: a new one; 0: that of a
 * substep which lasts on, or of no specimen (zeros). */
PMALPHA_API int pmalpha_command(const pmalpha_model *m, int i, double c[3]);

/* An input, held until it is set again: the force of a specimen at its command, as a restoring
 * force is; what an external force or a velocity adds. PMALPHA_BAD_ARGUMENT for no input, and for a
 * value that is not finite. */
PMALPHA_API pmalpha_status pmalpha_set(pmalpha_model *m, int i, double value);
PMALPHA_API double pmalpha_given(const pmalpha_model *m, int i); /* NaN: none */

/* Fine steps by which an input leads: what is set now acts at the time level that is the present
 * one plus this. Where a substep of its subdomain begins, that is its end; within one, which has
 * seen its input, the end of the next. 0: no input. */
PMALPHA_API int pmalpha_lead(const pmalpha_model *m, int i);

/* Takes the inputs that are set as those at the start, into the initial accelerations, in place of
 * the values that were frozen. PMALPHA_BAD_ARGUMENT after the first step, for a model that was
 * frozen in a run, and for a velocity that is not that of the structure. */
PMALPHA_API pmalpha_status pmalpha_begin(pmalpha_model *m);

/* An output at the time level that was reached last. NaN: none. */
PMALPHA_API double pmalpha_get(const pmalpha_model *m, int i);

/* Takes this number of fine steps. */
PMALPHA_API pmalpha_status pmalpha_advance(pmalpha_model *m, size_t steps);

/* In place of pmalpha_set, for a specimen: called inside the step that ends at t, with the command.
 * Other than 0 ends the step with PMALPHA_FAILED. NULL: no longer. PMALPHA_BAD_ARGUMENT for no
 * specimen. */
typedef int (*pmalpha_specimen)(double t, const double c[3], double *force, void *user);
PMALPHA_API pmalpha_status pmalpha_attach(pmalpha_model *m, int i, pmalpha_specimen f, void *user);

/* ---- states --------------------------------------------------------------------------------- */

/* A state is a block of bytes at a multiple of 8, of any instant, also inside a macro step; another
 * model of the same file may go on with it, in another process or machine too. Restoring takes up
 * to a macro step of time. A block of another model, a smaller or damaged one is
 * PMALPHA_BAD_ARGUMENT, and changes nothing. */
PMALPHA_API size_t pmalpha_state_size(const pmalpha_model *m);
PMALPHA_API pmalpha_status pmalpha_save(pmalpha_model *m, void *block, size_t size);
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
