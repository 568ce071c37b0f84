#include "algebra/strips.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "algebra/kernel.h"

static size_t rows_of(const pma_strips *S, size_t s)
{
    return (size_t)(S->first[s + 1] - S->first[s]);
}

static size_t columns_of(const pma_strips *S, size_t s)
{
    return (size_t)(S->ptr[s + 1] - S->ptr[s]);
}

/* ---- checks --------------------------------------------------------------------------------- */

/* Four whose last is three above the first are read at one go. */
static bool four_are_right(const int32_t *index)
{
    return index[3] - index[0] != 3 || (index[1] - index[0] == 1 && index[2] - index[0] == 2);
}

pma_status pma_strips_check(const pma_strips *S, size_t n)
{
    if (S->first[0] != 0 || S->ptr[0] != 0 || S->start[0] != 0 || S->first[S->count] != (int64_t)n)
        return PMA_BAD_INDEX;
    for (size_t s = 0; s < S->count; s++) {
        if (S->first[s + 1] <= S->first[s] || S->first[s + 1] > (int64_t)n ||
            rows_of(S, s) > PMA_STRIP_ROWS || S->ptr[s + 1] < S->ptr[s] ||
            columns_of(S, s) % 4 != 0 ||
            S->start[s + 1] - S->start[s] != (int64_t)(rows_of(S, s) * columns_of(S, s)))
            return PMA_BAD_INDEX;
    }
    for (int64_t k = 0; k < S->ptr[S->count]; k++) {
        if (S->index[k] < 0 || (size_t)S->index[k] >= n)
            return PMA_BAD_INDEX;
    }
    for (int64_t k = 0; k < S->ptr[S->count]; k += 4) {
        if (!four_are_right(S->index + k))
            return PMA_BAD_INDEX;
    }
    return PMA_OK;
}

size_t pma_strips_reach(const pma_strips *S)
{
    int64_t reach = 0;
    for (size_t s = 0; s < S->count; s++) {
        for (int64_t k = S->ptr[s]; k < S->ptr[s + 1]; k++) {
            const int64_t above = S->first[s + 1] - 1 - S->index[k],
                          below = S->index[k] - S->first[s];
            const int64_t distance = above > below ? above : below;
            reach = distance > reach ? distance : reach;
        }
    }
    return (size_t)reach;
}

/* ---- making --------------------------------------------------------------------------------- */

static int64_t padded(int64_t columns)
{
    return (columns + 3) / 4 * 4;
}

static int64_t bytes_of(int64_t rows, int64_t columns)
{
    return (8 * rows + 4) * padded(columns) + 24;
}

size_t pma_strips_group(size_t n, const int64_t *ptr, const int32_t *index, int64_t *first,
                        int64_t *columns, int64_t *mark)
{
    size_t count = 0;
    for (size_t i = 0; i < n; i++)
        mark[i] = -1;
    for (size_t i = 0; i < n; i++) {
        const int64_t row = (int64_t)i, length = ptr[i + 1] - ptr[i], open = (int64_t)count - 1;
        int64_t more = 0; /* columns that the open strip does not have */
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++)
            more += open < 0 || mark[index[k]] != open;
        const int64_t rows = open < 0 ? PMA_STRIP_ROWS : row - first[open];
        const bool joins =
            rows < PMA_STRIP_ROWS && bytes_of(rows + 1, columns[open] + more) <=
                                         bytes_of(rows, columns[open]) + bytes_of(1, length);
        if (!joins) {
            first[count] = row;
            columns[count++] = length;
        } else {
            columns[open] += more;
        }
        for (int64_t k = ptr[i]; k < ptr[i + 1]; k++)
            mark[index[k]] = (int64_t)count - 1;
    }
    first[count] = (int64_t)n;
    for (size_t s = 0; s < count; s++)
        columns[s] = padded(columns[s]);
    return count;
}

static int ascending(const void *a, const void *b)
{
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

static void reverse(int32_t *list, size_t count)
{
    for (size_t k = 0; 2 * k + 1 < count; k++) {
        const int32_t kept = list[k];
        list[k] = list[count - 1 - k];
        list[count - 1 - k] = kept;
    }
}

/* Moves the places begin..end-1 of a list to place `to` before them; all keep their order. */
static void move_forward(int32_t *list, size_t to, size_t begin, size_t end)
{
    reverse(list + to, begin - to);
    reverse(list + begin, end - begin);
    reverse(list + to, end - to);
}

/* Of an ascending list, four columns at a time that follow one another come first: they are read
 * at one go. */
static void fours_first(int32_t *list, size_t count)
{
    size_t fours = 0;
    for (size_t k = 0; k + 4 <= count;) {
        if (list[k + 3] - list[k] != 3) {
            k++;
            continue;
        }
        move_forward(list, fours, k, k + 4);
        fours += 4;
        k += 4;
    }
}

void pma_strips_fill(const pma_strips *S, size_t n, const int64_t *ptr, const int32_t *index,
                     const double *entries, int64_t *mark, int32_t *strip_index,
                     double *strip_values)
{
    for (size_t j = 0; j < n; j++)
        mark[j] = -1;
    for (size_t s = 0; s < S->count; s++) {
        int32_t *list = strip_index + S->ptr[s];
        const int64_t rows = (int64_t)rows_of(S, s);
        size_t have = 0;
        for (int64_t k = ptr[S->first[s]]; k < ptr[S->first[s + 1]]; k++) {
            if (mark[index[k]] < S->ptr[s]) { /* not of this strip yet */
                mark[index[k]] = S->ptr[s];
                list[have++] = index[k];
            }
        }
        qsort(list, have, sizeof *list, ascending);
        fours_first(list, have);
        for (size_t k = 0; k < have; k++)
            mark[list[k]] = S->ptr[s] + (int64_t)k;
        for (size_t k = have; k < columns_of(S, s); k++)
            list[k] = list[have / 4 * 4]; /* no four that seem to follow one another */
        for (int64_t i = S->first[s]; i < S->first[s + 1]; i++) {
            double *row = strip_values + S->start[s] + 4 * (i - S->first[s]);
            for (int64_t k = ptr[i]; k < ptr[i + 1]; k++) {
                const int64_t place = mark[index[k]] - S->ptr[s];
                row[place / 4 * 4 * rows + place % 4] += entries[k];
            }
        }
    }
}

/* ---- product -------------------------------------------------------------------------------- */

size_t pma_strips_at(const pma_strips *S, size_t row)
{
    size_t low = 0, high = S->count;
    while (low + 1 < high) {
        const size_t middle = low + (high - low) / 2;
        if ((size_t)S->first[middle] <= row)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Rows begin..end-1 of strip s, which has more. */
static void subtract_some(const pma_strips *S, size_t s, size_t begin, size_t end, const double *x,
                          double *y)
{
    double own[PMA_STRIP_ROWS] = {0.0};
    double *some = own + (begin - (size_t)S->first[s]);
    memcpy(some, y + begin, (end - begin) * sizeof *y);
    pma_kernel_best()->subtract_strips(S, s, s + 1, x, own);
    memcpy(y + begin, some, (end - begin) * sizeof *y);
}

void pma_strips_subtract(const pma_strips *S, size_t begin, size_t end, const double *x, double *y)
{
    if (begin == end)
        return;
    size_t s = pma_strips_at(S, begin), last = pma_strips_at(S, end - 1);
    if (begin > (size_t)S->first[s]) {
        const size_t next = (size_t)S->first[s + 1];
        subtract_some(S, s++, begin, next < end ? next : end, x, y);
    }
    if (s <= last && end == (size_t)S->first[last + 1])
        last++;
    else if (s <= last)
        subtract_some(S, last, (size_t)S->first[last], end, x, y);
    if (s < last)
        pma_kernel_best()->subtract_strips(S, s, last, x, y + S->first[s]);
}
