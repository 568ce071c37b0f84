/* cg_sfun.h - what Simulink does with the block of sfunction.c: FILE SAMPLES. */
int main(int count, char **words)
{
    SimStruct S = {.path = count > 2 ? words[1] : ""};
    mdlInitializeSizes(&S);
    mdlInitializeSampleTimes(&S);
    mdlStart(&S);
    if (S.error || S.inputs != 1 || S.outputs != 4)
        return fprintf(stderr, "%s\n", S.error ? S.error : "ports"), 1;
    for (long k = 0; k <= atol(words[2]) && !S.error; k++) { /* the first only gives a command */
        S.u[0] = 300.0 * S.y[0];
        mdlOutputs(&S, 0);
    }
    printf("%.17g\n", S.y[3]);
    mdlTerminate(&S);
    return S.error != NULL;
}
