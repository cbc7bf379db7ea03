#include "error_diffusion.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "stopwatch.h"

/* The neighbours that come later in the order of the sweep, with their shares of the error. */
static const struct {
    int rows, ahead;
    double share;
} LATER[] = {{0, 1, 7.0 / 16.0}, {1, -1, 3.0 / 16.0}, {1, 0, 5.0 / 16.0}, {1, 1, 1.0 / 16.0}};
enum { LATERS = 4 };

/* Drop levels of the kinds, each in droplets of each other kind. */
typedef struct {
    double level[KINDS_MAX][KINDS_MAX];
} Levels;

static Levels levels_of(const HorizonProblem *problem) {
    Levels levels;
    for (size_t first = 0; first < problem->kinds; first++)
        for (size_t kind = 0; kind < problem->kinds; kind++)
            levels.level[first][kind] = drop_level(problem, first, kind);
    return levels;
}

/* The largest level that `choices` allows; 0 if it allows nothing. */
static double level_max(const HorizonProblem *problem, const Levels *levels, uint16_t choices) {
    const uint8_t first = first_kind(problem, choices);
    double largest = 0.0;
    for (size_t kind = first; kind < problem->kinds; kind++)
        if (choices >> kind & 1 && levels->level[first][kind] > largest)
            largest = levels->level[first][kind];
    return largest;
}

/* The largest kind that `choices` allows and that is at most `amount` droplets of the first one; NO_KIND if none is. */
static uint8_t kind_for(const HorizonProblem *problem, const Levels *levels, uint16_t choices, double amount) {
    const uint8_t first = first_kind(problem, choices);
    uint8_t best = NO_KIND;
    double largest = 0.0;
    for (size_t kind = first; kind < problem->kinds; kind++) {
        const double level = choices >> kind & 1 ? levels->level[first][kind] : 0.0;
        if (level > largest && level <= amount) {
            best = (uint8_t)kind;
            largest = level;
        }
    }
    return best;
}

/* Jets `amount` droplets on a cell, in the last layers first; returns the number jetted. */
static double fill_layers(const HorizonProblem *problem, const Levels *levels, size_t cell, double amount,
                          int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    double left = amount;
    for (size_t layer = problem->layers; layer-- > 0;) {
        const uint16_t choices = problem->choices[layer * cells + cell];
        const uint8_t kind = kind_for(problem, levels, choices, left);
        plan[layer * cells + cell] = kind == NO_KIND ? 0 : 1 + kind;
        if (kind != NO_KIND)
            left -= levels->level[first_kind(problem, choices)][kind];
    }
    return amount - left;
}

/* Two rows of cells: the one being rounded, and the next one. */
typedef struct {
    double *wanted[2], *room[2]; /* droplets still to be jetted on a cell, and the most allowed */
} RollingRows;

/* Takes row i of the droplets into the rows `wanted` and `room`; nothing behind the last one. */
static void take_row(const HorizonProblem *problem, const Levels *levels, const double *droplets, size_t i,
                     double *wanted, double *room) {
    const size_t ny = problem->ny, cells = problem->nx * ny;
    memset(wanted, 0, ny * sizeof *wanted);
    memset(room, 0, ny * sizeof *room);
    for (size_t layer = 0; i < problem->nx && layer < problem->layers; layer++) {
        const size_t first = layer * cells + i * ny;
        for (size_t j = 0; j < ny; j++) {
            const double limit = level_max(problem, levels, problem->choices[first + j]);
            room[j] += limit;
            wanted[j] += droplets[first + j] < limit ? droplets[first + j] : limit;
        }
    }
}

/* Distributes `error` over the later neighbours that may get droplets at all; `forward`: +1 or -1 along the row. */
static void pass_on(const HorizonProblem *problem, const RollingRows *rows, size_t i, size_t j, ptrdiff_t forward,
                    double error) {
    bool takes[LATERS];
    double share = 0.0;
    for (int k = 0; k < LATERS; k++) {
        const ptrdiff_t column = (ptrdiff_t)j + forward * LATER[k].ahead;
        takes[k] = i + (size_t)LATER[k].rows < problem->nx && column >= 0 && column < (ptrdiff_t)problem->ny &&
                   rows->room[LATER[k].rows][column] > 0.0;
        share += takes[k] ? LATER[k].share : 0.0;
    }
    for (int k = 0; k < LATERS && share == 1.0; k++)
        rows->wanted[LATER[k].rows][(ptrdiff_t)j + forward * LATER[k].ahead] += error * LATER[k].share;
    for (int k = 0; k < LATERS && share < 1.0; k++)
        if (takes[k])
            rows->wanted[LATER[k].rows][(ptrdiff_t)j + forward * LATER[k].ahead] += error * LATER[k].share / share;
}

int32_t diffuse_droplets(const HorizonProblem *problem, const double *droplets, double ends_at, int32_t *plan) {
    const size_t nx = problem->nx, ny = problem->ny, band = 1 + BAND_CELLS / ny;
    int32_t status = CORE_DONE;
    double *memory = malloc(4 * ny * sizeof(double));
    if (!memory)
        return CORE_NO_MEMORY;
    const Levels levels = levels_of(problem);
    take_row(problem, &levels, droplets, 0, memory, memory + 2 * ny);
    for (size_t i = 0; i < nx && status == CORE_DONE; i++) {
        const size_t own = i % 2, next = 1 - own;
        const RollingRows rows = {{memory + own * ny, memory + next * ny},
                                  {memory + (2 + own) * ny, memory + (2 + next) * ny}};
        take_row(problem, &levels, droplets, i + 1, rows.wanted[1], rows.room[1]);
        for (size_t step = 0; step < ny; step++) {
            const size_t j = own ? ny - 1 - step : step; /* back on every other row */
            const double nearest = floor(rows.wanted[0][j] + 0.5), least = nearest > 0.0 ? nearest : 0.0;
            const double whole = least < rows.room[0][j] ? least : rows.room[0][j];
            const double fallen = fill_layers(problem, &levels, i * ny + j, whole, plan);
            pass_on(problem, &rows, i, j, own ? -1 : 1, rows.wanted[0][j] - fallen);
        }
        if (i % band == 0 && is_past(ends_at))
            status = CORE_TIME;
    }
    free(memory);
    return status;
}

enum { SIDE_OF_PATTERN = 4, THRESHOLDS = SIDE_OF_PATTERN * SIDE_OF_PATTERN };

/* Thresholds of Bayer (1973): each next droplet falls as far as possible from those before. */
static const int ORDER[SIDE_OF_PATTERN][SIDE_OF_PATTERN] = {
    {0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};

void dither_droplets(const HorizonProblem *problem, const double *droplets, int32_t *plan) {
    for (size_t i = 0; i < problem->nx; i++)
        for (size_t j = 0; j < problem->ny; j++) {
            const size_t cell = i * problem->ny + j;
            const double threshold = (ORDER[i % SIDE_OF_PATTERN][j % SIDE_OF_PATTERN] + 0.5) / THRESHOLDS;
            const uint8_t kind = first_kind(problem, problem->choices[cell]);
            plan[cell] = kind != NO_KIND && droplets[cell] > threshold ? 1 + kind : 0;
        }
}
