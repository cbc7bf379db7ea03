/* With POSIX threads: one thread per share; the caller runs the first share itself. */
#include "parallel.h"

#include <pthread.h>
#include <stdbool.h>

/* The share of a thread that cannot be started runs in the calling thread. */
void run_parallel(void *(*work)(void *share), void *shares, size_t size, size_t count) {
    pthread_t thread[MAX_PARALLEL];
    bool started[MAX_PARALLEL];
    char *first = shares;
    for (size_t k = 1; k < count; k++)
        started[k] = pthread_create(&thread[k], NULL, work, first + k * size) == 0;
    if (count > 0)
        work(first);
    for (size_t k = 1; k < count; k++) {
        if (started[k])
            pthread_join(thread[k], NULL);
        else
            work(first + k * size);
    }
}
