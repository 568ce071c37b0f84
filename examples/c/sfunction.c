/* sfunction.c - a frozen model as an S-function of Simulink, of one rate.
 *
 *     mex sfunction.c -I... libpmalpha.a
 *
 * Parameter: the file. Inputs: what is set, in the order of the inputs of the model. Outputs: three
 * numbers of the next command for each input (zeros where it is no specimen), then the outputs. The
 * sample time is the fine step. The first sample gives the first command. The force that a later one
 * reads answers the command of the sample before: mdlOutputs advances with it and gives the next
 * command in the same sample. */
#define S_FUNCTION_NAME sfunction
#define S_FUNCTION_LEVEL 2
#include <pmalpha.h>
#include <simstruc.h>

static pmalpha_model *model_of(SimStruct *S)
{
    return ssGetPWork(S)[0];
}

static pmalpha_model *opened(SimStruct *S)
{
    static char why[PMALPHA_MESSAGE];
    char path[1024];
    pmalpha_model *m = NULL;
    mxGetString(ssGetSFcnParam(S, 0), path, sizeof path);
    if (pmalpha_open(path, why, &m) != PMALPHA_OK)
        ssSetErrorStatus(S, why);
    return m;
}

static void mdlInitializeSizes(SimStruct *S)
{
    ssSetNumSFcnParams(S, 1);
    pmalpha_model *m = opened(S);
    if (!m)
        return;
    const int inputs = (int)pmalpha_inputs(m), outputs = (int)pmalpha_outputs(m);
    ssSetNumInputPorts(S, 1);
    ssSetInputPortWidth(S, 0, inputs);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    ssSetInputPortRequiredContiguous(S, 0, 1);
    ssSetNumOutputPorts(S, 1);
    ssSetOutputPortWidth(S, 0, 3 * inputs + outputs);
    ssSetNumSampleTimes(S, 1);
    ssSetNumPWork(S, 2); /* the model, and whether a command has been given */
    pmalpha_close(m);
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    pmalpha_model *m = opened(S);
    ssSetSampleTime(S, 0, m ? pmalpha_step_size(m) : 1.0);
    ssSetOffsetTime(S, 0, 0.0);
    pmalpha_close(m);
}

#define MDL_START
static void mdlStart(SimStruct *S)
{
    ssGetPWork(S)[0] = opened(S);
    ssGetPWork(S)[1] = NULL;
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    pmalpha_model *m = model_of(S);
    const double *u = ssGetInputPortRealSignal(S, 0);
    double *y = ssGetOutputPortRealSignal(S, 0);
    const int inputs = (int)pmalpha_inputs(m), outputs = (int)pmalpha_outputs(m);
    if (!ssIsMajorTimeStep(S) || !ssIsSampleHit(S, 0, tid))
        return;
    pmalpha_status status = PMALPHA_OK;
    for (int i = 0; i < inputs && status == PMALPHA_OK; i++)
        status = pmalpha_set(m, i, u[i]);
    if (ssGetPWork(S)[1] && status == PMALPHA_OK)
        status = pmalpha_advance(m, 1);
    if (status != PMALPHA_OK)
        ssSetErrorStatus(S, pmalpha_message(m));
    ssGetPWork(S)[1] = m;
    for (int i = 0; i < inputs; i++)
        pmalpha_command(m, i, y + 3 * i);
    for (int i = 0; i < outputs; i++)
        y[3 * inputs + i] = pmalpha_get(m, i);
}

static void mdlTerminate(SimStruct *S)
{
    pmalpha_close(model_of(S));
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
