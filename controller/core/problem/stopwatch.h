/* A clock that limits a search; an answer depends on it only by where the search ends. */
#ifndef INKLOOP_STOPWATCH_H
#define INKLOOP_STOPWATCH_H

/* Seconds since some fixed instant. */
double stopwatch_seconds(void);

#endif
