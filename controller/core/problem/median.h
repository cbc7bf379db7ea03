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

/* Sum and number of squares. */
typedef struct {
    double sum, count;
} SquareSums;

/* Adds the squares within three standard deviations; variance: the square of one. */
void add_squares_within(const double *squares, size_t count, double variance, SquareSums *sums);

/* Variance of a normal variable of which `sums` holds the squares within three standard deviations. Variables without
 * tails, as uniform ones, have all theirs within: it is 3 % larger. */
double mean_square(const SquareSums *sums);

#endif
