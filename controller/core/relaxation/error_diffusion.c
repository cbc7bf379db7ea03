#include "error_diffusion.h"

#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"

/* The neighbours that come later in the order of the sweep, with their shares of the error. */
static const struct {
    int rows, ahead;
    double share;
} LATER[] = {{0, 1, 7.0 / 16.0}, {1, -1, 3.0 / 16.0}, {1, 0, 5.0 / 16.0}, {1, 1, 1.0 / 16.0}};
enum { LATERS = 4 };

/* The largest kind that `choices` allows and that is at most `amount` droplets of the first one; NO_KIND if none is. */
static uint8_t kind_for(const HorizonProblem *problem, uint16_t choices, double amount) {
    const uint8_t first = first_kind(problem, choices);
    uint8_t best = NO_KIND;
    double largest = 0.0;
    for (size_t kind = first; kind < problem->kinds; kind++) {
        const double level = choices >> kind & 1 ? drop_level(problem, first, kind) : 0.0;
        if (level > largest && level <= amount) {
            best = (uint8_t)kind;
            largest = level;
        }
    }
    return best;
}

/* Jets `amount` droplets on a cell, in the last layers first; returns those that fell. */
static double fill_layers(const HorizonProblem *problem, size_t cell, double amount, int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    double left = amount;
    for (size_t layer = problem->layers; layer-- > 0;) {
        const uint16_t choices = problem->choices[layer * cells + cell];
        const uint8_t kind = kind_for(problem, choices, left);
        plan[layer * cells + cell] = kind == NO_KIND ? 0 : 1 + kind;
        if (kind != NO_KIND)
            left -= drop_level(problem, first_kind(problem, choices), kind);
    }
    return amount - left;
}

/* Passes `error` on to the later neighbours that may get droplets at all; `forward`: +1 or -1 along the row. */
static void pass_on(const HorizonProblem *problem, const double *room, size_t i, size_t j, ptrdiff_t forward,
                    double error, double *wanted) {
    ptrdiff_t place[LATERS];
    double share = 0.0;
    for (int k = 0; k < LATERS; k++) {
        const ptrdiff_t row = (ptrdiff_t)i + LATER[k].rows, column = (ptrdiff_t)j + forward * LATER[k].ahead;
        const bool inside = row < (ptrdiff_t)problem->nx && column >= 0 && column < (ptrdiff_t)problem->ny;
        place[k] = inside ? row * (ptrdiff_t)problem->ny + column : -1;
        if (inside && room[place[k]] == 0.0)
            place[k] = -1;
        share += place[k] >= 0 ? LATER[k].share : 0.0;
    }
    for (int k = 0; k < LATERS; k++)
        if (place[k] >= 0)
            wanted[place[k]] += error * LATER[k].share / share;
}

int32_t diffuse_droplets(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    double *wanted = calloc(2 * cells, sizeof(double));
    if (!wanted)
        return CORE_NO_MEMORY;
    double *room = wanted + cells;
    for (size_t place = 0; place < problem->layers * cells; place++) {
        const double limit = drop_level_max(problem, problem->choices[place]);
        room[place % cells] += limit;
        wanted[place % cells] += fmin(limit, droplets[place]);
    }
    for (size_t i = 0; i < problem->nx; i++) {
        const bool backwards = i % 2;
        for (size_t step = 0; step < problem->ny; step++) {
            const size_t j = backwards ? problem->ny - 1 - step : step, cell = i * problem->ny + j;
            const double whole = fmin(room[cell], fmax(0.0, floor(wanted[cell] + 0.5)));
            const double fallen = fill_layers(problem, cell, whole, plan);
            pass_on(problem, room, i, j, backwards ? -1 : 1, wanted[cell] - fallen, wanted);
        }
    }
    free(wanted);
    return CORE_DONE;
}
