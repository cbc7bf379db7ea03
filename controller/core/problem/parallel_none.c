/* Without threads: the shares run one after the other. */
#include "parallel.h"

void run_parallel(void *(*work)(void *share), void *shares, size_t size, size_t count) {
    for (size_t k = 0; k < count; k++)
        work((char *)shares + k * size);
}
