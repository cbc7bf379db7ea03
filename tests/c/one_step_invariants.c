/* Invariants of one_step_sweep.h and flip_bounds.h on random problems; prints the first one that does not hold and ends
 * with 1, or else the bits of all plans that were found. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "counter_random.h"
#include "stopwatch.h"
#include "tiled_sweep.h"

enum { NX = 23, NY = 70, CELLS = NX * NY, FRAMED = (NX + 2) * (NY + 2), CHANGES = 150, PROBLEMS = 48 };

static const Ink KINDS[2] = {{4.4e-6, 0.6e-6, 0.2e-6}, {3.9e-6, 0.55e-6, 0.15e-6}};
static const Tile TILES[2] = {{0, NX, 0, TILE}, {0, NX, TILE, NY}};

static double height[CELLS], target[CELLS], ceiling[CELLS], weight[CELLS];
static uint8_t part[CELLS];
static uint16_t choices[CELLS];
static int32_t plan[CELLS];
static uint64_t bits = 1;
static int64_t known = 0, in_vain = 0; /* flips that have a bound, and those of them that it leaves out */

double stopwatch_seconds(void) {
    return 0.0;
}

static HorizonProblem random_problem(uint64_t seed) {
    HorizonProblem problem = {.nx = NX,
                              .ny = NY,
                              .layers = 1,
                              .height = height,
                              .target = target,
                              .ceiling = seed % 2 ? ceiling : NULL,
                              .part = part,
                              .weight = seed % 4 > 1 ? weight : NULL,
                              .choices = choices,
                              .kinds = 1 + (seed / 24) % 2,
                              .alpha = seed % 3 ? 1.0 : 0.5,
                              .overshoot = 1.0 + 0.7 * (double)((seed / 4) % 2),
                              .ceiling_cost = 10.0,
                              .droplet_std = (seed / 8) % 3 == 1 ? 0.2 : 0.0,
                              .passes = 1};
    memcpy(problem.kind, KINDS, sizeof KINDS);
    uint64_t drawn = 0;
    for (size_t cell = 0; cell < CELLS; cell++) {
        height[cell] = 4e-4 + 8e-6 * random_unit(seed, drawn++);
        target[cell] = 4e-4 + 8e-6 + 1e-6 * random_unit(seed, drawn++);
        ceiling[cell] = target[cell] + 1e-6;
        part[cell] = cell == 0 || random_below(seed, drawn++, 8) > 0;
        weight[cell] = part[cell] ? 1.0 : 0.4 * (double)random_below(seed, drawn++, 3);
        choices[cell] = random_below(seed, drawn++, 10) > 0 ? 3 : 0;
        plan[cell] = choices[cell] ? (int32_t)random_below(seed, drawn++, 1 + problem.kinds) : 0;
    }
    return problem;
}

/* Arguments of sweeps of any plan. */
typedef struct {
    PlanSurface *surface;
    uint8_t *awake;
    const Sums *before;
    Window window;
    ChangeBound bound;
    Tally tally;
} AnySweep;

/* Sweeps of any plan by these moves, each until it helps nowhere in the tile, in rounds until none does. */
static void repeat_sweeps(AnySweep *any, const Tile *tile, int32_t moves) {
    static const int32_t MOVES[] = {MOVE_FLIPS, MOVE_SWAPS};
    const Tally *tally = &any->tally;
    for (int64_t round = -1; tally->flips + tally->swaps > round;) {
        round = tally->flips + tally->swaps;
        for (size_t k = 0; k < 2; k++)
            for (int64_t made = -1; moves & MOVES[k] && tally->flips + tally->swaps > made;) {
                const Sweep sweep = {.move = MOVES[k], .deadline = 1.0};
                made = tally->flips + tally->swaps;
                tile_sweep(any->surface, any->awake, tile, &sweep, any->before, &any->window, &any->bound, &any->tally);
                forget_tries(any->surface, any->awake);
            }
    }
}

static const char *sweeps_differ(const HorizonProblem *problem) {
    static const int32_t MOVES[] = {MOVE_FLIPS, MOVE_SWAPS, MOVE_FLIPS | MOVE_SWAPS};
    static uint8_t awake[2][FRAMED + 8];
    PlanSurface surface[2];
    const Sums *before = &surface[0].sums;
    AnySweep any = {.surface = &surface[0], .awake = awake[0], .before = before};
    FlipBounds flips;
    Tally tally = {.evaluations = 0};
    int64_t work = 0;
    if (!surface_open(&surface[0], problem, plan) || !surface_open(&surface[1], problem, plan) ||
        !window_open(&any.window, &surface[0]) || !bound_open(&any.bound, &surface[0]) ||
        !flip_bounds_open(&flips, &surface[1]))
        return "there is memory";
    wake_all(&surface[0], awake[0]);
    wake_all(&surface[1], awake[1]);
    const char *broken = NULL;
    for (int round = 0; !broken && round < 8; round++) {
        const Sweep sweep = {.move = MOVES[round % 3], .deadline = 1.0};
        for (int tile = 0; tile < 2; tile++) {
            repeat_sweeps(&any, &TILES[tile], sweep.move);
            one_step_sweep(&surface[1], awake[1], &TILES[tile], &sweep, before, &flips, &work, &tally);
        }
        if (memcmp(surface[0].plan, surface[1].plan, FRAMED) != 0 || any.tally.flips != tally.flips ||
            any.tally.swaps != tally.swaps)
            broken = "a sweep in one step makes the changes of sweeps of any plan";
        if (memcmp(surface[0].height, surface[1].height, 2 * FRAMED * sizeof(double)) != 0 ||
            memcmp(surface[0].cost, surface[1].cost, FRAMED * sizeof(double)) != 0)
            broken = "and leaves the same surface";
        if (memcmp(awake[0], awake[1], FRAMED) != 0)
            broken = "and the same cells awake";
    }
    const bool is_plain = problem->kinds == 1 && problem->alpha == 1.0 && !problem->ceiling;
    if (!broken && is_plain && problem->droplet_std == 0.0 && 4 * tally.evaluations > 3 * any.tally.evaluations)
        broken = "bounds leave out a quarter of all moves";
    if (!broken && tally.flips + tally.swaps < CELLS / 10)
        broken = "there is much to change";
    for (size_t cell = 0; cell < FRAMED; cell++)
        bits = mix64(bits + surface[1].plan[cell]);
    flip_bounds_close(&flips);
    bound_close(&any.bound);
    window_close(&any.window);
    surface_close(&surface[1]);
    surface_close(&surface[0]);
    return broken;
}

/* Sweeps over all tiles, and after each of them a look at the cells of those that the next one would pass over. */
static const char *awake_cells_are_missed(const HorizonProblem *problem) {
    static const int32_t MOVES[] = {MOVE_FLIPS, MOVE_SWAPS, MOVE_FLIPS | MOVE_SWAPS};
    PlanSurface surface;
    Tiling tiling;
    if (!surface_open(&surface, problem, plan) || !tiling_open(&tiling, &surface, 1))
        return "there is memory";
    const char *broken = NULL;
    bool out_of_time;
    tiling_wake(&tiling);
    for (int round = 0; round < 16; round++) {
        SearchReport report = {.sweeps = 0};
        const Sweep sweep = {.move = MOVES[round / 2 % 3], .deadline = 1.0};
        tiled_sweep(&tiling, &sweep, &report, &out_of_time);
        for (size_t k = 0; k < CELLS; k++) {
            const uint8_t awake = tiling.awake[surface_cell(&surface, k / NY, k % NY)] & (MOVE_FLIPS | MOVE_SWAPS);
            if (awake & ~tiling.stirred[k / NY / TILE * tiling.columns + k % NY / TILE])
                broken = "no cell is awake in a tile that is passed over";
        }
    }
    tiling_close(&tiling);
    surface_close(&surface);
    return broken;
}

static double flip_cost(const PlanSurface *surface, size_t i, size_t j, Window *window) {
    const Change flip = {0, i, j, !surface_layer(surface, 0)[surface_cell(surface, i, j)]};
    return plan_trial(surface, &flip, 1, window).cost;
}

/* Random flips and swaps, each followed by a look at every bound. */
static const char *bound_fails(const HorizonProblem *problem, uint64_t seed) {
    PlanSurface surface;
    Window window;
    FlipBounds flips;
    if (!surface_open(&surface, problem, plan) || !window_open(&window, &surface) ||
        !flip_bounds_open(&flips, &surface))
        return "there is memory";
    const char *broken = flips.least ? NULL : "there are bounds";
    for (uint64_t draw = 0; !broken && draw < 4 * CHANGES; draw += 4) {
        const size_t i = random_below(seed, draw, NX), j = random_below(seed, draw + 1, 12);
        const size_t cell = surface_cell(&surface, i, j);
        const unsigned value = !surface_layer(&surface, 0)[cell];
        Change change[2] = {{0, i, j, value}, {0, i + 1 < NX ? i + 1 : i - 1, j + draw / 4 % 2, !value}};
        const bool swaps = surface_layer(&surface, 0)[surface_cell(&surface, change[1].i, change[1].j)] == value &&
                           random_below(seed, draw + 2, 2);
        const double cost = plan_trial(&surface, change, swaps ? 2 : 1, &window).cost;
        plan_apply(&surface, change, swaps ? 2 : 1, &window);
        flip_bounds_change(&flips, &surface, i, j, value, swaps ? NAN : -cost);
        if (swaps)
            flip_bounds_change(&flips, &surface, change[1].i, change[1].j, !value, NAN);
        for (size_t k = 0; k < NX * 12; k++) {
            const size_t row = k / 12, column = k % 12, own = surface_cell(&surface, row, column);
            const double least = flips.least[own], found = flip_cost(&surface, row, column, &window);
            if (least > found + (double)flips.sure)
                broken = "no flip costs less than its bound";
            known += !isnan(least);
            in_vain += least > (double)flips.sure;
            const size_t other = own + (row + 1 < NX ? surface.stride : 0) + (k % 2 && column > 0 ? -1 : 1);
            const size_t rows = row + 1 < NX, its_row = row + rows,
                         its_column = k % 2 && column > 0 ? column - 1 : column + 1;
            const uint8_t *values = surface_layer(&surface, 0);
            const Change swap[2] = {{0, row, column, values[other]}, {0, its_row, its_column, values[own]}};
            const double both = least + flips.least[other] - (double)(flips.loss[rows][1] + flips.sure);
            if (values[own] != values[other] && both > plan_trial(&surface, swap, 2, &window).cost)
                broken = "no swap costs less than the bounds of its flips tell";
            if (isnan(least) && random_below(seed, draw + 3, 2))
                flip_bounds_put(&flips, own, found);
        }
    }
    flip_bounds_close(&flips);
    window_close(&window);
    surface_close(&surface);
    return broken;
}

/* Bounds that are read against trials of single flips; they are read where several cells beside each other ask for it.
 */
static const char *reading_fails(const HorizonProblem *problem) {
    static uint8_t awake[FRAMED];
    PlanSurface surface;
    Window window;
    FlipBounds flips;
    if (!surface_open(&surface, problem, plan) || !window_open(&window, &surface) ||
        !flip_bounds_open(&flips, &surface))
        return "there is memory";
    const char *broken = NULL;
    const double rounded = 0.01 * (double)flips.sure;
    memset(awake, MOVES_ALL, sizeof awake);
    flip_bounds_renew(&flips, &surface, &TILES[1], awake, MOVE_FLIPS);
    for (size_t k = 0; k < CELLS; k++) {
        const double least = flips.least[surface_cell(&surface, k / NY, k % NY)];
        const double found = flip_cost(&surface, k / NY, k % NY, &window);
        if (k % NY < TILE ? !isnan(least) : !(fabs(least - fmin(found, (double)flips.most)) < rounded))
            broken = "bounds that were read are the costs of the flips of their tile";
    }
    const size_t own = surface_cell(&surface, 0, TILE);
    for (size_t k = 0; k < NX * TILE; k++)
        flips.least[surface_cell(&surface, k / TILE, k % TILE)] = flips.most;
    flip_bounds_renew(&flips, &surface, &TILES[0], awake, MOVE_SWAPS);
    for (size_t k = 0; k < NX * TILE; k++)
        if (flips.least[surface_cell(&surface, k / TILE, k % TILE)] < flips.most)
            broken = "what is known to be in vain is not read again";
    memset(awake, 0, sizeof awake);
    flip_bounds_clear(&flips, &surface);
    awake[own] = MOVE_FLIPS;
    flip_bounds_renew(&flips, &surface, &TILES[1], awake, MOVE_FLIPS);
    if (!isnan(flips.least[own]))
        broken = "a single cell is left to be tried";
    awake[own + 2] = MOVE_FLIPS;
    flip_bounds_renew(&flips, &surface, &TILES[1], awake, MOVE_FLIPS);
    if (isnan(flips.least[own]) || isnan(flips.least[own + 1]) || !isnan(flips.least[own + surface.stride]))
        broken = "two cells of a row are worth reading";
    flip_bounds_close(&flips);
    window_close(&window);
    surface_close(&surface);
    return broken;
}

int main(void) {
    for (uint64_t seed = 0; seed < PROBLEMS; seed++) {
        HorizonProblem problem = random_problem(seed);
        const char *broken = sweeps_differ(&problem);
        if (!broken)
            broken = awake_cells_are_missed(&problem);
        problem.kinds = 1;
        problem.alpha = 1.0;
        for (size_t cell = 0; cell < CELLS; cell++)
            plan[cell] = plan[cell] > 0;
        if (!broken)
            broken = reading_fails(&problem);
        if (!broken && seed % 2 == seed / 24)
            broken = bound_fails(&problem, seed);
        if (broken) {
            printf("problem %d: does not hold: %s\n", (int)seed, broken);
            return 1;
        }
    }
    if (8 * in_vain < known || known < 100000) {
        printf("of %d flips with bounds only %d are known to be in vain\n", (int)known, (int)in_vain);
        return 1;
    }
    printf("%016llx\n", (unsigned long long)bits);
    return 0;
}
