/* Drop sizes of a cell: the droplets that may fall there, counted in droplets of the first kind allowed.
 *
 * Kinds of one ink are listed from the smallest drop to the largest; two inks of nearly one size count the same. */
#ifndef INKLOOP_DROP_LEVELS_H
#define INKLOOP_DROP_LEVELS_H

#include <math.h>
#include <stdbool.h>

#include "horizon_problem.h"

enum { NO_KIND = UINT8_MAX };

/* The first kind that `choices` allows; NO_KIND if it allows none. */
static inline uint8_t first_kind(const HorizonProblem *problem, uint16_t choices) {
    for (size_t kind = 0; kind < problem->kinds; kind++)
        if (choices >> kind & 1)
            return (uint8_t)kind;
    return NO_KIND;
}

/* Height that an interior droplet adds in all, over its nine cells [m]. */
static inline double drop_height(const Ink *ink) {
    return ink->h1 + 4.0 * ink->h2 + 4.0 * ink->h3;
}

/* Number of droplets of the kind `first` in one of `kind`. */
static inline double drop_level(const HorizonProblem *problem, size_t first, size_t kind) {
    return round(drop_height(&problem->kind[kind]) / drop_height(&problem->kind[first]));
}

/* The largest level that `choices` allows; 0 if it allows nothing. */
static inline double drop_level_max(const HorizonProblem *problem, uint16_t choices) {
    const uint8_t first = first_kind(problem, choices);
    double largest = 0.0;
    for (size_t kind = first; kind < problem->kinds; kind++)
        if (choices >> kind & 1)
            largest = fmax(largest, drop_level(problem, first, kind));
    return largest;
}

#endif
