#include "relaxed_surface.h"

#include <stdlib.h>
#include <string.h>

#include "drop_levels.h"
#include "parallel.h"
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
                                .ends_at = INFINITY,
                                .threads = 1};
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

/* The rows of the cell above a droplet, its own and below that a thread writes to. */
typedef struct {
    bool is_own[3];
} OwnRows;

static inline void jet_droplet(const Footprint *ink, const ptrdiff_t *offset, double amount, const OwnRows *rows,
                               const double *before, double *after) {
    double kept = 0.0;
    for (int k = 0; k < FOOTPRINT; k++) {
        const double taken = ink->spread[k] * saturate(before[0] - before[offset[k]], ink->steepness[k]);
        if (rows->is_own[k / 3])
            after[offset[k]] += amount * taken;
        kept += ink->spread[k] - taken;
    }
    if (rows->is_own[1])
        after[0] += amount * (ink->h1 + kept);
}

/* Adds to `earlier` what `later` passes back through the flow of a droplet; returns the sensitivity to its amount. */
static inline double trace_droplet(const Footprint *ink, const ptrdiff_t *offset, double amount, const OwnRows *rows,
                                   const double *before, const double *later, double *earlier) {
    double gain = ink->h1 * later[0];
    for (int k = 0; k < FOOTPRINT; k++) {
        const double rise = before[0] - before[offset[k]];
        const double share = saturate(rise, ink->steepness[k]);
        const double difference = ink->spread[k] * (later[offset[k]] - later[0]);
        gain += ink->spread[k] * later[0] + share * difference;
        if (rise < 0.0 && share > 0.0) {
            const double passed = amount * ink->steepness[k] * difference;
            if (rows->is_own[1])
                earlier[0] += passed;
            if (rows->is_own[k / 3])
                earlier[offset[k]] -= passed;
        }
    }
    return gain;
}

/* Rows of a step between looks at the stopwatch. */
static size_t band_rows(const HorizonProblem *problem) {
    return 2 + 2 * (BAND_CELLS / 2 / problem->ny); /* even: each colour begins one */
}

/* Rows of a map with a frame, `top` to `bottom` excluded, that one thread writes; what reaches them comes from the rows
 * next to them, too: a droplet there is looked at by both threads. So each cell gets the same sums in the same order.
 */
typedef struct {
    RelaxedSurface *surface;
    size_t number, top, bottom; /* number: of the step */
    const double *droplets, *later;
    double *gradient, *earlier;
    bool is_done;
} Share;

/* Calls `work` for all rows of the maps in shares like this one; false if one of them has run out of time. */
static bool run_shares(void *(*work)(void *share), const Share *like) {
    const RelaxedSurface *surface = like->surface;
    const size_t rows = surface->problem->nx + 2;
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

/* The rows about row i of the grid that the share writes; row i stands at i + 1 with the frame. */
static OwnRows own_rows(const Share *share, size_t i) {
    OwnRows rows;
    for (size_t k = 0; k < 3; k++)
        rows.is_own[k] = i + k >= share->top && i + k < share->bottom;
    return rows;
}

/* The first and behind the last row of the grid that a share looks at, of those that a step jets on. */
static size_t first_row(const Share *share, const Step *step) {
    const size_t first = share->top > 2 ? share->top - 2 : 0;
    return first + (first + step->first_i) % step->stride;
}

static size_t end_row(const Share *share) {
    const size_t nx = share->surface->problem->nx;
    return share->bottom < nx ? share->bottom : nx;
}

static void copy_rows(const Share *share, const double *from, double *to) {
    const size_t stride = share->surface->problem->ny + 2, first = share->top * stride;
    memcpy(to + first, from + first, (share->bottom - share->top) * stride * sizeof(double));
}

static inline void jet_row(const Share *share, const Step *step, size_t i, const OwnRows *rows, const double *before,
                           double *after) {
    const RelaxedSurface *surface = share->surface;
    for (size_t j = step->first_j; j < surface->problem->ny; j += step->stride) {
        const size_t place = (step->layer * surface->problem->nx + i) * surface->problem->ny + j;
        if (surface->first[place] == NO_KIND || share->droplets[place] == 0.0)
            continue;
        const size_t cell = framed_cell(surface->problem, i, j);
        jet_droplet(&surface->kind[surface->first[place]], surface->offset, share->droplets[place], rows, before + cell,
                    after + cell);
    }
}

static const OwnRows ALL_ROWS = {{true, true, true}};

static bool is_inner(const OwnRows *rows) {
    return rows->is_own[0] && rows->is_own[1] && rows->is_own[2];
}

static void *jet_share(void *handed) {
    Share *share = handed;
    const HorizonProblem *problem = share->surface->problem;
    const Step step = step_of(problem, share->number);
    const double *before = share->surface->height + share->number * share->surface->framed;
    double *after = share->surface->height + (share->number + 1) * share->surface->framed;
    const size_t band = band_rows(problem);
    copy_rows(share, before, after);
    for (size_t i = first_row(share, &step); i < end_row(share); i += step.stride) {
        const OwnRows rows = own_rows(share, i);
        if (i % band == step.first_i && is_past(share->surface->ends_at))
            return NULL;
        if (is_inner(&rows))
            jet_row(share, &step, i, &ALL_ROWS, before, after);
        else
            jet_row(share, &step, i, &rows, before, after);
    }
    share->is_done = true;
    return NULL;
}

static bool jet_all(RelaxedSurface *surface, const double *droplets) {
    for (size_t number = 0; number < surface->steps; number++)
        if (!run_shares(jet_share, &(Share){.surface = surface, .number = number, .droplets = droplets}))
            return false;
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

static inline void trace_row(const Share *share, const Step *step, size_t i, const OwnRows *rows,
                             const double *before) {
    const RelaxedSurface *surface = share->surface;
    for (size_t j = step->first_j; j < surface->problem->ny; j += step->stride) {
        const size_t place = (step->layer * surface->problem->nx + i) * surface->problem->ny + j;
        double gain = 0.0;
        if (surface->first[place] != NO_KIND) {
            const size_t cell = framed_cell(surface->problem, i, j);
            gain = trace_droplet(&surface->kind[surface->first[place]], surface->offset, share->droplets[place], rows,
                                 before + cell, share->later + cell, share->earlier + cell);
        }
        if (rows->is_own[1])
            share->gradient[place] = gain;
    }
}

static void *trace_share(void *handed) {
    Share *share = handed;
    const HorizonProblem *problem = share->surface->problem;
    const Step step = step_of(problem, share->number);
    const double *before = share->surface->height + share->number * share->surface->framed;
    const size_t band = band_rows(problem);
    copy_rows(share, share->later, share->earlier);
    for (size_t i = first_row(share, &step); i < end_row(share); i += step.stride) {
        const OwnRows rows = own_rows(share, i);
        if (i % band == step.first_i && is_past(share->surface->ends_at))
            return NULL;
        if (is_inner(&rows))
            trace_row(share, &step, i, &ALL_ROWS, before);
        else
            trace_row(share, &step, i, &rows, before);
    }
    share->is_done = true;
    return NULL;
}

bool relaxed_gradient(RelaxedSurface *surface, const double *droplets, double smoothing, double *gradient) {
    Share share = {.surface = surface, .droplets = droplets, .gradient = gradient};
    double *later = surface->sensitivity, *earlier = surface->sensitivity + surface->framed;
    if (!seed_sensitivity(surface, smoothing, later))
        return false;
    for (size_t number = surface->steps; number-- > 0;) {
        share.number = number;
        share.later = later;
        share.earlier = earlier;
        if (!run_shares(trace_share, &share))
            return false;
        double *next = later;
        later = earlier;
        earlier = next;
    }
    return true;
}
