/* Median of unsorted values. */
#ifndef INKLOOP_MEDIAN_H
#define INKLOOP_MEDIAN_H

#include "row_ranges.h"

/* Median and upper quartile of the squares of normal variables of variance 1. */
static const double MEDIAN_SQUARE = 0.4549, QUARTILE_SQUARE = 1.3233;

/* Median of at least one value, the mean of the two middle ones for an even number; reorders `values`. */
double median(double *values, size_t count);

/* Upper quartile of at least one value; reorders `values`. */
double upper_quartile(double *values, size_t count);

/* Lists of values, one for each chunk of a grid, in one map, each where the rows of its chunk begin. */
typedef struct {
    size_t nx, ny;
    const double *map;
    size_t lengths[CHUNKS];
} ValueLists;

/* Median of all lists together; `room` holds a map. */
double median_of_lists(const ValueLists *lists, double *room);

/* Variance of a normal variable by those of its squares that lie within three standard deviations; variance: a rough
 * one, which sets these. Uniform variables have all squares within: theirs is 3 % larger. */
double variance_within(const double *squares, size_t count, double variance);

/* The same of all lists together. */
double variance_of_lists_within(const ValueLists *lists, double variance);

#endif
