/* A clock to guard a search by; nothing of an answer depends on it but where the search ends. */
#ifndef INKLOOP_STOPWATCH_H
#define INKLOOP_STOPWATCH_H

/* Seconds since some fixed instant. */
double stopwatch_seconds(void);

#endif
