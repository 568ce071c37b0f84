/* fmu.h - what the FMUs of both versions of the standard are made of: a model and its variables.
 *
 * fmu2.c and fmu3.c are the functions of FMI 2.0 and 3.0. The bytes of the model are either in the
 * program (model.c, written by export_fmu) or in the resources of the FMU (resource.c): the linker
 * takes one of the two. */
#ifndef PMALPHA_FMU_H
#define PMALPHA_FMU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "library/pmalpha.h"

/* Variables by their reference: four for each input, which are the input and, of a specimen,
 * displacement, velocity and acceleration of its command; then the outputs. */
enum { FMU_EACH_INPUT = 4 };

/* What the standard allows depends on it. */
typedef enum { FMU_MADE, FMU_BEGINS, FMU_STEPS, FMU_ENDED, FMU_STAGES } fmu_stage;

typedef struct {
    pmalpha_model *model;
    void *owned; /* bytes of the model, or NULL */
    fmu_stage stage;
    bool starts_anew; /* inputs were set that the initial accelerations have not yet */
    double *slope;    /* of each input over the next communication step */
    char message[PMALPHA_MESSAGE];
} fmu;

/* The bytes of the model, at a multiple of 8: `resources` is the folder of the FMU's resources, its
 * path ends with a separator. *owned is to be freed, if it is not NULL. NULL: there is none. */
const void *fmu_bytes(const char *resources, size_t *size, void **owned);

/* The model, for the token (check sum and size) of the description. False with a message. */
bool fmu_open(fmu *f, const char *token, const char *resources);
void fmu_close(fmu *f);

/* The stages: the time at which the master begins, which must be that of the model; into and out
 * of the initialization, whose inputs are those at the start; the end; back to the beginning. False
 * with a message where the standard does not allow it. */
bool fmu_check_start(fmu *f, double start);
bool fmu_enter(fmu *f);
bool fmu_exit(fmu *f);
bool fmu_terminate(fmu *f);
void fmu_reset(fmu *f);

/* A variable; false with a message where there is none, or it cannot be set. */
bool fmu_get(fmu *f, uint32_t reference, double *value);
bool fmu_set(fmu *f, uint32_t reference, double value);

/* The derivative (order 1) of an input at the present, for the next communication step. */
bool fmu_set_slope(fmu *f, uint32_t reference, int order, double slope);

/* As many fine steps as a communication step has; false with a message, nothing changed where the
 * length is no whole number of them, or `point` not the time of the model. */
bool fmu_step(fmu *f, double point, double length);

/* States, each in a block that *state points to, or NULL: a copy of the present, made in the block
 * that is there if it has the size; the way back; the end of a block; its bytes, into and out of a
 * block of the user. False with a message, nothing changed. */
bool fmu_save(fmu *f, void **state);
bool fmu_restore(fmu *f, const void *state);
void fmu_free(void **state);
size_t fmu_state_size(const void *state);
bool fmu_serialize(fmu *f, const void *state, void *bytes, size_t size);
bool fmu_deserialize(fmu *f, const void *bytes, size_t size, void **state);

#endif
