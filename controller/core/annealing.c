#include "annealing.h"

#include <math.h>

#include "counter_random.h"

/* Temperatures as shares of what one droplet's own height is worth in the objective: hot enough to move between the
 * optima of random surfaces, cold enough to freeze (found by trial on grids whose optimum is proven). */
static const double HOT = 0.2, COLD = 0.01;

void anneal(LayerSurface *surface, int64_t sweeps, uint64_t seed, SearchReport *report) {
    const size_t cells = surface->nx * surface->ny;
    uint64_t drawn = 0;
    for (int64_t sweep = 0; sweep < sweeps; sweep++) {
        const double cooled = sweeps > 1 ? (double)sweep / (double)(sweeps - 1) : 1.0;
        const double temperature = surface->droplet_worth * HOT * pow(COLD / HOT, cooled);
        for (size_t cell = 0; cell < cells; cell++) {
            if (!surface->allowed[cell])
                continue;
            const Sums change = surface_flip_change(surface, cell);
            const double cost = objective_change(&surface->sums, &change, &surface->weighting);
            report->evaluations++;
            if (cost < 0.0 || random_unit(seed, drawn++) < exp(-cost / temperature)) {
                surface_flip(surface, cell, &change);
                report->flips++;
            }
        }
        report->sweeps++;
    }
}
