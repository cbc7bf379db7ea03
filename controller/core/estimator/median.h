/* The middle of unsorted values. */
#ifndef INKLOOP_MEDIAN_H
#define INKLOOP_MEDIAN_H

#include <stddef.h>

/* The value in the middle, or the mean of the two that are, of at least one; what is left in `values` is of no use. */
double median(double *values, size_t count);

#endif
