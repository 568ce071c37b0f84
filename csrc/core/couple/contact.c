/* contact.c - the schedules "pm" and "gc" with contacts: impulses beside the interface problem.
 *
 * To be read with docs/method/contact.md, (U1) to (U11). All fine steps are those of fine.c; what
 * closes a gap at the end of one gets an impulse between its free and its link problem. */
#include "couple/contact.h"

#include <math.h>
#include <string.h>

#include "couple/inside.h"
#include "memory.h"
#include "object.h"
#include "observe/energy.h"
#include "solve/complementarity.h"

/* Part by which an impulse of friction is as large as it may be, and a velocity is rounding. */
static const double EQUAL = 1e-9;

/* A side, and what it does in the fine step at hand. */
typedef struct {
    pma_contact_side of;
    double *f;  /* nb: impulses on its interface dofs */
    double *u;  /* nb: displacement that is expected */
    double *v;  /* nb: the same of the velocity */
    double *v0; /* nb: velocity at the beginning */
    bool has_impulse;
} side;

/* What goes on from one fine step to the next. */
typedef struct {
    double *P;        /* rows: the last impulses; what follows is one array with it */
    double *obstacle; /* 2 contacts: d and d' at the last fine step */
    double *sum;      /* rows: of impulses since the last recorded row */
} contact_level;

struct pma_contact {
    pma_contact_parts parts;
    size_t rows, numbers; /* of a contact_level */
    side *sides;
    side **of; /* by member, NULL where it has none */
    pma_complementarity *problem;
    double *W_start, *W; /* rows x rows by columns: of the first macro step, and after it */
    const double *set;   /* which of them `problem` has */
    contact_level present, now;
    int64_t reached;    /* macro step at whose end `now` is, or -1 */
    double *y0, *y, *b; /* rows */
    double *gap;        /* contacts */
    bool *may_turn;     /* contacts: they slide with less than static friction */
    double *mu;         /* contacts: of the fine step at hand, in W of `problem` as it was set */
    size_t *closed;     /* contacts */
    size_t count;       /* of them */
    bool tied;          /* constraints reach members that have contacts: impulses change Lam */
    double *values;     /* of all sides */
};

/* ---- making --------------------------------------------------------------------------------- */

pma_status pma_contact_check(const pma_contact_parts *parts, size_t count)
{
    const size_t n = parts->contacts;
    if (parts->first[0] != 0 || (parts->obstacle.n != 0 && parts->obstacle.n != 2 * n))
        return PMA_BAD_SIZE;
    for (size_t k = 0; k < n; k++) {
        const int64_t rows = parts->first[k + 1] - parts->first[k];
        if (rows < 1 || rows > 3)
            return PMA_BAD_INDEX;
    }
    for (size_t i = 0; i < parts->sides; i++) {
        const pma_contact_side *own = &parts->side[i];
        if (own->member >= count || (i > 0 && own->member <= own[-1].member))
            return PMA_BAD_INDEX;
        if (own->N.p != (size_t)parts->first[n])
            return PMA_BAD_SIZE;
        PMA_TRY(pma_link_check(&own->N));
    }
    return PMA_OK;
}

/* All members of a contact are at the finest step, take single steps and take impulses. */
static pma_status check(const pma_coupler_parts *parts)
{
    const size_t fine = pma_fine_instants(parts);
    PMA_TRY(pma_fine_check(parts));
    PMA_TRY(pma_contact_check(parts->contact, parts->count));
    for (size_t i = 0; i < parts->contact->sides; i++) {
        const pma_contact_side *own = &parts->contact->side[i];
        const pma_member *m = &parts->members[own->member];
        if (m->substeps != fine || m->doubling != PMA_SINGLE || !m->impulse ||
            m->link->nb != own->N.nb)
            return PMA_BAD_SIZE;
    }
    return PMA_OK;
}

static void lay_out_level(const pma_contact *x, contact_level *at)
{
    at->obstacle = at->P + x->rows;
    at->sum = at->obstacle + 2 * x->parts.contacts;
}

static void lay_out_sides(pma_contact *x)
{
    double *next = x->values;
    for (size_t i = 0; i < x->parts.sides; i++) {
        const size_t nb = x->parts.side[i].N.nb;
        x->sides[i] = (side){.of = x->parts.side[i],
                             .f = next,
                             .u = next + nb,
                             .v = next + 2 * nb,
                             .v0 = next + 3 * nb};
        x->of[x->parts.side[i].member] = &x->sides[i];
        next += 4 * nb;
    }
    x->parts.side = NULL; /* x->sides has them */
}

static pma_contact *allocate(const pma_contact_parts *parts, size_t members, bool twice)
{
    const size_t n = parts->contacts, rows = (size_t)parts->first[n], numbers = 2 * rows + 2 * n;
    size_t values = 0;
    for (size_t i = 0; i < parts->sides; i++)
        values += 4 * parts->side[i].N.nb;
    const pma_array arrays[] = {PMA_ARRAY(pma_contact, present.P, numbers),
                                PMA_ARRAY(pma_contact, now.P, numbers),
                                PMA_ARRAY(pma_contact, y0, rows),
                                PMA_ARRAY(pma_contact, y, rows),
                                PMA_ARRAY(pma_contact, b, rows),
                                PMA_ARRAY(pma_contact, gap, n),
                                PMA_ARRAY(pma_contact, mu, n),
                                PMA_ARRAY(pma_contact, may_turn, n),
                                PMA_ARRAY(pma_contact, closed, n),
                                PMA_ARRAY(pma_contact, sides, parts->sides),
                                PMA_ARRAY(pma_contact, of, members),
                                PMA_ARRAY(pma_contact, values, values),
                                PMA_ARRAY(pma_contact, W_start, rows * rows),
                                PMA_ARRAY(pma_contact, W, twice ? rows * rows : 0),
                                {0}};
    pma_contact *x = pma_object_create(sizeof *x, arrays);
    if (!x)
        return NULL;
    x->parts = *parts;
    x->rows = rows;
    x->numbers = numbers;
    x->reached = -1;
    x->W = twice ? x->W : x->W_start;
    lay_out_level(x, &x->present);
    lay_out_level(x, &x->now);
    lay_out_sides(x);
    return x;
}

static const pma_member *member_of(const pma_coupler *c, const side *s)
{
    return &c->coupled[s->of.member].member;
}

/* y (rows) := sum N V N^T P with its constraints held: a column of W                       (U6) */
static void find_column(pma_coupler *c, pma_contact *x, const pma_interface *H, const double *P,
                        double *y)
{
    double *lam = c->scratch;
    memset(y, 0, x->rows * sizeof(double));
    memset(lam, 0, c->parts.p * sizeof(double));
    for (size_t i = 0; i < x->parts.sides; i++) {
        side *s = &x->sides[i];
        const pma_member *m = member_of(c, s);
        pma_link_load(&s->of.N, P, s->f);
        m->impulse->recoil(m->self, s->f, s->v);
        pma_link_gather(m->link, -1.0, s->v, lam);
        pma_link_gather(&s->of.N, 1.0, s->v, y);
    }
    if (!x->tied)
        return;
    pma_interface_solve(H, lam);
    for (size_t i = 0; i < x->parts.sides; i++) {
        const side *s = &x->sides[i];
        const pma_member *m = member_of(c, s);
        const double *link = m->table->values(m->self, PMA_LINK_VELOCITY, 0, false, lam);
        pma_link_gather(&s->of.N, 1.0, link, y);
    }
}

static void fill(pma_coupler *c, pma_contact *x, const pma_interface *H, double *W)
{
    for (size_t k = 0; k < x->rows; k++) {
        x->b[k] = 1.0;
        find_column(c, x, H, x->b, W + k * x->rows);
        x->b[k] = 0.0;
    }
}

/* Do impulses change the multipliers? */
static bool is_tied(const pma_coupler *c, const pma_contact *x)
{
    for (size_t i = 0; i < x->parts.sides; i++) {
        const pma_link *L = member_of(c, &x->sides[i])->link;
        if (L->nb > 0 && L->ptr[L->nb] > 0)
            return true;
    }
    return false;
}

static pma_status create(pma_coupler *c, const pma_iteration_parts *parts)
{
    (void)parts;
    const bool twice = pma_coupler_has(c, pma_is_doubled);
    pma_contact *x = c->contact = allocate(c->parts.contact, c->parts.count, twice);
    if (!x)
        return PMA_NO_MEMORY;
    x->tied = is_tied(c, x);
    memcpy(x->mu, x->parts.friction, x->parts.contacts * sizeof(double));
    fill(c, x, &c->parts.H_start, x->W_start);
    if (twice)
        fill(c, x, &c->parts.H, x->W);
    const pma_complementarity_parts problem = {.contacts = x->parts.contacts,
                                               .first = x->parts.first,
                                               .friction = x->mu,
                                               .blas = x->parts.blas};
    return pma_complementarity_create(&problem, &x->problem);
}

void pma_contact_destroy(pma_contact *x)
{
    if (x)
        pma_complementarity_destroy(x->problem);
    pma_memory_release(x);
}

/* ---- what it knows -------------------------------------------------------------------------- */

/* The macro step that was done last is committed: so is its end. */
static void commit(pma_coupler *c, pma_contact *x)
{
    if (x->reached == c->present.number)
        memcpy(x->present.P, x->now.P, x->numbers * sizeof(double));
    x->reached = -1;
}

pma_state_array pma_contact_array(pma_coupler *c)
{
    commit(c, c->contact);
    return (pma_state_array){
        .name = "contact", .count = c->contact->numbers, .values = c->contact->present.P};
}

const double *pma_coupler_contact_compliance(const pma_coupler *c, bool start, size_t *rows)
{
    *rows = c->contact ? c->contact->rows : 0;
    return c->contact ? (start ? c->contact->W_start : c->contact->W) : NULL;
}

size_t pma_coupler_contact_turns(const pma_coupler *c)
{
    return c->contact ? pma_complementarity_turns(c->contact->problem) : 0;
}

size_t pma_coupler_contacts(const pma_coupler *c)
{
    return c->contact ? c->contact->parts.contacts : 0;
}

const pma_load *pma_coupler_obstacle(const pma_coupler *c)
{
    return c->contact ? &c->contact->parts.obstacle : NULL;
}

void pma_coupler_set_obstacle(pma_coupler *c, pma_load load)
{
    c->contact->parts.obstacle = load;
}

/* ---- stages of a fine step ------------------------------------------------------------------ */

/* y (rows) -= d' in the normal rows */
static void subtract_obstacle(const pma_contact *x, double *y)
{
    const double *velocity = x->now.obstacle + x->parts.contacts;
    for (size_t k = 0; k < x->parts.contacts; k++)
        y[x->parts.first[k]] -= velocity[k];
}

/* y0 = sum N v - d' where the fine step begins; the obstacle at its end                    (U1) */
static void begin(pma_coupler *c, pma_contact *x)
{
    if (c->k == 1) {
        commit(c, x);
        memcpy(x->now.P, x->present.P, x->numbers * sizeof(double));
    }
    memset(x->y0, 0, x->rows * sizeof(double));
    for (size_t i = 0; i < x->parts.sides; i++) {
        side *s = &x->sides[i];
        const pma_member *m = member_of(c, s);
        const size_t j = c->coupled[s->of.member].now.j;
        const double *v = m->table->values(m->self, PMA_VELOCITY, j, false, NULL);
        memcpy(s->v0, v, s->of.N.nb * sizeof(double));
        pma_link_gather(&s->of.N, 1.0, v, x->y0);
        s->has_impulse = false;
    }
    subtract_obstacle(x, x->y0);
    if (x->parts.obstacle.kind == PMA_LOAD_NONE)
        return;
    const int64_t number = c->present.number * (int64_t)c->fine + (int64_t)c->k - 1;
    const double t = pma_clock_time(c->origin.t, c->parts.dt, c->present.number, c->k, c->fine);
    memset(x->now.obstacle, 0, 2 * x->parts.contacts * sizeof(double));
    pma_load_add(&x->parts.obstacle, t, number, x->now.obstacle);
}

/* gap := g0 + N u - d of the sums in y                                                     (U1) */
static void find_gaps(pma_contact *x)
{
    for (size_t k = 0; k < x->parts.contacts; k++)
        x->gap[k] = x->parts.gap[k] + x->y[x->parts.first[k]] - x->now.obstacle[k];
}

/* Which gaps are closed without impulses, and with which velocities                        (U5) */
static void approach(pma_coupler *c, pma_contact *x)
{
    const double *lam = x->tied ? c->working.lam : NULL;
    memset(x->y, 0, x->rows * sizeof(double));
    memset(x->b, 0, x->rows * sizeof(double));
    for (size_t i = 0; i < x->parts.sides; i++) {
        const side *s = &x->sides[i];
        const pma_coupled *m = &c->coupled[s->of.member];
        m->member.impulse->approach(m->member.self, &m->step, lam, s->u, s->v);
        pma_link_gather(&s->of.N, 1.0, s->u, x->y);
        pma_link_gather(&s->of.N, 1.0, s->v, x->b);
    }
    find_gaps(x);
    subtract_obstacle(x, x->b);
    x->count = 0;
    for (size_t k = 0; k < x->parts.contacts; k++) {
        const double y0 = x->y0[x->parts.first[k]];
        if (x->gap[k] <= 0.0)
            x->closed[x->count++] = k;
        /* e' = 1 where it opens already: (U5) would add energy else */
        x->b[x->parts.first[k]] += (y0 > 0.0 ? 1.0 : x->parts.restitution[k]) * y0;
    }
}

static double tangential(const pma_contact *x, size_t contact, const double *of)
{
    double length = 0.0;
    for (int64_t k = x->parts.first[contact] + 1; k < x->parts.first[contact + 1]; k++)
        length = hypot(length, of[k]);
    return length;
}

/* Did the contact slide at the end of the last fine step? Then |P_t| was mu P_n, and it moves; else
 * it stuck, or was open.                                                                  (U12) */
static bool slid(const pma_contact *x, size_t contact, const double *W)
{
    const size_t at = (size_t)x->parts.first[contact];
    const double limit = x->parts.friction[contact] * x->now.P[at];
    const double pull = tangential(x, contact, x->now.P);
    double moved = 0.0; /* by an impulse as large as that of the row */
    for (size_t k = at + 1; k < (size_t)x->parts.first[contact + 1]; k++)
        moved = fmax(moved, W[k * x->rows + k] * x->now.P[at]);
    return fabs(pull - limit) <= EQUAL * limit && tangential(x, contact, x->y0) > EQUAL * moved;
}

static void set_friction(pma_contact *x, size_t contact, double mu)
{
    if (x->mu[contact] == mu)
        return;
    x->mu[contact] = mu;
    x->set = NULL; /* factors of the problem have it */
}

static void choose_friction(pma_contact *x, const double *W)
{
    for (size_t i = 0; i < x->count; i++) {
        const size_t k = x->closed[i];
        const bool slides = slid(x, k, W);
        x->may_turn[k] = slides && x->parts.friction_static[k] > x->parts.friction[k];
        set_friction(x, k, slides ? x->parts.friction[k] : x->parts.friction_static[k]);
    }
}

/* Contacts that have begun to slide go on with the smaller friction; are there any?       (U12) */
static bool release(pma_contact *x)
{
    bool any = false;
    for (size_t i = 0; i < x->count; i++) {
        const size_t k = x->closed[i];
        const double limit = x->mu[k] * x->now.P[x->parts.first[k]];
        if (x->mu[k] == x->parts.friction[k] || !(limit > 0.0) ||
            tangential(x, k, x->now.P) < (1.0 - EQUAL) * limit)
            continue;
        set_friction(x, k, x->parts.friction[k]);
        any = true;
    }
    return any;
}

/* Does the velocity against which a contact slid at the end of the last fine step turn in this one,
 * y = W P + b? */
static bool turns(const pma_contact *x, size_t contact, const double *W)
{
    double along = 0.0;
    for (size_t k = (size_t)x->parts.first[contact] + 1; k < (size_t)x->parts.first[contact + 1];
         k++) {
        double y = x->b[k];
        for (size_t i = 0; i < x->rows; i++)
            y += W[i * x->rows + k] * x->now.P[i];
        along += y * x->y0[k];
    }
    return along < 0.0;
}

/* Contacts whose sliding turns within the step come to rest in it: they are tried once with the
 * static friction; are there any?                                                         (U12) */
static bool hold(pma_contact *x, const double *W)
{
    bool any = false;
    for (size_t i = 0; i < x->count; i++) {
        const size_t k = x->closed[i];
        if (!x->may_turn[k] || !turns(x, k, W))
            continue;
        x->may_turn[k] = false;
        set_friction(x, k, x->parts.friction_static[k]);
        any = true;
    }
    return any;
}

static pma_status solve_problem(pma_contact *x, const double *W, size_t *row)
{
    if (x->set != W) {
        pma_complementarity_set(x->problem, W);
        x->set = W;
    }
    return pma_complementarity_solve(x->problem, x->count, x->closed, x->b, x->now.P, row);
}

/* P of (U5), or zero. PMA_NOT_FINITE when a velocity is not. */
static pma_status find_impulses(pma_coupler *c, pma_contact *x)
{
    const double *W = c->present.number > 0 ? x->W : x->W_start;
    pma_status status;
    size_t row = 0;
    if (x->count == 0) {
        memset(x->now.P, 0, x->rows * sizeof(double));
        return PMA_OK;
    }
    for (size_t i = 0; i < x->parts.sides; i++) {
        const pma_coupled *m = &c->coupled[x->sides[i].of.member];
        const double *vf =
            m->member.table->values(m->member.self, PMA_FREE_VELOCITY, m->now.j + 1, false, NULL);
        if (!pma_is_finite(x->sides[i].of.N.nb, vf)) {
            c->failed = x->sides[i].of.member;
            return PMA_NOT_FINITE;
        }
    }
    choose_friction(x, W);
    do {
        c->unpolled += x->rows * x->rows;
        status = solve_problem(x, W, &row);
    } while (status == PMA_OK && (release(x) || hold(x, W)));
    if (status != PMA_OK)
        c->failed = row;
    return status;
}

static bool is_any_nonzero(size_t n, const double *x)
{
    for (size_t i = 0; i < n; i++) {
        if (x[i] != 0.0)
            return true;
    }
    return false;
}

/* N^T P on all sides that it reaches, and Lam of their new free velocities            (U3) (U6) */
static pma_status strike(pma_coupler *c, pma_contact *x)
{
    bool any = false;
    for (size_t i = 0; i < x->parts.sides && x->count > 0; i++) {
        side *s = &x->sides[i];
        const pma_coupled *m = &c->coupled[s->of.member];
        pma_link_load(&s->of.N, x->now.P, s->f);
        s->has_impulse = is_any_nonzero(s->of.N.nb, s->f);
        if (s->has_impulse)
            m->member.impulse->strike(m->member.self, &m->step, s->f);
        any = any || s->has_impulse;
    }
    if (!any || !x->tied)
        return PMA_OK;
    pma_fine_right_side(c);
    return pma_coupler_solve(c);
}

static pma_status end_substep(pma_coupler *c, pma_coupled *m)
{
    const side *s = c->contact->of[m - c->coupled];
    if (!s || !s->has_impulse)
        return pma_fine_close(c, m);
    return m->member.impulse->close(m->member.self, &m->step, c->working.lam);
}

/* (U10)  N^T P . (v0 + v1) / 2 of each side */
static void add_works(pma_coupler *c, const pma_contact *x)
{
    for (size_t i = 0; i < x->parts.sides; i++) {
        const side *s = &x->sides[i];
        const pma_coupled *m = &c->coupled[s->of.member];
        if (!s->has_impulse || !pma_member_is_observed(&m->member))
            continue;
        const double *v = m->member.table->values(m->member.self, PMA_VELOCITY, m->now.j + 1, false,
                                                  c->working.lam);
        double work = 0.0;
        for (size_t k = 0; k < s->of.N.nb; k++)
            work += 0.5 * s->f[k] * (s->v0[k] + v[k]);
        m->member.impulse->add_work(m->member.self, m->now.j + 1, work);
    }
}

/* ---- record --------------------------------------------------------------------------------- */

/* Gaps at a time level of the finest step, `impulse` (rows) into a row. */
static void record(const pma_coupler *c, pma_contact *x, const pma_record *to, size_t j, size_t row,
                   const double *impulse)
{
    memset(x->y, 0, x->rows * sizeof(double));
    for (size_t i = 0; i < x->parts.sides; i++) {
        const side *s = &x->sides[i];
        const pma_member *m = member_of(c, s);
        pma_link_gather(&s->of.N, 1.0, m->table->values(m->self, PMA_DISPLACEMENT, j, false, NULL),
                        x->y);
    }
    find_gaps(x);
    memcpy(to->contact_gap + row * x->parts.contacts, x->gap, x->parts.contacts * sizeof(double));
    memcpy(to->contact_impulse + row * x->rows, impulse, x->rows * sizeof(double));
}

static void record_present(const pma_coupler *c, const pma_record *to)
{
    pma_contact *x = c->contact;
    commit((pma_coupler *)c, x);
    memcpy(x->now.P, x->present.P, x->numbers * sizeof(double)); /* after a reset it is ahead */
    if (to->contact_gap)
        record(c, x, to, 0, 0, x->now.sum);
    memset(x->present.sum, 0, x->rows * sizeof(double));
    memset(x->now.sum, 0, x->rows * sizeof(double));
}

/* The sum goes on from one run to the next; steps without a record begin it anew. */
static void sum_up(pma_coupler *c, pma_contact *x)
{
    const bool recorded = c->record && c->record->contact_gap;
    const size_t row = recorded ? pma_recorder_row(c, c->k, c->fine) : PMA_NO_ROW;
    for (size_t k = 0; k < x->rows; k++)
        x->now.sum[k] += x->now.P[k];
    if (row != PMA_NO_ROW)
        record(c, x, c->record, c->k, row, x->now.sum);
    if (row != PMA_NO_ROW || !recorded)
        memset(x->now.sum, 0, x->rows * sizeof(double));
    if (c->k == c->fine)
        x->reached = c->present.number + 1;
}

/* ---- the schedule --------------------------------------------------------------------------- */

static pma_status fine_step(pma_coupler *c)
{
    pma_contact *x = c->contact;
    begin(c, x);

    /* free problems and the interface problem, without impulses */
    PMA_TRY(pma_fine_begin(c));
    PMA_TRY(pma_fine_solve(c));

    /* impulses where a gap is closed, and the interface problem with them */
    approach(c, x);
    PMA_TRY(find_impulses(c, x));
    PMA_TRY(strike(c, x));

    /* link problems that end here, added */
    PMA_TRY(pma_share(c, end_substep, pma_is_ending));
    if (c->observed)
        add_works(c, x);
    sum_up(c, x);
    return PMA_OK;
}

/* A member has impulses in all rows at once: none is divided among workers. */
static pma_duty duty(const pma_member *member)
{
    return (pma_duty){.entries = member->entries,
                      .substeps = member->substeps,
                      .by_caller = member->forces == PMA_BY_CALLER};
}

const pma_schedule pma_contact_schedule = {.check = check,
                                           .instants = pma_fine_instants,
                                           .duty = duty,
                                           .step = pma_fine_steps,
                                           .fine_step = fine_step,
                                           .prepare = create,
                                           .record_present = record_present,
                                           .internal = true};
