/* The middle of unsorted values. */
#ifndef INKLOOP_MEDIAN_H
#define INKLOOP_MEDIAN_H

#include "row_ranges.h"

/* Of the squares of normal variables of variance 1: their median, and their upper quartile. */
static const double MEDIAN_SQUARE = 0.4549, QUARTILE_SQUARE = 1.3233;

/* The value in the middle, or the mean of the two that are, of at least one; what is left in `values` is of no use. */
double median(double *values, size_t count);

/* The value that a quarter of them, of at least one, is not below; what is left in `values` is of no use. */
double upper_quartile(double *values, size_t count);

/* Lists that the chunks of a grid left in a map of it, each where the rows of its chunk begin. */
typedef struct {
    size_t nx, ny;
    const double *map;
    size_t lengths[CHUNKS];
} ValueLists;

/* The same of all lists together; `room` holds a map. */
double median_of_lists(const ValueLists *lists, double *room);

#endif
