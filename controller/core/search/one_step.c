#include "one_step.h"

#include "one_step_cells.h"

static CellChange cell_change(const PlanSurface *surface, const Change *change) {
    const unsigned from = surface_layer(surface, 0)[surface_cell(surface, change->i, change->j)];
    return (CellChange){change->i, change->j, from, change->value};
}

Sums one_step_trial(const PlanSurface *surface, const Change *change, size_t count, bool cost_alone) {
    const CellChange one = cell_change(surface, change);
    if (count == 1) {
        ChangedCells cells;
        look_at_change(surface, &one, cost_alone, &cells);
        return cells.sums;
    }
    const CellChange two = cell_change(surface, &change[1]);
    FirstChange first;
    first_open(&first);
    look_at_first(surface, &one, cost_alone, &first);
    return look_at_second(surface, &first, near_of(two.i + 1 - one.i, two.j + 1 - one.j), &two, cost_alone);
}

void one_step_apply(PlanSurface *surface, const Change *change, size_t count) {
    for (size_t k = 0; k < count; k++) {
        const CellChange made = cell_change(surface, &change[k]);
        ChangedCells cells;
        look_at_change(surface, &made, true, &cells);
        put_cells(surface, &made, &cells);
    }
}
