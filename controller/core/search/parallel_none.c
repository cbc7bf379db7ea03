#include "side_by_side.h"

void side_by_side(void *(*work)(void *share), void *shares, size_t size, size_t count) {
    for (size_t k = 0; k < count; k++)
        work((char *)shares + k * size);
}
