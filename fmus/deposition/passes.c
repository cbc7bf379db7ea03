#include "passes.h"

Outcome check_passes(Instance *instance, int32_t passes) {
    if (passes == 1 || passes == COLOURS)
        return ACCEPTED;
    return refuse(instance, "passes is %ld; expected 1 or 4; nothing was set", (long)passes);
}
