#include "passes.h"

/* order - 1, place in the order -> colour */
static const int ORDERS[2][COLOURS] = {{0, 1, 2, 3}, {0, 3, 1, 2}};

int pass_colour(const Passes *how, int32_t layer, int pass) {
    const int64_t place = ((int64_t)how->rotation * layer + pass) % COLOURS;
    return how->passes == 1 ? COLOUR_ALL : ORDERS[how->order - 1][place];
}

Outcome check_passes(Instance *instance, int32_t passes) {
    if (passes == 1 || passes == COLOURS)
        return ACCEPTED;
    return refuse(instance, "passes is %ld; expected 1 or 4; nothing was set", (long)passes);
}
