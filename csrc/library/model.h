/* model.h - a frozen model from inside: what the files of the library share.
 *
 * open.c makes it of the tree of a file, pmalpha.c steps it, states.c saves and restores it. */
#ifndef PMALPHA_MODEL_H
#define PMALPHA_MODEL_H

#if defined(__FAST_MATH__)
#error "pmalpha needs arithmetic as it is written: compile without -ffast-math"
#endif

#include <stdbool.h>

#include "couple/coupler.h"
#include "describe/describe.h"
#include "describe/file.h"
#include "library/pmalpha.h"
#include "subdomain/subdomain.h"

/* The entries of a vector that are not zero. */
typedef struct {
    size_t count;
    const int64_t *at;
    const double *by;
} pmalpha_entries;

typedef struct {
    const char *name;
    pmalpha_kind kind;
    size_t member;                  /* SPECIMEN, FORCE: the subdomain */
    size_t dof, position;           /* ... the user's dof, and where it is in elimination order */
    size_t motion, row;             /* VELOCITY */
    double scale;                   /* ... divides what is set */
    double *scaled;                 /* ... that, where the motion has it; else NULL */
    double value;                   /* as set, or returned last */
    double frozen;                  /* as in the file */
    double rounding;                /* VELOCITY: by which another one at the start may differ */
    pmalpha_entries *accelerations; /* of each subdomain at the start, for a unit; or NULL */
    pmalpha_entries multipliers;    /* ... */
    double command[3];              /* SPECIMEN */
    double sent[2];                 /* ... the first two of the next one, behind compensators */
    bool is_new;                    /* ... of the coming step */
    pmalpha_specimen f;             /* ... attached, or NULL */
    void *user;
} pmalpha_input;

typedef struct {
    const char *name;
    const double *at; /* where the record has it */
    double scale;
} pmalpha_output;

/* A subdomain, with what its inputs need. */
typedef struct {
    pmalpha_model *model;
    size_t number;
    pma_subdomain *core;
    size_t specimens, forces; /* how many inputs of these kinds it has */
    size_t n;
    bool is_compensated; /* functions remember something, as compensators do */
    bool is_tried;       /* commands are computed as a whole, for limits or compensators */
    bool asks;           /* specimens are called for what they are given, not for a force */
    double *u, *v;       /* 4 n and what functions remember, n: scratch, if it is tried */
} pmalpha_member;

struct pmalpha_model {
    void *file;        /* that was read, or NULL */
    bool is_in_room;   /* of the caller's, who releases all of it */
    const void *bytes; /* of the frozen model */
    pma_fields fields;
    pma_store store;
    size_t members;
    pmalpha_member *member;
    pma_interface H_start, H;
    pma_coupler *core;
    size_t inputs, outputs;
    pmalpha_input *input;
    pmalpha_output *output;
    pma_record record;
    int64_t origin; /* macro step from which they are counted, at time t0 */
    double t0;
    pmalpha_status state; /* OK, LIMITED, FAILED: may it advance? */
    bool begins;          /* the start is that of the initial values: pmalpha_begin */
    bool replays;         /* steps are taken again: attached functions are not called */
    double *log;          /* fine x inputs: inputs of the fine steps since the present */
    double *start;        /* the state that was frozen */
    double *before;       /* that before one is restored, which may be refused */
    int64_t (*now)(void *user);
    void *clock;
    int64_t longest;
    char message[PMALPHA_MESSAGE];
    char ended[PMALPHA_MESSAGE]; /* that of what made `state` other than OK */
};

/* ---- open.c --------------------------------------------------------------------------------- */

/* All of it but the state at hand. PMA_REFUSED with a reason in m->fields.refusal. */
pma_status pmalpha_take(pmalpha_model *m);
void pmalpha_release(pmalpha_model *m);

/* ---- states.c ------------------------------------------------------------------------------- */

/* The state that the file has, and room for others. */
pma_status pmalpha_take_state(pmalpha_model *m);

/* The subdomains and the coupler go on from there, and the fine steps since are taken again. */
pmalpha_status pmalpha_return(pmalpha_model *m, const double *block);

/* ---- pmalpha.c ------------------------------------------------------------------------------ */

/* A fine step, recorded, with the command that follows. */
pmalpha_status pmalpha_step(pmalpha_model *m);

/* Outputs and commands of the present. */
pmalpha_status pmalpha_show(pmalpha_model *m);

/* The model of bytes that are aligned. */
pmalpha_status pmalpha_open_bytes(const void *bytes, size_t size, char *message,
                                  pmalpha_model **out);

/* This status with a reason in `message`, which may be NULL. */
pmalpha_status pmalpha_refuse(pmalpha_status status, const char *reason, char *message);

/* This status with a message. */
pmalpha_status pmalpha_say(pmalpha_model *m, pmalpha_status status, const char *text);

/* No step follows this status; all that are tried have its message. */
pmalpha_status pmalpha_end(pmalpha_model *m, pmalpha_status status);

/* PMALPHA_OK without a message. */
pmalpha_status pmalpha_well(pmalpha_model *m);

/* The input of this number, or NULL. */
pmalpha_input *pmalpha_input_at(const pmalpha_model *m, int i);

/* A value of an input, which is finite. */
void pmalpha_put(pmalpha_input *in, double value);

#endif
