/* A clock that limits a search; an answer depends on it only by the place where the search ends. */
#ifndef INKLOOP_STOPWATCH_H
#define INKLOOP_STOPWATCH_H

#include <stdbool.h>

/* Seconds since some fixed instant. */
double stopwatch_seconds(void);

/* Whether this instant has passed; never if infinite. Called about once in BAND_CELLS cells, with or without a
 * limit. */
static inline bool is_past(double ends_at) {
    return stopwatch_seconds() >= ends_at;
}

enum { BAND_CELLS = 2048 }; /* cells in some 0.03 ms, so that a call costs nothing (assumed) */

#endif
