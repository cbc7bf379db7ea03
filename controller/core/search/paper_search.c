#include "paper_search.h"

#include "counter_random.h"

typedef struct {
    uint64_t seed, drawn;
} Draw;

/* A new random order of the places, cells of the layers of a plan (Fisher, Yates). */
static void shuffle(size_t *order, size_t count, Draw *draw) {
    for (size_t left = count; left > 1; left--) {
        const size_t picked = (size_t)random_below(draw->seed, draw->drawn++, left);
        const size_t swapped = order[left - 1];
        order[left - 1] = order[picked];
        order[picked] = swapped;
    }
}

/* Flip of a place: removes its droplet, or adds one of the first kind allowed there. */
static Change flip_of(const PlanSurface *surface, size_t place) {
    const size_t cells = surface->nx * surface->ny, cell = place % cells;
    Change flip = {place / cells, cell / surface->ny, cell % surface->ny, 0};
    if (surface_layer(surface, flip.layer)[surface_cell(surface, flip.i, flip.j)])
        return flip;
    do
        flip.value++;
    while (!surface_allows(surface, flip.layer, flip.i, flip.j, flip.value));
    return flip;
}

static void flip_all(PlanSurface *surface, const size_t *marked, size_t marks, Window *window) {
    for (size_t k = 0; k < marks; k++) {
        const Change flip = flip_of(surface, marked[k]);
        const Sums change = plan_trial(surface, &flip, 1, window);
        plan_apply(surface, &flip, 1, window);
        surface->sums = sums_after(&surface->sums, &change);
    }
}

/* Marks the places of the batch whose flip alone lowers the objective; returns how many. */
static size_t mark(const PlanSurface *surface, const size_t *batch, size_t count, size_t *marked, Window *window,
                   SearchReport *report) {
    size_t marks = 0;
    for (size_t k = 0; k < count; k++) {
        const Change flip = flip_of(surface, batch[k]);
        const Sums change = plan_trial(surface, &flip, 1, window);
        report->evaluations++;
        if (objective_change(&surface->sums, &change, &surface->weighting) < -surface->least_gain)
            marked[marks++] = batch[k];
    }
    return marks;
}

/* Flips all marked places; undoes it and returns false if together they do not lower the objective. */
static bool flip_together(PlanSurface *surface, const size_t *marked, size_t marks, Window *window) {
    const double before = objective(&surface->sums, &surface->weighting);
    flip_all(surface, marked, marks, window);
    if (marks == 1 || objective(&surface->sums, &surface->weighting) < before)
        return true;
    flip_all(surface, marked, marks, window);
    return false;
}

int32_t paper_search(PlanSurface *surface, size_t batch, int64_t iterations_max, uint64_t seed, size_t *order,
                     size_t *marked, Window *window, SearchReport *report) {
    size_t count = 0;
    for (size_t place = 0; place < surface->problem->layers * surface->nx * surface->ny; place++)
        if (surface->problem->choices[place])
            order[count++] = place;
    Draw draw = {seed, 0};
    int64_t iterations = 0;
    for (bool improved = true; improved;) {
        improved = false;
        report->sweeps++;
        shuffle(order, count, &draw);
        for (size_t first = 0; first < count;) {
            if (iterations++ == iterations_max)
                return CORE_BUDGET;
            const size_t size = batch < count - first ? batch : count - first;
            const size_t marks = mark(surface, order + first, size, marked, window, report);
            first += size;
            if (marks == 0)
                continue;
            improved = true;
            if (flip_together(surface, marked, marks, window))
                report->flips += (int64_t)marks;
            else
                batch = batch > 1 ? batch / 2 : 1;
        }
    }
    return CORE_DONE;
}
