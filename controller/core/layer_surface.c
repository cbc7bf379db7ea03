#include "layer_surface.h"

#include <math.h>
#include <stdlib.h>

/* Gains below this share of a droplet's height are rounding, and chasing them would never end (assumed). */
static const double LEAST_SHARE_OF_DROPLET = 1e-9;

static size_t framed(const LayerSurface *surface, size_t cell) {
    return (cell / surface->ny + 1) * (surface->ny + 2) + cell % surface->ny + 1;
}

static bool take_memory(LayerSurface *surface) {
    const size_t cells = surface->nx * surface->ny;
    const size_t framed_cells = (surface->nx + 2) * (surface->ny + 2);
    const size_t reals = cells * FOOTPRINT + 2 * framed_cells;
    double *memory = calloc(1, reals * sizeof(double) + cells);
    if (!memory)
        return false;
    surface->memory = memory;
    surface->share = memory;
    surface->error = surface->share + cells * FOOTPRINT;
    surface->height = surface->error + framed_cells;
    surface->occupied = (uint8_t *)(surface->height + framed_cells);
    return true;
}

/* Shares that fall beside the part count nowhere: without them no trial need ask what a cell is. */
static void compute_shares(LayerSurface *surface, const LayerProblem *problem) {
    for (size_t i = 0; i < surface->nx; i++) {
        for (size_t j = 0; j < surface->ny; j++) {
            const size_t cell = i * surface->ny + j;
            if (!problem->allowed[cell])
                continue;
            double *share = surface->share + cell * FOOTPRINT;
            const Ink *ink = &problem->ink[problem->material[cell]];
            droplet_shares(problem->height, surface->nx, surface->ny, i, j, ink, share);
            for (size_t k = 0; k < FOOTPRINT; k++) {
                const size_t row = i + k / 3, column = j + k % 3; /* one more than the neighbour's own: no wrap at 0 */
                const bool inside = row >= 1 && row <= surface->nx && column >= 1 && column <= surface->ny;
                if (!inside || !problem->part[(row - 1) * surface->ny + column - 1])
                    share[k] = 0.0;
            }
        }
    }
}

static void add_droplet(LayerSurface *surface, size_t cell, double sign) {
    const double *share = surface->share + cell * FOOTPRINT;
    const size_t here = framed(surface, cell);
    for (size_t k = 0; k < FOOTPRINT; k++) {
        const size_t there = here + (size_t)surface->offset[k];
        surface->error[there] += sign * share[k];
        surface->height[there] += sign * share[k];
    }
}

/* The reference of the heights is the mean that they have after the droplets. */
void surface_evaluate(LayerSurface *surface, const LayerProblem *problem) {
    const size_t cells = surface->nx * surface->ny;
    for (size_t cell = 0; cell < cells; cell++) {
        if (!problem->part[cell])
            continue;
        surface->height[framed(surface, cell)] = problem->height[cell];
        surface->error[framed(surface, cell)] = problem->height[cell] - problem->target[cell];
    }
    for (size_t cell = 0; cell < cells; cell++)
        if (surface->occupied[cell])
            add_droplet(surface, cell, 1.0);
    double reference = 0.0;
    for (size_t cell = 0; cell < cells; cell++)
        if (problem->part[cell])
            reference += surface->height[framed(surface, cell)];
    reference /= surface->weighting.count;
    surface->sums = (Sums){0.0, 0.0, 0.0};
    for (size_t cell = 0; cell < cells; cell++) {
        if (!problem->part[cell])
            continue;
        double *height = surface->height + framed(surface, cell);
        *height -= reference;
        const Sums own = {fabs(surface->error[framed(surface, cell)]), *height, *height * *height};
        surface->sums = sums_after(&surface->sums, &own);
    }
}

bool surface_open(LayerSurface *surface, const LayerProblem *problem, const int32_t *pattern) {
    *surface = (LayerSurface){.nx = problem->nx, .ny = problem->ny, .allowed = problem->allowed};
    if (!take_memory(surface))
        return false;
    const size_t cells = problem->nx * problem->ny;
    double count = 0.0;
    for (size_t cell = 0; cell < cells; cell++)
        count += problem->part[cell] != 0;
    surface->weighting = (Weighting){problem->alpha, count};
    surface->droplet_worth = problem->ink[0].h1 / count;
    surface->least_gain = LEAST_SHARE_OF_DROPLET * surface->droplet_worth;
    const ptrdiff_t stride = (ptrdiff_t)problem->ny + 2;
    for (int k = 0; k < FOOTPRINT; k++)
        surface->offset[k] = (k / 3 - 1) * stride + k % 3 - 1;
    for (size_t cell = 0; cell < cells; cell++)
        surface->occupied[cell] = problem->allowed[cell] && pattern[cell] != 0;
    compute_shares(surface, problem);
    surface_evaluate(surface, problem);
    return true;
}

void surface_close(LayerSurface *surface) {
    free(surface->memory);
    surface->memory = NULL;
}

Sums surface_flip_change(const LayerSurface *surface, size_t cell) {
    const double *share = surface->share + cell * FOOTPRINT;
    const size_t here = framed(surface, cell);
    const double sign = surface->occupied[cell] ? -1.0 : 1.0;
    Sums change = {0.0, 0.0, 0.0};
    for (size_t k = 0; k < FOOTPRINT; k++) {
        const size_t there = here + (size_t)surface->offset[k];
        const double added = sign * share[k];
        change.absolute_error += fabs(surface->error[there] + added) - fabs(surface->error[there]);
        change.height += added;
        change.squared_height += added * (2.0 * surface->height[there] + added);
    }
    return change;
}

void surface_flip(LayerSurface *surface, size_t cell, const Sums *change) {
    add_droplet(surface, cell, surface->occupied[cell] ? -1.0 : 1.0);
    surface->occupied[cell] = !surface->occupied[cell];
    surface->sums = sums_after(&surface->sums, change);
}

void surface_pattern(const LayerSurface *surface, const LayerProblem *problem, int32_t *pattern) {
    for (size_t cell = 0; cell < surface->nx * surface->ny; cell++)
        pattern[cell] = surface->occupied[cell] ? 1 + problem->material[cell] : 0;
}
