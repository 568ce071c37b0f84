#include "roster.h"

#include <stdlib.h>
#include <string.h>

/* A subdomain in the order in which they are given to workers. */
typedef struct {
    pma_duty duty;
    size_t subdomain, worker;
} entrant;

static int compare(size_t x, size_t y)
{
    return (x > y) - (x < y);
}

/* Those with the finest steps first; of them the caller's, then the largest first, equal ones as
 * they stand. */
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

static size_t least_loaded(const double *load, size_t workers)
{
    size_t least = 0;
    for (size_t w = 1; w < workers; w++)
        least = load[w] < load[least] ? w : least;
    return least;
}

static double largest(const double *load, size_t workers)
{
    double most = 0.0;
    for (size_t w = 0; w < workers; w++)
        most = load[w] > most ? load[w] : most;
    return most;
}

/* Everybody to the least loaded worker, but to worker 0 what the caller has to do. What a fine step
 * takes is the load of the busiest worker, counted over those that have a node there, that is about
 * all that are not coarser:
 *
 *     cost = sum_c (s_c - s_{c+1}) max_w load_w(c) + meetings                             (W1)
 *
 * with the classes c of equal substeps s_c from the finest on, and load_w(c) the entries of one own
 * step of all that worker w has in the classes up to c. */
static double assign(size_t count, entrant *list, size_t workers, double *load)
{
    double cost = workers > 1 ? (double)PMA_MEETING * (double)list[0].duty.substeps : 0.0;
    memset(load, 0, workers * sizeof *load);
    for (size_t i = 0; i < count; i++) {
        const size_t coarser = i + 1 < count ? list[i + 1].duty.substeps : 0;
        list[i].worker = list[i].duty.by_caller ? 0 : least_loaded(load, workers);
        load[list[i].worker] += (double)list[i].duty.entries;
        cost += (double)(list[i].duty.substeps - coarser) * largest(load, workers);
    }
    return cost;
}

/* As many workers as pay. Twice as many are tried each time. */
static size_t worthwhile_number(size_t count, entrant *list, size_t most, double *load)
{
    const double alone = assign(count, list, 1, load);
    size_t best = 1;
    double least = 0.8 * alone;
    for (size_t workers = 2; workers / 2 < most; workers *= 2) {
        const size_t tried = workers < most ? workers : most;
        const double cost = assign(count, list, tried, load);
        if (cost <= least) {
            least = cost;
            best = tried;
        }
    }
    return best;
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
    const size_t most = workers < count || count == 0 ? workers : count;
    entrant *list = calloc(count + 1, sizeof *list);
    double *load = calloc(most, sizeof *load);
    *out = (pma_roster){.order = calloc(count + 1, sizeof *out->order),
                        .begin = calloc(most + 1, sizeof *out->begin)};
    if (!list || !load || !out->order || !out->begin) {
        free(list);
        free(load);
        pma_roster_destroy(out);
        return PMA_NO_MEMORY;
    }
    for (size_t i = 0; i < count; i++)
        list[i] = (entrant){duties[i], i, 0};
    qsort(list, count, sizeof *list, by_size);
    out->workers = worthwhile ? worthwhile_number(count, list, most, load) : most;
    assign(count, list, out->workers, load);
    write_down(count, list, out);
    free(list);
    free(load);
    return PMA_OK;
}

void pma_roster_destroy(pma_roster *r)
{
    free(r->order);
    free(r->begin);
    *r = (pma_roster){0};
}
