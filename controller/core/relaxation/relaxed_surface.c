#include "relaxed_surface.h"

#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "stopwatch.h"

/* Cells that a step jets on: those of one `cell_colour` in four passes, all in one. */
typedef struct {
    size_t layer, first_i, first_j, stride;
} Step;

static Step step_of(const HorizonProblem *problem, size_t step) {
    if (problem->passes == 1)
        return (Step){step, 0, 0, 1};
    const int32_t colour = problem->colours[step / 4][step % 4];
    return (Step){step / 4, (size_t)colour / 2, (size_t)colour % 2, 2};
}

static size_t framed_cell(const HorizonProblem *problem, size_t i, size_t j) {
    return (i + 1) * (problem->ny + 2) + j + 1;
}

static Footprint footprint_of(const Ink *ink) {
    Footprint footprint = {.h1 = ink->h1};
    for (int k = 0; k < FOOTPRINT; k++) {
        if (k == CENTRE)
            continue;
        footprint.spread[k] = k % 2 ? ink->h2 : ink->h3;
        footprint.steepness[k] = 1.0 / (ink->h1 + footprint.spread[k]);
    }
    return footprint;
}

bool relaxed_open(RelaxedSurface *surface, const HorizonProblem *problem) {
    const size_t cells = problem->nx * problem->ny;
    *surface = (RelaxedSurface){.problem = problem,
                                .steps = problem->layers * (size_t)problem->passes,
                                .framed = (problem->nx + 2) * (problem->ny + 2),
                                .ends_at = INFINITY};
    const size_t maps = surface->steps + 3;
    surface->memory = malloc(maps * surface->framed * sizeof(double) + problem->layers * cells);
    if (!surface->memory)
        return false;
    surface->height = surface->memory;
    surface->sensitivity = surface->height + (surface->steps + 1) * surface->framed;
    surface->first = (uint8_t *)(surface->sensitivity + 2 * surface->framed);
    for (int k = 0; k < FOOTPRINT; k++)
        surface->offset[k] = (ptrdiff_t)(k / 3 - 1) * (ptrdiff_t)(problem->ny + 2) + k % 3 - 1;
    for (size_t kind = 0; kind < problem->kinds; kind++)
        surface->kind[kind] = footprint_of(&problem->kind[kind]);
    for (size_t place = 0; place < problem->layers * cells; place++)
        surface->first[place] = first_kind(problem, problem->choices[place]);
    for (size_t cell = 0; cell < cells; cell++)
        surface->count += problem->part[cell] != 0;
    /* A frame that lies infinitely low takes every share in full, and no share ever lifts it: an open edge. */
    for (size_t cell = 0; cell < surface->framed; cell++)
        surface->height[cell] = -INFINITY;
    for (size_t i = 0; i < problem->nx; i++)
        memcpy(surface->height + framed_cell(problem, i, 0), problem->height + i * problem->ny,
               problem->ny * sizeof(double));
    return true;
}

void relaxed_close(RelaxedSurface *surface) {
    free(surface->memory);
}

static double saturate(double rise, double steepness) {
    const double share = 1.0 + (rise < 0.0 ? rise : 0.0) * steepness;
    return share > 0.0 ? share : 0.0;
}

static void jet_droplet(const Footprint *ink, const ptrdiff_t *offset, double amount, const double *before,
                        double *after) {
    double kept = 0.0;
    for (int k = 0; k < FOOTPRINT; k++) {
        const double taken = ink->spread[k] * saturate(before[0] - before[offset[k]], ink->steepness[k]);
        after[offset[k]] += amount * taken;
        kept += ink->spread[k] - taken;
    }
    after[0] += amount * (ink->h1 + kept);
}

/* Adds to `earlier` what `later` passes back through the flow of a droplet; returns the sensitivity to its amount. */
static double trace_droplet(const Footprint *ink, const ptrdiff_t *offset, double amount, const double *before,
                            const double *later, double *earlier) {
    double gain = ink->h1 * later[0];
    for (int k = 0; k < FOOTPRINT; k++) {
        const double rise = before[0] - before[offset[k]];
        const double share = saturate(rise, ink->steepness[k]);
        const double difference = ink->spread[k] * (later[offset[k]] - later[0]);
        gain += ink->spread[k] * later[0] + share * difference;
        if (rise < 0.0 && share > 0.0) {
            const double passed = amount * ink->steepness[k] * difference;
            earlier[0] += passed;
            earlier[offset[k]] -= passed;
        }
    }
    return gain;
}

/* Rows of a step between looks at the stopwatch. */
static size_t band_rows(const HorizonProblem *problem) {
    return 2 + 2 * (BAND_CELLS / 2 / problem->ny); /* even: each colour begins one */
}

static bool jet_all(RelaxedSurface *surface, const double *droplets) {
    const HorizonProblem *problem = surface->problem;
    const size_t band = band_rows(problem);
    for (size_t number = 0; number < surface->steps; number++) {
        const Step step = step_of(problem, number);
        const double *before = surface->height + number * surface->framed;
        double *after = surface->height + (number + 1) * surface->framed;
        memcpy(after, before, surface->framed * sizeof(double));
        for (size_t i = step.first_i; i < problem->nx; i += step.stride) {
            if (i % band == step.first_i && is_past(surface->ends_at))
                return false;
            for (size_t j = step.first_j; j < problem->ny; j += step.stride) {
                const size_t place = (step.layer * problem->nx + i) * problem->ny + j;
                if (surface->first[place] == NO_KIND || droplets[place] == 0.0)
                    continue;
                const size_t cell = framed_cell(problem, i, j);
                jet_droplet(&surface->kind[surface->first[place]], surface->offset, droplets[place], before + cell,
                            after + cell);
            }
        }
    }
    return true;
}

static double positive_part(double x, double smoothing) {
    return 0.5 * (x + sqrt(x * x + smoothing * smoothing));
}

static double positive_part_slope(double x, double smoothing) {
    const double root = sqrt(x * x + smoothing * smoothing);
    return root > 0.0 ? 0.5 * (1.0 + x / root) : 0.5;
}

/* Mean and smoothed standard deviation of a surface over the part [m]. */
static void spread_of(const RelaxedSurface *surface, const double *height, double smoothing, double *mean,
                      double *deviation) {
    const HorizonProblem *problem = surface->problem;
    double sum = 0.0, squares = 0.0;
    for (size_t i = 0; i < problem->nx; i++)
        for (size_t j = 0; j < problem->ny; j++)
            if (problem->part[i * problem->ny + j])
                sum += height[framed_cell(problem, i, j)];
    *mean = sum / surface->count;
    for (size_t i = 0; i < problem->nx; i++) {
        for (size_t j = 0; j < problem->ny; j++) {
            const double excess = height[framed_cell(problem, i, j)] - *mean;
            if (problem->part[i * problem->ny + j])
                squares += excess * excess;
        }
    }
    *deviation = sqrt(squares / surface->count + smoothing * smoothing);
}

bool relaxed_value(RelaxedSurface *surface, const double *droplets, double smoothing, double *value) {
    const HorizonProblem *problem = surface->problem;
    const double *height = surface->height + surface->steps * surface->framed;
    double mean, deviation, error = 0.0;
    if (!jet_all(surface, droplets))
        return false;
    spread_of(surface, height, smoothing, &mean, &deviation);
    for (size_t i = 0; i < problem->nx; i++) {
        if (i % band_rows(problem) == 0 && is_past(surface->ends_at))
            return false;
        for (size_t j = 0; j < problem->ny; j++) {
            const size_t cell = i * problem->ny + j;
            const double reached = height[framed_cell(problem, i, j)];
            const double above = reached - problem->target[cell];
            double cost = positive_part(-above, smoothing) + problem->overshoot * positive_part(above, smoothing);
            if (problem->ceiling)
                cost += problem->ceiling_cost * positive_part(reached - problem->ceiling[cell], smoothing);
            error += cell_weight(problem, cell) * cost;
        }
    }
    *value = problem->alpha * error / surface->count + (1.0 - problem->alpha) * deviation;
    return true;
}

/* Sensitivity of the objective to the last surface. False if the time ends first. */
static bool seed_sensitivity(const RelaxedSurface *surface, double smoothing, double *sensitivity) {
    const HorizonProblem *problem = surface->problem;
    const double *height = surface->height + surface->steps * surface->framed;
    double mean, deviation;
    spread_of(surface, height, smoothing, &mean, &deviation);
    memset(sensitivity, 0, surface->framed * sizeof(double));
    for (size_t i = 0; i < problem->nx; i++) {
        if (i % band_rows(problem) == 0 && is_past(surface->ends_at))
            return false;
        for (size_t j = 0; j < problem->ny; j++) {
            const size_t cell = i * problem->ny + j, framed = framed_cell(problem, i, j);
            const double above = height[framed] - problem->target[cell];
            double slope =
                problem->overshoot * positive_part_slope(above, smoothing) - positive_part_slope(-above, smoothing);
            if (problem->ceiling)
                slope +=
                    problem->ceiling_cost * positive_part_slope(height[framed] - problem->ceiling[cell], smoothing);
            sensitivity[framed] = problem->alpha * cell_weight(problem, cell) * slope / surface->count;
            if (problem->part[cell] && deviation > 0.0)
                sensitivity[framed] += (1.0 - problem->alpha) * (height[framed] - mean) / (surface->count * deviation);
        }
    }
    return true;
}

bool relaxed_gradient(RelaxedSurface *surface, const double *droplets, double smoothing, double *gradient) {
    const HorizonProblem *problem = surface->problem;
    const size_t band = band_rows(problem);
    double *later = surface->sensitivity, *earlier = surface->sensitivity + surface->framed;
    if (!seed_sensitivity(surface, smoothing, later))
        return false;
    for (size_t number = surface->steps; number-- > 0;) {
        const Step step = step_of(problem, number);
        const double *before = surface->height + number * surface->framed;
        memcpy(earlier, later, surface->framed * sizeof(double));
        for (size_t i = step.first_i; i < problem->nx; i += step.stride) {
            if (i % band == step.first_i && is_past(surface->ends_at))
                return false;
            for (size_t j = step.first_j; j < problem->ny; j += step.stride) {
                const size_t place = (step.layer * problem->nx + i) * problem->ny + j;
                gradient[place] = 0.0;
                if (surface->first[place] == NO_KIND)
                    continue;
                const size_t cell = framed_cell(problem, i, j);
                gradient[place] = trace_droplet(&surface->kind[surface->first[place]], surface->offset, droplets[place],
                                                before + cell, later + cell, earlier + cell);
            }
        }
        double *next = later;
        later = earlier;
        earlier = next;
    }
    return true;
}
