#include "plan_surface.h"

#include <stdlib.h>
#include <string.h>

/* Gains below this share of a droplet's height are rounding, and chasing them would never end (assumed). */
static const double LEAST_SHARE_OF_DROPLET = 1e-9;

/* Bound of a uniform distribution whose standard deviation is 1: the square root of 3. */
static const double UNIFORM_BOUND = 1.7320508075688772;

/* Height of the frame [m]: below every cell by more than any droplet spreads. */
static const double ABYSS = -1.0;

static bool take_memory(PlanSurface *surface) {
    const size_t reals = (surface->steps + 2 + (surface->problem->ceiling != NULL)) * surface->framed;
    const size_t bytes = surface->problem->layers * surface->framed;
    surface->memory = calloc(1, surface->framed * sizeof(Goal) + reals * sizeof(double) + bytes);
    if (!surface->memory)
        return false;
    surface->goal = surface->memory;
    surface->height = (double *)(surface->goal + surface->framed);
    surface->kept = surface->height + (surface->steps + 1) * surface->framed;
    double *next = surface->kept + surface->framed;
    if (surface->problem->ceiling) {
        surface->ceiling = next;
        next += surface->framed;
    }
    surface->plan = (uint8_t *)next;
    return true;
}

/* Copies the problem's data of each cell into the maps. Returns the number of cells of the part. */
static double copy_maps(PlanSurface *surface) {
    const HorizonProblem *problem = surface->problem;
    double count = 0.0;
    for (size_t k = 0; k < (surface->steps + 1) * surface->framed; k++)
        surface->height[k] = ABYSS;
    for (size_t i = 0; i < surface->nx; i++) {
        for (size_t j = 0; j < surface->ny; j++) {
            const size_t given = i * surface->ny + j, cell = surface_cell(surface, i, j);
            surface->height[cell] = height_on_lattice(problem->height[given]);
            surface->goal[cell] = (Goal){problem->target[given], problem->weight[given], problem->part[given] ? 1 : 0};
            if (surface->ceiling)
                surface->ceiling[cell] = problem->ceiling[given];
            count += surface->goal[cell].inside;
        }
    }
    return count;
}

bool surface_open(PlanSurface *surface, const HorizonProblem *problem, const int32_t *plan) {
    const size_t stride = problem->ny + 2;
    *surface = (PlanSurface){.problem = problem,
                             .nx = problem->nx,
                             .ny = problem->ny,
                             .stride = stride,
                             .framed = (problem->nx + 2) * stride,
                             .steps = problem->layers * (size_t)problem->passes,
                             .upward = 0.5 * (problem->overshoot + 1.0),
                             .skew = 0.5 * (problem->overshoot - 1.0)};
    if (!take_memory(surface))
        return false;
    double tallest = 0.0, smallest = problem->kind[0].h1;
    for (size_t k = 0; k < problem->kinds; k++) {
        surface->droplet[1 + k] = droplet_of(&problem->kind[k]);
        tallest = fmax(tallest, problem->kind[k].h1);
        smallest = fmin(smallest, problem->kind[k].h1);
    }
    surface->chance = UNIFORM_BOUND * problem->droplet_std;
    surface->least_chance = surface->chance * smallest;
    surface->weighting = (Weighting){problem->alpha, copy_maps(surface)};
    surface->droplet_worth = tallest / surface->weighting.count;
    surface->least_gain = LEAST_SHARE_OF_DROPLET * surface->droplet_worth;
    surface_set_plan(surface, plan);
    surface_evaluate(surface);
    return true;
}

void surface_close(PlanSurface *surface) {
    free(surface->memory);
    surface->memory = NULL;
}

void surface_set_plan(PlanSurface *surface, const int32_t *plan) {
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = 0; i < surface->nx; i++)
            for (size_t j = 0; j < surface->ny; j++)
                surface_layer(surface, layer)[surface_cell(surface, i, j)] = (uint8_t)*plan++;
}

void surface_plan(const PlanSurface *surface, int32_t *plan) {
    for (size_t layer = 0; layer < surface->problem->layers; layer++)
        for (size_t i = 0; i < surface->nx; i++)
            for (size_t j = 0; j < surface->ny; j++)
                *plan++ = surface_layer(surface, layer)[surface_cell(surface, i, j)];
}

double surface_add_droplet(const PlanSurface *surface, const double *before, size_t cell, unsigned value, double sign,
                           double *after, size_t there, size_t stride) {
    const Droplet *droplet = &surface->droplet[value];
    const double here = before[cell];
    double kept = droplet->volume;
    for (int di = -1; di <= 1; di++) {
        const double *row = before + cell + di * (ptrdiff_t)surface->stride;
        double *row_after = after + there + di * (ptrdiff_t)stride;
        for (int dj = -1; dj <= 1; dj++) {
            if (di == 0 && dj == 0)
                continue;
            const int place = di == 0 || dj == 0 ? SIDE : CORNER;
            const double taken = flow(droplet->spread[place], droplet->slope[place], here - row[dj]);
            row_after[dj] += sign * taken;
            kept -= taken;
        }
    }
    after[there] += sign * kept;
    return kept;
}

static void print_step(PlanSurface *surface, size_t step) {
    const size_t layer = step / (size_t)surface->problem->passes;
    const double *before = surface_height(surface, step);
    double *after = surface_height(surface, step + 1);
    memcpy(after, before, surface->framed * sizeof(double));
    memset(surface->kept, 0, surface->framed * sizeof(double));
    const uint8_t *values = surface_layer(surface, layer);
    for (size_t i = 0; i < surface->nx; i++) {
        for (size_t j = 0; j < surface->ny; j++) {
            const size_t cell = surface_cell(surface, i, j);
            if (values[cell] && surface_step(surface, layer, i, j) == step)
                surface->kept[cell] =
                    surface_add_droplet(surface, before, cell, values[cell], 1.0, after, cell, surface->stride);
        }
    }
    for (size_t i = 0; i < surface->nx + 2; i++)
        after[i * surface->stride] = after[i * surface->stride + surface->ny + 1] = ABYSS;
    for (size_t j = 0; j < surface->stride; j++)
        after[j] = after[surface->framed - 1 - j] = ABYSS;
}

/* The reference of the heights is the mean that they have after the last step. */
void surface_evaluate(PlanSurface *surface) {
    for (size_t step = 0; step < surface->steps; step++)
        print_step(surface, step);
    const double *last = surface_height(surface, surface->steps);
    double mean = 0.0;
    for (size_t cell = 0; cell < surface->framed; cell++)
        mean += surface->goal[cell].inside * last[cell];
    surface->reference = height_on_lattice(mean / surface->weighting.count);
    surface->sums = (Sums){0.0, 0.0, 0.0};
    for (size_t cell = 0; cell < surface->framed; cell++) {
        const double inside = surface->goal[cell].inside, height = inside * (last[cell] - surface->reference);
        const double chance = surface_chance(surface, surface->kept[cell]);
        const Sums own = {surface_cost(surface, cell, last[cell], chance), height,
                          height * height + inside * chance * chance / 3.0};
        surface->sums = sums_after(&surface->sums, &own);
    }
}

Objective surface_objective(const PlanSurface *surface) {
    const double *last = surface_height(surface, surface->steps);
    double over_ceiling = 0.0;
    for (size_t cell = 0; surface->ceiling && cell < surface->framed; cell++)
        over_ceiling += surface->goal[cell].weight * fmax(last[cell] - surface->ceiling[cell], 0.0);
    over_ceiling *= surface->problem->ceiling_cost;
    const double count = surface->weighting.count;
    return (Objective){objective(&surface->sums, &surface->weighting), (surface->sums.cost - over_ceiling) / count,
                       over_ceiling / count, deviation(&surface->sums, &surface->weighting)};
}
