#include "workers/roster.h"

#include <stdlib.h>
#include <string.h>

#include "memory.h"
#include "object.h"

/* A subdomain in the order in which they are given to workers. */
typedef struct {
    pma_duty duty;
    size_t subdomain, worker;
} entrant;

static int compare(size_t x, size_t y)
{
    return (x > y) - (x < y);
}

/* Those with the finest steps first; of them the caller's, then the largest first, equal ones in
 * their order. */
static int by_size(const void *x, const void *y)
{
    const entrant *a = x, *b = y;
    int order = compare(b->duty.substeps, a->duty.substeps);
    if (order == 0)
        order = compare(b->duty.by_caller, a->duty.by_caller);
    if (order == 0)
        order = compare(b->duty.entries, a->duty.entries);
    return order != 0 ? order : compare(a->subdomain, b->subdomain);
}

static int by_number(const void *x, const void *y)
{
    const entrant *a = x, *b = y;
    return compare(a->subdomain, b->subdomain);
}

static size_t least_loaded(const double *load, size_t begin, size_t end)
{
    size_t least = begin;
    for (size_t w = begin + 1; w < end; w++)
        least = load[w] < load[least] ? w : least;
    return least;
}

static double largest(const double *load, size_t begin, size_t end)
{
    double most = 0.0;
    for (size_t w = begin; w < end; w++)
        most = load[w] > most ? load[w] : most;
    return most;
}

/* What there is to give out, and to how many. */
typedef struct {
    size_t count;
    entrant *list;            /* in the order of by_size */
    double *load;             /* of each worker: scratch */
    size_t workers, parallel; /* all of them; those beside the fine steps, the last ones */
    size_t split;             /* shared by the workers of the fine steps, or PMA_NO_SPLIT */
} division;

static bool goes_in_parallel(const division *d, const entrant *e)
{
    return d->parallel > 0 && e->duty.parallel;
}

/* Every worker has a part of what can be divided.                                           (W3) */
static void assign_ranges(const division *d, entrant *e, size_t end)
{
    e->worker = 0;
    for (size_t w = 0; w < end; w++)
        d->load[w] += (double)e->duty.entries / (double)end;
}

/* Those that go with the fine steps, each to the least loaded worker, but to worker 0 what the
 * caller has to do. What a fine step takes is the load of the busiest worker, counted over the
 * subdomains with a time level there, that is about all that are not coarser:
 *
 *     W = sum_c (s_c - s_{c+1}) max_w load_w(c) + meetings                                (W1)
 *
 * with the classes c of equal substeps s_c from the finest on, and load_w(c) the entries of one
 * substep of all that worker w has in the classes up to c. */
static double assign_fine(const division *d)
{
    const size_t end = d->workers - d->parallel;
    double cost = end > 1 ? (double)PMA_MEETING * (double)d->list[0].duty.substeps : 0.0;
    double busiest = 0.0;
    size_t substeps = 0;
    for (size_t i = 0; i < d->count; i++) {
        entrant *e = &d->list[i];
        if (goes_in_parallel(d, e))
            continue;
        if (substeps > e->duty.substeps)
            cost += (double)(substeps - e->duty.substeps) * busiest;
        substeps = e->duty.substeps;
        if (end > 1 && e->subdomain == d->split) {
            assign_ranges(d, e, end);
            cost += (double)PMA_MEETING * (double)substeps;
        } else {
            e->worker = e->duty.by_caller ? 0 : least_loaded(d->load, 0, end);
            d->load[e->worker] += (double)e->duty.entries;
        }
        busiest = largest(d->load, 0, end);
    }
    return cost + (double)substeps * busiest;
}

/* Those beside the fine steps, by what they read in a whole macro step; they meet the others at
 * their own time levels.                                                                  (W2) */
static double assign_parallel(const division *d)
{
    for (size_t i = 0; i < d->count; i++) {
        entrant *e = &d->list[i];
        if (!goes_in_parallel(d, e))
            continue;
        e->worker = least_loaded(d->load, d->workers - d->parallel, d->workers);
        d->load[e->worker] += (double)e->duty.substeps * (double)(e->duty.entries + PMA_MEETING);
    }
    return largest(d->load, d->workers - d->parallel, d->workers);
}

/* The slower of the two decides. */
static double assign(division *d, size_t workers, size_t parallel)
{
    d->workers = workers;
    d->parallel = parallel;
    memset(d->load, 0, workers * sizeof *d->load);
    const double fine = assign_fine(d), beside = parallel > 0 ? assign_parallel(d) : 0.0;
    return fine > beside ? fine : beside;
}

/* The best number of these workers beside the fine steps; rather one than none. */
static double choose_parallel(division *d, size_t workers)
{
    size_t most = 0, best = 0;
    for (size_t i = 0; i < d->count; i++)
        most += d->list[i].duty.parallel;
    most = most < workers - 1 ? most : workers - 1;
    double least = assign(d, workers, 0);
    for (size_t parallel = 1; parallel <= most; parallel++) {
        const double cost = assign(d, workers, parallel);
        if (cost < least || (cost == least && best == 0)) {
            least = cost;
            best = parallel;
        }
    }
    return assign(d, workers, best);
}

/* The candidate for it is split if that is faster. */
static double choose_split(division *d, size_t candidate, size_t workers)
{
    d->split = PMA_NO_SPLIT;
    const double whole = choose_parallel(d, workers);
    if (candidate == PMA_NO_SPLIT)
        return whole;
    d->split = candidate;
    const double divided = choose_parallel(d, workers);
    if (divided < whole)
        return divided;
    d->split = PMA_NO_SPLIT;
    return choose_parallel(d, workers);
}

/* The number of workers that pays. Twice the number is tried each time. */
static size_t worthwhile_number(division *d, size_t candidate, size_t most)
{
    size_t best = 1;
    double least = 0.8 * choose_split(d, candidate, 1);
    for (size_t workers = 2; workers / 2 < most; workers *= 2) {
        const size_t tried = workers < most ? workers : most;
        const double cost = choose_split(d, candidate, tried);
        if (cost <= least) {
            least = cost;
            best = tried;
        }
    }
    return best;
}

/* Of the subdomains that divide, the one that reads most in a macro step, if it is worth two
 * ranges. */
static size_t find_candidate(size_t count, const pma_duty *duties)
{
    size_t best = PMA_NO_SPLIT;
    double most = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double all = (double)duties[i].entries * (double)duties[i].substeps;
        if (!duties[i].divides || duties[i].entries / 2 < (size_t)PMA_RANGE || all <= most)
            continue;
        most = all;
        best = i;
    }
    return best;
}

/* No more workers than can have something to do. */
static size_t most_workers(size_t count, const pma_duty *duties, size_t candidate, size_t workers)
{
    size_t most = count > 0 ? count : 1;
    if (candidate != PMA_NO_SPLIT)
        most += duties[candidate].entries / (size_t)PMA_RANGE - 1;
    return workers < most ? workers : most;
}

/* The number of workers, and what each of them has. */
static void divide(division *d, size_t candidate, size_t most, bool worthwhile, pma_roster *out)
{
    out->workers = worthwhile ? worthwhile_number(d, candidate, most) : most;
    choose_split(d, candidate, out->workers);
    if (d->split == PMA_NO_SPLIT && out->workers > d->count && d->count > 0) {
        out->workers = d->count;
        choose_split(d, PMA_NO_SPLIT, out->workers);
    }
    out->fine = d->workers - d->parallel;
    out->split = d->split;
}

static void write_down(size_t count, entrant *list, pma_roster *r)
{
    size_t next = 0;
    qsort(list, count, sizeof *list, by_number);
    for (size_t w = 0; w < r->workers; w++) {
        r->begin[w] = next;
        for (size_t i = 0; i < count; i++) {
            if (list[i].worker == w)
                r->order[next++] = list[i].subdomain;
        }
    }
    r->begin[r->workers] = next;
}

pma_status pma_roster_create(size_t count, const pma_duty *duties, size_t workers, bool worthwhile,
                             pma_roster *out)
{
    const size_t candidate = find_candidate(count, duties);
    const size_t most = most_workers(count, duties, candidate, workers);
    const pma_array arrays[] = {
        PMA_ARRAY(pma_roster, order, count), PMA_ARRAY(pma_roster, begin, most + 1), {0}};
    const pma_array scratch[] = {
        PMA_ARRAY(division, list, count), PMA_ARRAY(division, load, most), {0}};
    division *d = pma_object_create(sizeof *d, scratch);
    *out = (pma_roster){.workers = 0};
    out->block = pma_object_fill(out, arrays);
    if (!d || !out->block) {
        pma_memory_release(d);
        pma_roster_destroy(out);
        return PMA_NO_MEMORY;
    }
    d->count = count;
    for (size_t i = 0; i < count; i++)
        d->list[i] = (entrant){duties[i], i, 0};
    qsort(d->list, count, sizeof *d->list, by_size);
    divide(d, candidate, most, worthwhile, out);
    write_down(count, d->list, out);
    pma_memory_release(d);
    return PMA_OK;
}

void pma_roster_destroy(pma_roster *r)
{
    pma_memory_release(r->block);
    *r = (pma_roster){0};
}
