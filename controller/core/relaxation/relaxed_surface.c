#include "relaxed_surface.h"

#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "parallel.h"
#include "pass_colour.h"
#include "stopwatch.h"

static size_t framed_cell(const HorizonProblem *problem, size_t i, size_t j) {
    return (i + 1) * (problem->ny + 2) + j + 1;
}

static Footprint footprint_of(const Ink *ink) {
    return (Footprint){ink->h1, {ink->h2, ink->h3}, {1.0 / (ink->h1 + ink->h2), 1.0 / (ink->h1 + ink->h3)}};
}

static void set_frame(const HorizonProblem *problem, double value, double *map) {
    const size_t nx = problem->nx, ny = problem->ny;
    for (size_t j = 0; j < ny + 2; j++)
        map[j] = map[(nx + 1) * (ny + 2) + j] = value;
    for (size_t i = 0; i < nx; i++)
        map[framed_cell(problem, i, 0) - 1] = map[framed_cell(problem, i, ny)] = value;
}

bool relaxed_open(RelaxedSurface *surface, const HorizonProblem *problem) {
    const size_t cells = problem->nx * problem->ny;
    *surface = (RelaxedSurface){.problem = problem,
                                .steps = problem->layers * (size_t)problem->passes,
                                .framed = (problem->nx + 2) * (problem->ny + 2),
                                .ends_at = INFINITY,
                                .threads = 1};
    const size_t maps = surface->steps + 3;
    surface->memory = malloc(maps * surface->framed * sizeof(double) + problem->layers * cells);
    if (!surface->memory)
        return false;
    surface->height = surface->memory;
    surface->sensitivity = surface->height + (surface->steps + 1) * surface->framed;
    surface->first = (uint8_t *)(surface->sensitivity + 2 * surface->framed);
    for (size_t kind = 0; kind < problem->kinds; kind++)
        surface->kind[kind] = footprint_of(&problem->kind[kind]);
    for (size_t place = 0; place < problem->layers * cells; place++)
        surface->first[place] = first_kind(problem, problem->choices[place]);
    for (size_t cell = 0; cell < cells; cell++)
        surface->count += problem->part[cell] != 0;
    for (size_t number = 0; number <= surface->steps; number++)
        set_frame(problem, -INFINITY, surface->height + number * surface->framed);
    for (size_t k = 0; k < 2; k++)
        set_frame(problem, 0.0, surface->sensitivity + k * surface->framed);
    for (size_t i = 0; i < problem->nx; i++)
        memcpy(surface->height + framed_cell(problem, i, 0), problem->height + i * problem->ny,
               problem->ny * sizeof(double));
    return true;
}

void relaxed_close(RelaxedSurface *surface) {
    free(surface->memory);
}

static RelaxedStep step_at(const RelaxedSurface *surface, const double *droplets, size_t number) {
    const HorizonProblem *problem = surface->problem;
    const size_t passes = (size_t)problem->passes, layer = number / passes, place = layer * problem->nx * problem->ny;
    return (RelaxedStep){problem,
                         surface->kind,
                         surface->first + place,
                         droplets + place,
                         passes == 1 ? COLOUR_ALL : problem->colours[layer][number % passes],
                         surface->ends_at,
                         surface->height + number * surface->framed};
}

/* Rows of the grid of one thread, `top` to `bottom` excluded. */
typedef struct {
    const RelaxedStep *step;
    size_t top, bottom;
    double *after;
    const double *later;
    double *earlier, *gradient;
    bool is_done;
} Share;

/* Calls `work` for all rows in shares of this kind; false if one of them has run out of time. */
static bool run_shares(const RelaxedSurface *surface, void *(*work)(void *share), const Share *like) {
    const size_t rows = surface->problem->nx;
    size_t threads = useful_threads(surface->threads, surface->framed);
    Share shares[MAX_PARALLEL];
    bool is_done = true;
    threads = threads < rows ? threads : rows;
    for (size_t k = 0; k < threads; k++) {
        shares[k] = *like;
        shares[k].top = rows * k / threads;
        shares[k].bottom = rows * (k + 1) / threads;
    }
    run_parallel(work, shares, sizeof *shares, threads);
    for (size_t k = 0; k < threads; k++)
        is_done = is_done && shares[k].is_done;
    return is_done;
}

static void *jet_share(void *handed) {
    Share *share = handed;
    share->is_done = jet_rows(share->step, share->top, share->bottom, share->after);
    return NULL;
}

static void *trace_share(void *handed) {
    Share *share = handed;
    share->is_done = trace_rows(share->step, share->top, share->bottom, share->later, share->earlier, share->gradient);
    return NULL;
}

static bool jet_all(RelaxedSurface *surface, const double *droplets) {
    for (size_t number = 0; number < surface->steps; number++) {
        const RelaxedStep step = step_at(surface, droplets, number);
        double *after = surface->height + (number + 1) * surface->framed;
        if (!run_shares(surface, jet_share, &(Share){.step = &step, .after = after}))
            return false;
    }
    return true;
}

/* Rows of a map between two looks at the stopwatch. */
static size_t band_rows(const HorizonProblem *problem) {
    return 1 + BAND_CELLS / problem->ny;
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
    const size_t cells = surface->problem->nx * surface->problem->ny, passes = (size_t)surface->problem->passes;
    double *later = surface->sensitivity, *earlier = surface->sensitivity + surface->framed;
    if (!seed_sensitivity(surface, smoothing, later))
        return false;
    for (size_t number = surface->steps; number-- > 0;) {
        const RelaxedStep step = step_at(surface, droplets, number);
        const Share share = {
            .step = &step, .later = later, .earlier = earlier, .gradient = gradient + number / passes * cells};
        if (!run_shares(surface, trace_share, &share))
            return false;
        double *next = later;
        later = earlier;
        earlier = next;
    }
    return true;
}
