#include "passes.h"

/* order - 1, place in the order -> colour 2 * (i % 2) + (j % 2) */
static const int ORDERS[2][COLOURS] = {{0, 1, 2, 3}, {0, 3, 1, 2}};

int pass_colour(const Passes *how, int32_t layer, int pass) {
    const int64_t place = ((int64_t)how->rotation * layer + pass) % COLOURS;
    return how->passes == 1 ? -1 : ORDERS[how->order - 1][place];
}

Outcome check_passes(Instance *instance, int32_t passes) {
    if (passes == 1 || passes == COLOURS)
        return ACCEPTED;
    return refuse(instance, "passes is %ld; expected 1 or 4; nothing was set", (long)passes);
}
