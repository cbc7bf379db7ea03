#include "flip_search.h"

/* Flips every cell where that lowers the objective; returns how many. */
static int64_t sweep_flips(LayerSurface *surface, SearchReport *report) {
    int64_t flips = 0;
    for (size_t cell = 0; cell < surface->nx * surface->ny; cell++) {
        if (!surface->allowed[cell])
            continue;
        const Sums change = surface_flip_change(surface, cell);
        report->evaluations++;
        if (objective_change(&surface->sums, &change, &surface->weighting) < -surface->least_gain) {
            surface_flip(surface, cell, &change);
            flips++;
        }
    }
    return flips;
}

/* The free neighbour where the droplet just taken from `cell` would lower the objective most, or `cell` itself if
 * that is by less than what taking it cost. */
static size_t best_place(const LayerSurface *surface, size_t cell, double taking_cost, SearchReport *report) {
    const size_t i = cell / surface->ny, j = cell % surface->ny;
    double best = -surface->least_gain - taking_cost;
    size_t place = cell;
    for (size_t k = 0; k < FOOTPRINT; k++) {
        const size_t row = i + k / 3, column = j + k % 3; /* one more than the neighbour's own: no wrap at 0 */
        if (row < 1 || row > surface->nx || column < 1 || column > surface->ny)
            continue;
        const size_t neighbour = (row - 1) * surface->ny + column - 1;
        if (neighbour == cell || !surface->allowed[neighbour] || surface->occupied[neighbour])
            continue;
        const Sums change = surface_flip_change(surface, neighbour);
        report->evaluations++;
        const double gain = objective_change(&surface->sums, &change, &surface->weighting);
        if (gain < best) {
            best = gain;
            place = neighbour;
        }
    }
    return place;
}

/* Moves every droplet to the neighbouring cell where that lowers the objective most; returns how many moved. */
static int64_t sweep_swaps(LayerSurface *surface, SearchReport *report) {
    int64_t swaps = 0;
    for (size_t cell = 0; cell < surface->nx * surface->ny; cell++) {
        if (!surface->occupied[cell])
            continue;
        const Sums taking = surface_flip_change(surface, cell);
        const double taking_cost = objective_change(&surface->sums, &taking, &surface->weighting);
        surface_flip(surface, cell, &taking);
        const size_t place = best_place(surface, cell, taking_cost, report);
        const Sums putting = surface_flip_change(surface, place);
        surface_flip(surface, place, &putting);
        swaps += place != cell;
    }
    return swaps;
}

int32_t flip_search(LayerSurface *surface, int64_t sweeps_max, SearchReport *report) {
    while (report->sweeps < sweeps_max) {
        report->sweeps++;
        const int64_t flips = sweep_flips(surface, report);
        report->flips += flips;
        if (flips > 0)
            continue;
        if (report->sweeps == sweeps_max)
            break;
        report->sweeps++;
        const int64_t swaps = sweep_swaps(surface, report);
        report->swaps += swaps;
        if (swaps == 0)
            return CORE_DONE;
    }
    return CORE_BUDGET;
}
