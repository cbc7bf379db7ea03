/* A clock that limits a search; an answer depends on it only by where the search ends. */
#ifndef INKLOOP_STOPWATCH_H
#define INKLOOP_STOPWATCH_H

#include <stdbool.h>

/* Seconds since some fixed instant. */
double stopwatch_seconds(void);

/* Whether this instant has come; infinite: it never does. Looked at once in BAND_CELLS cells or so, limit or none: what
 * is looked at then counts the work. */
static inline bool is_past(double ends_at) {
    return stopwatch_seconds() >= ends_at;
}

enum { BAND_CELLS = 2048 }; /* some 0.03 ms, so that a look costs nothing (assumed) */

#endif
