/* Invariants of plan_change.h and change_bound.h on random problems; prints the first one that does not hold and ends
 * with 1, or else the bits of all that was calculated. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "change_bound.h"
#include "counter_random.h"
#include "plan_change.h"
#include "stopwatch.h"

enum { NX = 9, NY = 11, CELLS = NX * NY, CHANGES = 60, REREAD = 5 }; /* a bound is read again after so many changes */

static const Tile ALL = {0, NX, 0, NY};

static const Ink KINDS[3] = {{4.4e-6, 0.6e-6, 0.2e-6}, {3.9e-6, 0.55e-6, 0.15e-6}, {8.8e-6, 1.2e-6, 0.4e-6}};
static const int32_t ORDER[4] = {2, 0, 3, 1};
static const double ALPHAS[4] = {0.3, 1.0, 0.0, 0.05};

static double height[CELLS], target[CELLS], ceiling[CELLS], weight[CELLS];
static uint8_t part[CELLS];
static uint16_t choices[HORIZON_MAX * CELLS];
static int32_t plan[HORIZON_MAX * CELLS];

double stopwatch_seconds(void) {
    return 0.0;
}

static HorizonProblem random_problem(uint64_t seed) {
    HorizonProblem problem = {.nx = NX,
                              .ny = NY,
                              .layers = 1 + seed % HORIZON_MAX,
                              .height = height,
                              .target = target,
                              .ceiling = seed % 2 ? ceiling : NULL,
                              .part = part,
                              .weight = weight,
                              .choices = choices,
                              .kinds = 1 + (seed / 2) % 3,
                              .alpha = ALPHAS[seed / 4 % 4],
                              .overshoot = 1.0 + (double)(seed % 5),
                              .ceiling_cost = seed % 4 == 1 ? 10.0 : 1e5,
                              .droplet_std = (seed / 6) % 2 ? 0.2 : 0.0,
                              .passes = (seed / 3) % 2 ? 4 : 1};
    memcpy(problem.kind, KINDS, sizeof KINDS);
    uint64_t drawn = 0;
    for (size_t layer = 0; layer < problem.layers; layer++)
        for (size_t pass = 0; pass < 4; pass++)
            problem.colours[layer][pass] = ORDER[(pass + layer) % 4];
    for (size_t cell = 0; cell < CELLS; cell++) {
        height[cell] = 4e-4 + 8e-6 * random_unit(seed, drawn++);
        target[cell] = 4e-4 + 8e-6 * (double)problem.layers;
        ceiling[cell] = target[cell] + 2e-6;
        part[cell] = cell == 0 || random_below(seed, drawn++, 4) > 0;
        weight[cell] = part[cell] ? 1.0 : 0.5 * (double)random_below(seed, drawn++, 2);
    }
    for (size_t k = 0; k < problem.layers * CELLS; k++) {
        choices[k] = 7;
        plan[k] = (int32_t)random_below(seed, drawn++, 1 + problem.kinds);
    }
    return problem;
}

static int64_t vain = 0, found_vain = 0; /* changes that the bound is for and that do not help; those it knows */
static uint64_t bits = 1;                /* of all sums and surfaces so far */

static void add_bits(const void *of, size_t bytes) {
    const uint8_t *byte = of;
    for (size_t k = 0; k < bytes; k++)
        bits = mix64(bits + byte[k]);
}

static bool same_surfaces(const PlanSurface *one, const PlanSurface *other) {
    return memcmp(one->height, other->height, (one->steps + 1) * one->framed * sizeof(double)) == 0 &&
           memcmp(one->cost, other->cost, one->framed * sizeof(double)) == 0 &&
           memcmp(one->left_to_chance, other->left_to_chance, one->framed * sizeof(double)) == 0 &&
           memcmp(one->plan, other->plan, one->problem->layers * one->framed) == 0;
}

/* The surface after all layers by the layer map, which knows two inks: one pass for each kind and colour. */
static double distance_to_layer_map(const PlanSurface *surface) {
    const HorizonProblem *problem = surface->problem;
    double after[CELLS], before[CELLS], one[CELLS];
    memcpy(after, problem->height, sizeof after);
    for (size_t step = 0; step < surface->steps; step++) {
        const size_t passes = (size_t)problem->passes, layer = step / passes;
        memcpy(before, after, sizeof before);
        for (size_t kind = 0; kind < problem->kinds; kind++) {
            int32_t pattern[CELLS];
            for (size_t cell = 0; cell < CELLS; cell++)
                pattern[cell] = plan[layer * CELLS + cell] == (int32_t)kind + 1;
            deposit_pass(before, one, NX, NY, pattern, &problem->kind[kind], NULL,
                         passes == 1 ? COLOUR_ALL : problem->colours[layer][step % passes]);
            for (size_t cell = 0; cell < CELLS; cell++)
                after[cell] += one[cell] - before[cell];
        }
    }
    double furthest = 0.0;
    for (size_t cell = 0; cell < CELLS; cell++)
        furthest =
            fmax(furthest, fabs(after[cell] -
                                surface_height(surface, surface->steps)[surface_cell(surface, cell / NY, cell % NY)]));
    return furthest;
}

static const char *broken_invariant(uint64_t seed) {
    const HorizonProblem problem = random_problem(seed);
    PlanSurface kept, changed, fresh;
    Window window;
    ChangeBound bound;
    if (!surface_open(&kept, &problem, plan) || !surface_open(&changed, &problem, plan) ||
        !window_open(&window, &changed) || !bound_open(&bound, &changed))
        return "there is memory";
    const char *broken = distance_to_layer_map(&kept) < 1e-15 ? NULL : "the surface is that of the layer map";
    for (uint64_t draw = 0; !broken && draw < 6 * CHANGES; draw += 6) {
        const size_t layer = random_below(seed, draw, problem.layers), i = random_below(seed, draw + 1, NX);
        const size_t j = random_below(seed, draw + 2, NY);
        Change change[2] = {{layer, i, j, (unsigned)random_below(seed, draw + 3, 1 + problem.kinds)},
                            {layer, i, j, (unsigned)random_below(seed, draw + 4, 2)}};
        const uint64_t way = draw / 12 % 4; /* to a neighbour: below, beside, or in between */
        if (way < 3 && way != 1)
            change[1].i = i + 1 < NX ? i + 1 : i - 1;
        if (way > 0)
            change[1].j = way == 3 || j + 1 == NY ? (j > 0 ? j - 1 : 1) : j + 1;
        if (problem.layers > 1 && random_below(seed, draw + 5, 2))
            change[1] = (Change){(layer + 1) % problem.layers, i, j, change[1].value};
        const size_t count = 1 + draw / 6 % 2;
        Change undo[2] = {change[0], change[1]};
        for (size_t k = 0; k < count; k++)
            undo[k].value = surface_layer(&changed, undo[k].layer)[surface_cell(&changed, undo[k].i, undo[k].j)];

        const Sums added = plan_trial(&changed, change, count, &window);
        const Sums worth = plan_trial_worth(&changed, change, count, &window);
        add_bits(&added, sizeof added);
        if (worth.cost != added.cost)
            broken = "what a trial is worth is its cost";
        if (!same_surfaces(&kept, &changed))
            broken = "a trial leaves no trace";
        if (draw / 6 % REREAD == 0)
            bound_renew(&bound);
        bound_begin(&bound, &changed, &ALL);
        const double least = change_bound(&bound, &changed, i, j, change, count, &changed.sums);
        const Box box = plan_apply(&changed, change, count, &window);
        surface_plan(&changed, plan);
        if (!surface_open(&fresh, &problem, plan))
            return "there is memory";
        if (!same_surfaces(&fresh, &changed))
            broken = "the surfaces after a change are those of the new plan, bit for bit";
        const double expected = objective(&fresh.sums, &fresh.weighting) - objective(&kept.sums, &kept.weighting);
        const double found = objective_change(&changed.sums, &added, &changed.weighting);
        if (fabs(found - expected) > 1e-12 * objective(&kept.sums, &kept.weighting))
            broken = "a trial gives the change of the objective";
        if (least > found)
            broken = "no change does less to the objective than its bound";
        vain += least > -INFINITY && found > 0.0;
        found_vain += least > 0.0 && found > 0.0;
        add_bits(changed.height, (changed.steps + 1) * changed.framed * sizeof(double));
        add_bits(&fresh.sums, sizeof fresh.sums);
        surface_close(&fresh);
        plan_apply(&changed, undo, count, &window);
        if (!same_surfaces(&kept, &changed))
            broken = "to change and undo gives the same bits";
        plan_apply(&changed, change, count, &window);
        bound_change(&bound, &changed, &box);
        changed.sums = sums_after(&changed.sums, &added);
        plan_apply(&kept, change, count, &window);
        surface_evaluate(&kept);
        if ((draw / 6 + 1) % REREAD == 0)
            surface_evaluate(&changed);
    }
    bound_close(&bound);
    window_close(&window);
    surface_close(&changed);
    surface_close(&kept);
    return broken;
}

int main(void) {
    for (uint64_t seed = 0; seed < 60; seed++) {
        const char *broken = broken_invariant(seed);
        if (broken) {
            printf("problem %d: does not hold: %s\n", (int)seed, broken);
            return 1;
        }
    }
    if (2 * found_vain < vain || vain < 500) {
        printf("of %d changes in vain only %d are known by their bounds\n", (int)vain, (int)found_vain);
        return 1;
    }
    printf("%016llx\n", (unsigned long long)bits);
    return 0;
}
