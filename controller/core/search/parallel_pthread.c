#include "side_by_side.h"

#include <pthread.h>
#include <stdbool.h>

/* A thread that cannot be started is done here. */
void side_by_side(void *(*work)(void *share), void *shares, size_t size, size_t count) {
    pthread_t thread[SHARES_AT_ONCE];
    bool started[SHARES_AT_ONCE];
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
