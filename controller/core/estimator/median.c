#include "median.h"

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

double median(double *values, size_t count) {
    const size_t middle = count / 2;
    select_place(values, count, middle);
    if (count % 2 == 1)
        return values[middle];
    double below = values[0];
    for (size_t k = 1; k < middle; k++)
        below = values[k] > below ? values[k] : below;
    return 0.5 * (below + values[middle]);
}
