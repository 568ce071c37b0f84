/* example.c - one oscillator cut in two and coupled again, with the C core alone.
 *
 *     m u'' + k u = 0,   m = 3 + 1,   k = 10 + 30,   u(0) = 1, u'(0) = 0:   u = cos(omega t)
 *
 * A (mass 3, spring 10) is implicit by the trapezoidal rule; in a macro step it takes one double
 * step, from t - dt to t + dt. B (the rest) is explicit by the central difference and takes four
 * substeps. v_A - v_B = 0 is their one constraint, its multiplier the force between them, here
 * -20 cos(omega t). Equation numbers are those of docs/method.md. To compile, in one line: */
// cc -std=c11 -O2 -fopenmp-simd -pthread -Icsrc/core -o example csrc/example.c
//    csrc/core/*.c csrc/core/*/*.c -lm
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "couple/coupler.h"
#include "subdomain/subdomain.h"

static const double DT = 0.01, OMEGA_SQUARED = 10.0;
static const pma_scheme TRAPEZOIDAL = {.beta = 0.25, .gamma = 0.5}, CENTRAL = {.gamma = 0.5};
static const int64_t ONE_ENTRY[2] = {0, 1}; /* L has one column with one entry, */
static const int32_t ROW[1] = {0};          /* in row 0, which is the sign below */

/* What a subdomain points to: the core copies no array. */
typedef struct {
    double M, K, sign, inverse[2];
    pma_subdomain *core;
} oscillator;

static void must(pma_status status, const char *call)
{
    if (status != PMA_OK) {
        fprintf(stderr, "%s: %s\n", call, pma_status_text(status));
        exit(EXIT_FAILURE);
    }
}

/* (12)  Mbar = M + al1 K, with al1 = 0 for the central difference, and its factor R D R^T: of one
 * number, R = 1 and D = Mbar. The only dof is on the interface. */
static pma_operator step_of(pma_scheme scheme, double h, const oscillator *o, double *inverse)
{
    const pma_step step = pma_step_make(scheme, h);
    *inverse = 1.0 / (o->M + step.al1 * o->K);
    return (pma_operator){step, {.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = inverse}};
}

static pma_member make(oscillator *o, pma_scheme scheme, size_t substeps, bool doubled, double lam)
{
    const double h = DT / (double)substeps, u = 1.0, v = 0.0, w = -OMEGA_SQUARED;
    pma_parts parts = {.n = 1, .nb = 1, .substeps = substeps, .doubled = doubled};
    parts.K = (pma_matrix){.form = PMA_DIAGONAL, .n = 1, .values = &o->K};
    parts.C = (pma_matrix){.form = PMA_ZERO, .n = 1};
    parts.link = (pma_link){.p = 1, .nb = 1, .ptr = ONE_ENTRY, .index = ROW, .values = &o->sign};
    parts.single = step_of(scheme, h, o, &o->inverse[0]);
    parts.twice = step_of(scheme, 2.0 * h, o, &o->inverse[1]); /* read only if doubled */
    must(pma_subdomain_create(&parts, &o->core), "subdomain");
    pma_subdomain_start(o->core, &u, &v, &w, &lam); /* no load is set, so there is none */
    return pma_subdomain_member(o->core);
}

/* (18)  H = sum_i al2_i L_i Mbar_i^-1 L_i^T; the first macro step is made of single steps */
static pma_interface interface_of(const pma_member *m, bool later, double *inverse)
{
    double unit = 1.0, H = 0.0;
    for (size_t i = 0; i < 2; i++)
        pma_member_compliance(&m[i], later && m[i].doubling != PMA_SINGLE, &unit, &H);
    *inverse = 1.0 / H;
    const pma_factor factor = {.form = PMA_DIAGONAL, .n = 1, .nb = 1, .inverse = inverse};
    pma_interface interface;
    must(pma_interface_create(&factor, &interface), "interface");
    return interface;
}

int main(void)
{
    oscillator A = {.M = 3.0, .K = 10.0, .sign = 1.0}, B = {.M = 1.0, .K = 30.0, .sign = -1.0};
    const double lam = A.K - A.M * OMEGA_SQUARED, g = 0.0; /* (S1)  M w + K u = L^T Lam for A */
    const pma_member m[2] = {make(&A, TRAPEZOIDAL, 1, true, lam), make(&B, CENTRAL, 4, false, lam)};
    double inverse[2];
    pma_coupler_parts parts = {.count = 2, .members = m, .p = 1, .dt = DT, .rebased = true};
    parts.schedule = &pma_fine_schedule; /* "pm", since A is doubled; else "gc" */
    parts.H_start = interface_of(m, false, &inverse[0]);
    parts.H = interface_of(m, true, &inverse[1]);
    pma_coupler *c;
    must(pma_coupler_create(&parts, &c), "coupler");
    pma_coupler_start(c, 0, &lam, &g); /* at t = 0, no velocity is prescribed */
    printf("#   t             u_A             u_B    cos(omega t)             Lam\n");
    for (double t = 0.0; t < 5.25; t = (double)pma_coupler_step_count(c) * DT) {
        printf("%5.2f %15.12f %15.12f %15.12f %15.11f\n", t, pma_subdomain_present(A.core)->u[0],
               pma_subdomain_present(B.core)->u[0], cos(sqrt(OMEGA_SQUARED) * t),
               pma_coupler_multipliers(c)[0]);
        must(pma_coupler_advance(c, 50, NULL, NULL), "advance"); /* no record, no poll */
    }
    pma_coupler_destroy(c);
    pma_subdomain_destroy(A.core);
    pma_subdomain_destroy(B.core);
    pma_interface_destroy(&parts.H_start);
    pma_interface_destroy(&parts.H);
    return EXIT_SUCCESS;
}
