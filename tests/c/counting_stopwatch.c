/* A stopwatch for tests: a second passes at every look, or more from some look on, as if the machine were held up. */
#include "counting_stopwatch.h"

#include <math.h>

#include "stopwatch.h"

static double looks = 0.0, now = 0.0, held_up_from = INFINITY;

enum { HOLD_UP = 1000000 }; /* seconds of a look */

double stopwatch_seconds(void) {
    looks += 1.0;
    now += looks > held_up_from ? HOLD_UP : 1;
    return now;
}

double stopwatch_looks(void) {
    return looks;
}

void hold_up_after(double more_looks) {
    held_up_from = looks + more_looks;
}
