/* simstruc.h - as much of Simulink's header as examples/c/sfunction.c needs to be compiled, and run
 * by main below: one block, whose input is -300 times the first command. */
#include <stdio.h>
#include <stdlib.h>

typedef int int_T;
typedef struct {
    const char *path, *error;
    void *work[2];
    int inputs, outputs;
    double u[16], y[64], h;
} SimStruct;

#define ssSetNumSFcnParams(S, n) ((void)(S))
#define ssGetSFcnParam(S, i) (S)
#define mxGetString(S, to, size) snprintf(to, size, "%s", (S)->path)
#define ssSetErrorStatus(S, why) ((S)->error = (why))
#define ssSetNumInputPorts(S, n) ((void)(S))
#define ssSetInputPortWidth(S, i, n) ((S)->inputs = (n))
#define ssSetInputPortDirectFeedThrough(S, i, f) ((void)(S))
#define ssSetInputPortRequiredContiguous(S, i, f) ((void)(S))
#define ssSetNumOutputPorts(S, n) ((void)(S))
#define ssSetOutputPortWidth(S, i, n) ((S)->outputs = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetNumPWork(S, n) ((void)(S))
#define ssSetSampleTime(S, i, t) ((S)->h = (t))
#define ssSetOffsetTime(S, i, t) ((void)(S))
#define ssGetPWork(S) ((S)->work)
#define ssGetInputPortRealSignal(S, i) ((S)->u)
#define ssGetOutputPortRealSignal(S, i) ((S)->y)
#define ssIsMajorTimeStep(S) 1
#define ssIsSampleHit(S, i, tid) ((tid) == 0)
