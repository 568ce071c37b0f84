/* A chain of unit masses and springs between two walls, by TSALPHA2 of PETSc.

   petsc_chain N DT RHO WARM STEPS < displacements

   Reads N initial displacements, takes WARM + STEPS steps from rest, and writes as JSON the seconds
   per step of the last STEPS and the displacements. One linear solve per step; matrix and factor
   are kept after the second step. */

#include <petscts.h>
#include <time.h>

static const char *const settings = "-snes_type ksponly -ksp_type preonly -pc_type cholesky "
                                    "-pc_factor_mat_ordering_type natural";

typedef struct {
    Vec m;
    Mat K;
} chain;

/* F = M a + K u */
static PetscErrorCode residual(TS ts, PetscReal t, Vec u, Vec v, Vec a, Vec F, void *ctx)
{
    chain *c = ctx;

    PetscFunctionBeginUser;
    PetscCall(VecPointwiseMult(F, c->m, a));
    PetscCall(MatMultAdd(c->K, u, F, F));
    PetscFunctionReturn(0);
}

/* P = of_a M + K */
static PetscErrorCode jacobian(TS ts, PetscReal t, Vec u, Vec v, Vec a, PetscReal of_v,
                               PetscReal of_a, Mat J, Mat P, void *ctx)
{
    chain *c = ctx;

    PetscFunctionBeginUser;
    PetscCall(MatCopy(c->K, P, SAME_NONZERO_PATTERN));
    PetscCall(MatShift(P, of_a));
    PetscFunctionReturn(0);
}

/* Only with a monitor KSPONLY evaluates the residual of the new state. TSALPHA2 takes v and a of
   that state from the last evaluation. */
static PetscErrorCode monitor(SNES snes, PetscInt iteration, PetscReal norm, void *ctx)
{
    return 0;
}

static PetscErrorCode make_chain(PetscInt n, chain *c)
{
    PetscFunctionBeginUser;
    PetscCall(MatCreateSeqAIJ(PETSC_COMM_SELF, n, n, 3, NULL, &c->K));
    for (PetscInt i = 0; i < n; i++) {
        PetscCall(MatSetValue(c->K, i, i, 2.0, INSERT_VALUES));
        if (i + 1 < n) {
            PetscCall(MatSetValue(c->K, i, i + 1, -1.0, INSERT_VALUES));
            PetscCall(MatSetValue(c->K, i + 1, i, -1.0, INSERT_VALUES));
        }
    }
    PetscCall(MatAssemblyBegin(c->K, MAT_FINAL_ASSEMBLY));
    PetscCall(MatAssemblyEnd(c->K, MAT_FINAL_ASSEMBLY));
    PetscCall(MatCreateVecs(c->K, &c->m, NULL));
    PetscCall(VecSet(c->m, 1.0));
    PetscFunctionReturn(0);
}

static PetscErrorCode read_displacements(Vec u)
{
    PetscInt n;
    PetscScalar *value;

    PetscFunctionBeginUser;
    PetscCall(VecGetLocalSize(u, &n));
    PetscCall(VecGetArray(u, &value));
    for (PetscInt i = 0; i < n; i++)
        PetscCheck(scanf("%lf", &value[i]) == 1, PETSC_COMM_SELF, PETSC_ERR_FILE_READ,
                   "N displacements");
    PetscCall(VecRestoreArray(u, &value));
    PetscFunctionReturn(0);
}

static PetscErrorCode write_result(double seconds, Vec u)
{
    PetscInt n;
    const PetscScalar *value;

    PetscFunctionBeginUser;
    PetscCall(VecGetLocalSize(u, &n));
    PetscCall(VecGetArrayRead(u, &value));
    printf("{\"seconds\": %.17g, \"u\": [", seconds);
    for (PetscInt i = 0; i < n; i++)
        printf("%s%.17g", i ? ", " : "", value[i]);
    printf("]}\n");
    PetscCall(VecRestoreArrayRead(u, &value));
    PetscFunctionReturn(0);
}

/* Takes steps; returns the processor time of each. */
static PetscErrorCode take(TS ts, int steps, double *seconds)
{
    struct timespec begin, end;

    PetscFunctionBeginUser;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    for (int i = 0; i < steps; i++)
        PetscCall(TSStep(ts));
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    *seconds = (end.tv_sec - begin.tv_sec + 1e-9 * (end.tv_nsec - begin.tv_nsec)) / steps;
    PetscFunctionReturn(0);
}

int main(int argc, char **argv)
{
    chain c;
    Mat J;
    Vec u, v;
    TS ts;
    SNES snes;
    double seconds;

    PetscCall(PetscInitialize(&argc, &argv, NULL, NULL));
    PetscCheck(argc == 6, PETSC_COMM_SELF, PETSC_ERR_USER, "N DT RHO WARM STEPS");
    int warm = atoi(argv[4]), steps = atoi(argv[5]);
    PetscCall(make_chain(atoi(argv[1]), &c));
    PetscCall(MatDuplicate(c.K, MAT_COPY_VALUES, &J));
    PetscCall(MatCreateVecs(c.K, &u, &v));
    PetscCall(read_displacements(u));

    PetscCall(PetscOptionsInsertString(NULL, settings));
    PetscCall(TSCreate(PETSC_COMM_SELF, &ts));
    PetscCall(TSSetType(ts, TSALPHA2));
    PetscCall(TSAlpha2SetRadius(ts, atof(argv[3])));
    PetscCall(TSSetI2Function(ts, NULL, residual, &c));
    PetscCall(TSSetI2Jacobian(ts, J, J, jacobian, &c));
    PetscCall(TSSetTimeStep(ts, atof(argv[2])));
    PetscCall(TSSetMaxSteps(ts, warm + steps));
    PetscCall(TSSetExactFinalTime(ts, TS_EXACTFINALTIME_STEPOVER));
    PetscCall(TS2SetSolution(ts, u, v));
    PetscCall(TSSetFromOptions(ts));
    PetscCall(TSGetSNES(ts, &snes));
    PetscCall(SNESMonitorSet(snes, monitor, NULL, NULL));

    /* the first step has other matrices, for the initial accelerations */
    PetscCall(take(ts, 1, &seconds));
    PetscCall(SNESSetLagJacobian(snes, -2));
    PetscCall(SNESSetLagJacobianPersists(snes, PETSC_TRUE));
    PetscCall(take(ts, warm - 1, &seconds));
    PetscCall(take(ts, steps, &seconds));
    PetscCall(write_result(seconds, u));
    return PetscFinalize();
}
