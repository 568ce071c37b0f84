/* describe.h - what subdomains and couplers are made of, taken from a tree of fields.
 *
 * Sizes and kinds are checked here, indices where an object is made of the parts. */
#ifndef PMA_DESCRIBE_H
#define PMA_DESCRIBE_H

#include <stdbool.h>
#include <stddef.h>

#include "algebra/factor.h"
#include "algebra/link.h"
#include "algebra/matrix.h"
#include "algebra/panels.h"
#include "couple/contact.h"
#include "couple/coupler.h"
#include "couple/iteration.h"
#include "describe/field.h"
#include "factor/numeric.h"
#include "forces/internal.h"
#include "forces/path.h"
#include "forces/restoring.h"
#include "forces/springs.h"
#include "forces/wheels.h"
#include "rig/specimen.h"
#include "subdomain/impulse.h"
#include "subdomain/iterate.h"
#include "subdomain/response.h"
#include "subdomain/subdomain.h"

/* ---- matrices (matrices.c) ------------------------------------------------------------------ */

/* None; doubles (n,), a diagonal; doubles (n, n) by columns; {band: (width + 1, n)};
 * {ptr, indices, values} by rows; {first, ptr, indices, start, values}, strips. Of an unsymmetric
 * band (2, width + 1, n), what is above and what is below the diagonal. */
pma_status pma_parts_matrix(const pma_field *f, size_t n, pma_matrix *out);

/* {inverse (n,), R}: R is None, (n, n) by columns, {band: (n, width)}, {ptr, indices, values} by
 * columns, or {first, row_ptr, rows, start, values}, panels. Values of an unsymmetric matrix have
 * an axis more, the first, for R and Q. */
pma_status pma_parts_factor(const pma_field *f, size_t n, size_t nb, pma_factor *out);

/* {p, ptr, indices, values}: L_b by columns */
pma_status pma_parts_link(const pma_field *f, size_t nb, pma_link *out);

/* {dgemm, dtrsm}, among others: both None for loops alone */
pma_status pma_parts_blas(const pma_field *of, pma_blas *out);

/* {ptr, indices, structure, dgemm, dtrsm, unsymmetric}: what is factored again and again; structure
 * is None of a diagonal, else {first, row_ptr, rows, start, owner (n,)}. Without a crew. */
pma_status pma_parts_numeric(const pma_field *f, size_t n, size_t nb, pma_numeric_parts *out);

/* ---- forces (loads.c, rig.c, forces.c) ------------------------------------------------------- */

/* What stands for a function of the user in the core. */
typedef struct {
    pma_restoring_function function;
    void *user;
    bool by_caller; /* to be called by the thread that called advance */
} pma_function;

/* A tuple of {law, first, second, parameters} */
pma_status pma_parts_springs(const pma_field *f, pma_springs *out);

/* None, or {functions, order, load}: the sum of functions, each of the user, a specimen, or springs
 * of which ends move, {springs, ends (:, 2), points (:, 2), paths}: dof and path of each, or -1 */
pma_status pma_parts_restoring(const pma_field *f, size_t n, pma_restoring *out);

/* Doubles (rows, columns), by rows */
pma_status pma_parts_rectangle(const pma_field *of, const char *key, size_t rows, size_t columns,
                               const double **out);

/* {lag, weight} of a delay */
pma_status pma_parts_delay(const pma_field *f, pma_delay *out);

/* {filters, linear, springs, function, dofs, compensators, leading, h}; linear is None or {phi,
 * before, after, rest, displacement, force, lag, weight, largest, noise, force_noise, quantum,
 * seed}; dofs are of its commands, None: all. by_caller is set if it calls such a function. */
pma_status pma_parts_specimen(const pma_field *f, size_t n, pma_specimen **out, bool *by_caller);

/* A filter of `width` commands: {lag, weight, largest, phi, before, after, slope, noise, quantum,
 * seed}, or one that adapts, {h, limits, threshold, every, window, section}, or an inverse, {h,
 * rate, acceleration, command, feedback, regressors, low, sigma, largest} of filters in modal form,
 * {A, B, C, D, rest}, all but the first may be None, or a linkage, {matrix, inverse} or {arms}. */
pma_status pma_parts_filter(const pma_field *f, size_t width, pma_filter *out);

/* None, or {order, initial, forces}, each force {function, history, where, across, potential} */
pma_status pma_parts_internal(const pma_field *f, size_t n, pma_internal *out);

/* None, or {inverse, alpha, beta, B}: what impulses meet */
pma_status pma_parts_impulse(const pma_field *f, size_t nb, pma_impulse_parts *out);

/* {order}: the user's dof at each position */
pma_status pma_parts_order(const pma_field *of, size_t n, const int64_t **out);

/* ---- loads (loads.c) ------------------------------------------------------------------------- */

/* None; doubles (n,), constant; {values (samples, k), shape (k, n) or None, dt, hold, begin},
 * sampled, k = n without a shape; {rows (:, n), first}, a row for each substep from that one on;
 * {function, order}; {values (samples,), dt, hold, begin, path}, along a path; or a tuple of these,
 * whose sum acts. For the velocity of a motion and the obstacles of contacts too. */
pma_status pma_parts_load(const pma_field *f, size_t n, pma_load *out);

/* {ends (segments + 1,), dofs (segments, width), shape (segments, width, 4), start, speed} */
pma_status pma_parts_path(const pma_field *f, size_t n, pma_path *out);

/* A tuple of PMA_LANES such loads on n / PMA_LANES dofs: none, constant or sampled. */
pma_status pma_parts_lane_loads(const pma_field *f, size_t n, pma_load *out);

/* ---- a whole subdomain (subdomains.c) ------------------------------------------------------- */

/* What it is made of; parts.iterate, where it is set, points to `iterate`, and `threads` are those
 * that factor its tangents. */
typedef struct {
    pma_parts parts;
    pma_iterate_parts iterate;
    size_t threads;
    bool is_limited, is_watched, watched_explicit;
    pma_limits_parts limits;
    pma_matrix watched_M, watched_K_r;
    pma_unit_responses responses; /* count = 0: none are stored */
    pma_load load;
} pma_subdomain_taken;

/* {n, nb, substeps, single, second, twice, link, K, C, M, K_r, D_r, lagged, has_responses,
 * deferred, continues, mass, restoring, springs, internal, iterate, impulse, limits, watch,
 * responses, load}; single and twice are {step, inverse, R}, second is the step of a second stage,
 * limits {displacement, velocity, acceleration, force, energy}, (n,) each or None, and watch
 * {M, K_r, is_explicit}: what evaluated forces do. */
pma_status pma_parts_subdomain(const pma_field *f, pma_subdomain_taken *out);

/* {rows (k,), states (k, 4, n)}: u, v, w, a at the end of a macro step for unit multipliers */
pma_status pma_parts_responses(const pma_field *f, const pma_parts *parts, pma_unit_responses *out);

/* The subdomain; iterate.tangent.crew is set by the caller, for more threads than one. */
pma_status pma_parts_make_subdomain(const pma_subdomain_taken *taken, pma_subdomain **out);

/* ---- the present (present.c) ---------------------------------------------------------------- */

/* {name: doubles (count,)} of all of these arrays, which are written if they are all there and what
 * has to be a count is one; and the same without writing. */
pma_status pma_parts_check_arrays(const pma_field *f, const pma_state_array *arrays, size_t count);
pma_status pma_parts_arrays(const pma_field *f, const pma_state_array *arrays, size_t count);

/* {scale, entries, twice}: what an iteration is restored to; entries may be None */
pma_status pma_parts_kept(const pma_field *f, const pma_iterate *it, pma_kept_iteration *out);

/* ---- a coupler (couplers.c) ----------------------------------------------------------------- */

/* The members of a coupler, as far as its fields need them: interface dofs of each. */
typedef struct {
    size_t count;
    size_t (*nb)(const void *of, size_t member);
    const void *of;
} pma_members;

/* The parts without members and interfaces, for which there are the factors; parts.iteration and
 * parts.contact point to what is here where they are set. */
typedef struct {
    pma_coupler_parts parts;
    pma_factor H_start, H;
    pma_iteration_parts iteration;
    pma_contact_parts contact;
} pma_coupler_taken;

/* {p, H_start, H, motions, options, schedule, iteration, doubled, contact}: motions is a tuple
 * of {rows, velocity}, a load, which may be set later; options those of PMA_COUPLER_OPTIONS;
 * schedule a word; iteration, or None, is {tolerance, iterations, reuse} with {pattern, start,
 * later} or, of schedules that shoot, {response_start, response, H_size}; contact, or None, is
 * {first, gap, restitution, friction, friction_static, sides, dgemm, dtrsm, obstacle} with sides
 * {member, N}; its obstacle may be set later. */
pma_status pma_parts_coupler(const pma_field *f, const pma_members *members,
                             pma_coupler_taken *out);

#endif
