/* A stopwatch for tests: a second passes at every look. */
#include "stopwatch.h"

double stopwatch_seconds(void) {
    static double looks = 0.0;
    return looks += 1.0;
}
