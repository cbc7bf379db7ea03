#include "error_diffusion.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "row_ranges.h"
#include "stopwatch.h"

/* The neighbours that come later in the order of the sweep, with their shares of the error. */
static const struct {
    int rows, ahead;
    double share;
} LATER[] = {{0, 1, 7.0 / 16.0}, {1, -1, 3.0 / 16.0}, {1, 0, 5.0 / 16.0}, {1, 1, 1.0 / 16.0}};
enum { LATERS = 4 };
/* rows whose chunks are rounded each on its own (by trial: as good, within the 0.3 % of another seed) */
enum { CUT_FROM = 32 * CHUNKS };

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

/* Jets `amount` droplets on a cell, and returns the number jetted: one in each layer, the last ones first; what exceeds
 * that evenly, as small drops leave the repair more than large ones in few layers. */
static double fill_layers(const HorizonProblem *problem, const Levels *levels, size_t cell, double amount,
                          int32_t *plan) {
    const size_t cells = problem->nx * problem->ny;
    double left = amount, layers = 0.0; /* layers that may still get droplets */
    for (size_t layer = 0; layer < problem->layers; layer++)
        layers += problem->choices[layer * cells + cell] > 0;
    for (size_t layer = problem->layers; layer-- > 0;) {
        const uint16_t choices = problem->choices[layer * cells + cell];
        const double even = choices > 0 ? fmin(left, fmax(1.0, floor(left / layers))) : 0.0;
        const uint8_t kind = kind_for(problem, levels, choices, even);
        layers -= choices > 0;
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

/* Takes row i of the droplets into the rows `wanted` and `room`; nothing from row `bottom` on. */
static void take_row(const HorizonProblem *problem, const Levels *levels, const double *droplets, size_t i,
                     size_t bottom, double *wanted, double *room) {
    const size_t ny = problem->ny, cells = problem->nx * ny;
    memset(wanted, 0, ny * sizeof *wanted);
    memset(room, 0, ny * sizeof *room);
    for (size_t layer = 0; i < bottom && layer < problem->layers; layer++) {
        const size_t first = layer * cells + i * ny;
        for (size_t j = 0; j < ny; j++) {
            const double limit = level_max(problem, levels, problem->choices[first + j]);
            room[j] += limit;
            wanted[j] += droplets[first + j] < limit ? droplets[first + j] : limit;
        }
    }
}

/* Distributes `error` over the later neighbours that may get droplets at all; `forward`: +1 or -1 along the row. */
static void pass_on(const RollingRows *rows, size_t ny, size_t j, ptrdiff_t forward, double error) {
    bool takes[LATERS];
    double share = 0.0;
    for (int k = 0; k < LATERS; k++) {
        const ptrdiff_t column = (ptrdiff_t)j + forward * LATER[k].ahead;
        takes[k] = column >= 0 && column < (ptrdiff_t)ny && rows->room[LATER[k].rows][column] > 0.0;
        share += takes[k] ? LATER[k].share : 0.0;
    }
    for (int k = 0; k < LATERS && share == 1.0; k++)
        rows->wanted[LATER[k].rows][(ptrdiff_t)j + forward * LATER[k].ahead] += error * LATER[k].share;
    for (int k = 0; k < LATERS && share < 1.0; k++)
        if (takes[k])
            rows->wanted[LATER[k].rows][(ptrdiff_t)j + forward * LATER[k].ahead] += error * LATER[k].share / share;
}

/* The diffusion, or the dither, of all threads. */
typedef struct {
    const HorizonProblem *problem;
    Levels levels;
    const double *droplets;
    double ends_at;
    double *rows; /* four for each thread */
    int32_t *plan;
    bool is_cut, is_late[CHUNKS];
} Rounding;

/* Rounds the rows `top` to `bottom` excluded, of which nothing is passed on; false if the time has ended. */
static bool diffuse_rows(const Rounding *rounding, size_t top, size_t bottom, double *memory) {
    const HorizonProblem *problem = rounding->problem;
    const size_t ny = problem->ny, band = 1 + BAND_CELLS / ny;
    take_row(problem, &rounding->levels, rounding->droplets, top, bottom, memory, memory + 2 * ny);
    for (size_t i = top; i < bottom; i++) {
        const size_t own = (i - top) % 2, next = 1 - own;
        const RollingRows rows = {{memory + own * ny, memory + next * ny},
                                  {memory + (2 + own) * ny, memory + (2 + next) * ny}};
        take_row(problem, &rounding->levels, rounding->droplets, i + 1, bottom, rows.wanted[1], rows.room[1]);
        for (size_t step = 0; step < ny; step++) {
            const size_t j = own ? ny - 1 - step : step; /* back on every other row */
            const double nearest = floor(rows.wanted[0][j] + 0.5), least = nearest > 0.0 ? nearest : 0.0;
            const double whole = least < rows.room[0][j] ? least : rows.room[0][j];
            const double fallen = fill_layers(problem, &rounding->levels, i * ny + j, whole, rounding->plan);
            pass_on(&rows, ny, j, own ? -1 : 1, rows.wanted[0][j] - fallen);
        }
        if (i % band == 0 && is_past(rounding->ends_at))
            return false;
    }
    return true;
}

static void diffuse_range(void *context, const RowRange *range) {
    Rounding *rounding = context;
    double *memory = rounding->rows + 4 * rounding->problem->ny * range->thread;
    bool is_done = true;
    if (!rounding->is_cut)
        is_done = diffuse_rows(rounding, range->top, range->bottom, memory);
    for (size_t chunk = range->chunk; rounding->is_cut && chunk < range->end && is_done; chunk++)
        is_done = diffuse_rows(rounding, chunk_row(rounding->problem->nx, chunk),
                               chunk_row(rounding->problem->nx, chunk + 1), memory);
    rounding->is_late[range->thread] = !is_done;
}

int32_t diffuse_droplets(const HorizonProblem *problem, int32_t threads, const double *droplets, double ends_at,
                         int32_t *plan) {
    const bool is_cut = problem->nx >= CUT_FROM;
    const size_t useful = is_cut ? row_threads((size_t)threads, problem->nx, problem->ny) : 1;
    Rounding rounding = {.problem = problem,
                         .levels = levels_of(problem),
                         .droplets = droplets,
                         .ends_at = ends_at,
                         .rows = malloc(useful * 4 * problem->ny * sizeof(double)),
                         .plan = plan,
                         .is_cut = is_cut};
    bool is_late = false;
    if (!rounding.rows)
        return CORE_NO_MEMORY;
    run_rows(useful, problem->nx, problem->ny, diffuse_range, &rounding);
    free(rounding.rows);
    for (size_t k = 0; k < CHUNKS; k++)
        is_late = is_late || rounding.is_late[k];
    return is_late ? CORE_TIME : CORE_DONE;
}

enum { SIDE_OF_PATTERN = 4, THRESHOLDS = SIDE_OF_PATTERN * SIDE_OF_PATTERN };

/* Thresholds of Bayer (1973): each next droplet falls as far as possible from those before. */
static const int ORDER[SIDE_OF_PATTERN][SIDE_OF_PATTERN] = {
    {0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};

static void dither_range(void *context, const RowRange *range) {
    const Rounding *rounding = context;
    const HorizonProblem *problem = rounding->problem;
    for (size_t i = range->top; i < range->bottom; i++)
        for (size_t j = 0; j < problem->ny; j++) {
            const size_t cell = i * problem->ny + j;
            const double threshold = (ORDER[i % SIDE_OF_PATTERN][j % SIDE_OF_PATTERN] + 0.5) / THRESHOLDS;
            const uint8_t kind = first_kind(problem, problem->choices[cell]);
            rounding->plan[cell] = kind != NO_KIND && rounding->droplets[cell] > threshold ? 1 + kind : 0;
        }
}

void dither_droplets(const HorizonProblem *problem, int32_t threads, const double *droplets, int32_t *plan) {
    Rounding rounding = {.problem = problem, .droplets = droplets, .plan = plan};
    run_rows((size_t)threads, problem->nx, problem->ny, dither_range, &rounding);
}
