#include "median.h"

#include <stdbool.h>

/* Reorders so that no value before `middle` is larger than it and none behind is smaller (Hoare 1961). */
static void select_place(double *values, size_t count, size_t middle) {
    ptrdiff_t left = 0, right = (ptrdiff_t)count - 1;
    while (left < right) {
        const double pivot = values[left + (right - left) / 2];
        ptrdiff_t i = left, j = right;
        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (pivot < values[j])
                j--;
            if (i > j)
                break;
            const double exchanged = values[i];
            values[i++] = values[j];
            values[j--] = exchanged;
        }
        if ((ptrdiff_t)middle <= j)
            right = j;
        else if ((ptrdiff_t)middle >= i)
            left = i;
        else
            return;
    }
}

enum { SAMPLE = 2048, MARGIN = 96, LEAST_SAMPLED = 4 * SAMPLE }; /* margin: four standard deviations of a middle */

/* Limits between which the middle is likely to lie, from values at even distances. */
static void likely_limits(const double *values, size_t count, double *low, double *high) {
    double sample[SAMPLE];
    for (size_t k = 0; k < SAMPLE; k++)
        sample[k] = values[k * (count / SAMPLE)];
    select_place(sample, SAMPLE, SAMPLE / 2 - MARGIN);
    *low = sample[SAMPLE / 2 - MARGIN];
    select_place(sample, SAMPLE, SAMPLE / 2 + MARGIN);
    *high = sample[SAMPLE / 2 + MARGIN];
}

/* The values from `low` to `high` to the front, over the others; returns their number. No branch depends on a value: no
 * processor could predict it. */
static size_t keep_between(double *values, size_t count, double low, double high) {
    size_t inside = 0;
    for (size_t k = 0; k < count; k++) {
        const double value = values[k];
        values[inside] = value;
        inside += (value >= low) & (value <= high);
    }
    return inside;
}

/* Leaves only values about the middle, if limits say where that is (Floyd, Rivest 1975); returns how many, and the
 * place of the middle among them. */
static size_t narrow(double *values, size_t count, size_t *middle) {
    double low, high;
    size_t below = 0, up_to = 0;
    likely_limits(values, count, &low, &high);
    for (size_t k = 0; k < count; k++) {
        below += values[k] < low;
        up_to += values[k] <= high;
    }
    if (*middle <= below || *middle >= up_to) /* the value before the middle counts, too */
        return count;
    *middle -= below;
    return keep_between(values, count, low, high);
}

double median(double *values, size_t count) {
    const bool is_even = count % 2 == 0;
    size_t middle = count / 2;
    if (count >= LEAST_SAMPLED)
        count = narrow(values, count, &middle);
    select_place(values, count, middle);
    if (!is_even)
        return values[middle];
    double before = values[0];
    for (size_t k = 1; k < middle; k++)
        before = values[k] > before ? values[k] : before;
    return 0.5 * (before + values[middle]);
}
