#if !defined(_WIN32)
#define _POSIX_C_SOURCE 199309L
#endif

#include "stopwatch.h"

#if defined(_WIN32)
#include <windows.h>

double stopwatch_seconds(void) {
    LARGE_INTEGER ticks, ticks_per_second;
    QueryPerformanceCounter(&ticks);
    QueryPerformanceFrequency(&ticks_per_second);
    return (double)ticks.QuadPart / (double)ticks_per_second.QuadPart;
}
#else
#include <time.h>

double stopwatch_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}
#endif
