#include "median.h"

#include <math.h>
#include <stdbool.h>

/* Partial sort: no value before `middle` is larger than it, none behind is smaller (Hoare 1961). */
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

enum { LEAST_SAMPLED = 1024, SAMPLE_MAX = 2048 };

/* Size of a sample of `count` values, a power of 2: sorting it takes about as long as sorting the values between its
 * limits. */
static size_t sample_size(size_t count) {
    size_t size = SAMPLE_MAX;
    while ((double)size * (double)size * (double)size > 2.0 * (double)count * (double)count)
        size /= 2;
    return size;
}

/* Limits that are likely to contain the median of the sampled values: four standard deviations of the sample's median
 * to both sides. */
static void likely_limits(double *sample, size_t size, double *low, double *high) {
    const size_t margin = (size_t)(2.0 * sqrt((double)size)), first = size / 2 - margin;
    select_place(sample, size, first);
    *low = sample[first];
    select_place(sample + first, size - first, 2 * margin);
    *high = sample[first + 2 * margin];
}

static const double *list_of(const ValueLists *lists, size_t chunk) {
    return lists->map + chunk_row(lists->nx, chunk) * lists->ny;
}

/* Samples values at even distances. */
static void take_sample(const ValueLists *lists, size_t distance, size_t size, double *sample) {
    size_t taken = 0, before = 0;
    for (size_t chunk = 0; chunk < CHUNKS; before += lists->lengths[chunk++])
        for (; taken < size && taken * distance < before + lists->lengths[chunk]; taken++)
            sample[taken] = list_of(lists, chunk)[taken * distance - before];
}

/* Partition of values by two limits: the number below, and the number within, which are in `room`. */
typedef struct {
    size_t below, within;
} Sides;

/* No branch depends on a value: branch prediction would fail. */
static Sides take_within(const ValueLists *lists, double low, double high, double *room) {
    Sides sides = {0, 0};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        const double *values = list_of(lists, chunk), *end = values + lists->lengths[chunk];
        for (; values < end; values++) {
            const size_t is_below = *values < low, is_up_to = *values <= high;
            room[sides.within] = *values;
            sides.within += is_up_to - is_below;
            sides.below += is_below;
        }
    }
    return sides;
}

/* k-th smallest value (k = middle), or its mean with the one before. */
static double kth_smallest(double *values, size_t count, size_t middle, bool with_before) {
    select_place(values, count, middle);
    if (!with_before)
        return values[middle];
    double before = values[0];
    for (size_t k = 1; k < middle; k++)
        before = values[k] > before ? values[k] : before;
    return 0.5 * (before + values[middle]);
}

double upper_quartile(double *values, size_t count) {
    select_place(values, count, 3 * count / 4);
    return values[3 * count / 4];
}

double median(double *values, size_t count) {
    return kth_smallest(values, count, count / 2, count % 2 == 0);
}

double median_of_lists(const ValueLists *lists, double *room) {
    size_t count = 0;
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        count += lists->lengths[chunk];
    const size_t middle = count / 2;
    /* with limits for the median only the values about it are sorted (Floyd, Rivest 1975) */
    if (count >= LEAST_SAMPLED) {
        const size_t size = sample_size(count);
        double sample[SAMPLE_MAX], low, high;
        take_sample(lists, count / size, size, sample);
        likely_limits(sample, size, &low, &high);
        const Sides sides = take_within(lists, low, high, room);
        if (middle > sides.below && middle < sides.below + sides.within) /* the value before the middle counts, too */
            return kth_smallest(room, sides.within, middle - sides.below, count % 2 == 0);
    }
    take_within(lists, -INFINITY, INFINITY, room);
    return median(room, count);
}

static const double WITHIN = 9.0, MEAN_WITHIN = 0.97334; /* mean square of a normal variable of variance 1 up to 9 */

/* Sum and number of squares. */
typedef struct {
    double sum, count;
} SquareSums;

/* No branch depends on a value, as above. */
static void add_within(const double *squares, size_t count, double variance, SquareSums *sums) {
    for (size_t k = 0; k < count; k++) {
        const double is_within = squares[k] <= WITHIN * variance;
        sums->sum += is_within * squares[k];
        sums->count += is_within;
    }
}

double variance_within(const double *squares, size_t count, double variance) {
    SquareSums sums = {0.0, 0.0};
    add_within(squares, count, variance, &sums);
    return sums.sum / sums.count / MEAN_WITHIN;
}

double variance_of_lists_within(const ValueLists *lists, double variance) {
    SquareSums sums = {0.0, 0.0};
    for (size_t chunk = 0; chunk < CHUNKS; chunk++)
        add_within(list_of(lists, chunk), lists->lengths[chunk], variance, &sums);
    return sums.sum / sums.count / MEAN_WITHIN;
}
