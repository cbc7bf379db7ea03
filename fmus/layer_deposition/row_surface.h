/* Surface after a pass, row by row. */
#ifndef INKLOOP_ROW_SURFACE_H
#define INKLOOP_ROW_SURFACE_H

#include "neighbour_shares.h"

/* Height of cell k after the shares given by the adjacent row. */
static INLINED double after_given(const NextRow *next, size_t k, double height) {
    const double *side = next->row->part[SIDE_PART], *corner = next->row->part[CORNER_PART];
    height += corner[k - 1] * next->left[k - 1];
    height += side[k] * next->straight[k];
    height += corner[k + 1] * next->right[k];
    return height;
}

/* Height of cell k after the shares of its own row. */
static INLINED double after_kept(const CellRow *here, const RowShares *over, const RowShares *under, size_t k,
                                 double height) {
    const double *side = here->part[SIDE_PART], *corner = here->part[CORNER_PART];
    double kept = 0.0;
    kept += corner[k] - corner[k] * over->up_left[k - 1];
    kept += side[k] - side[k] * over->up[k];
    kept += corner[k] - corner[k] * over->up_right[k];
    kept += side[k] - side[k] * under->to_left[k - 1];
    kept += side[k] - side[k] * under->to_right[k];
    kept += corner[k] - corner[k] * under->down_left[k - 1];
    kept += side[k] - side[k] * under->down[k];
    kept += corner[k] - corner[k] * under->down_right[k];
    const double own = here->own[k] + kept;
    height += side[k - 1] * under->to_right[k - 1];
    height += here->kind[k] > 0.0 ? own : -0.0;
    height += side[k + 1] * under->to_left[k];
    return height;
}

/* Whether droplets reach a row. */
static INLINED bool is_reached(const Surroundings *row) {
    return row->above.row->is_jetted || row->here->is_jetted || row->below.row->is_jetted;
}

/* Heights of a row after all shares, in the order of the cells that they come from. */
static INLINED void deposit_row(const Surroundings *row, size_t count, double *restrict after) {
    const Surroundings near = *row;
    if (!is_reached(row)) {
        memcpy(after, near.here->height + 1, count * sizeof *after);
        return;
    }
    for (size_t k = 1; k <= count; k++) {
        double height = near.here->height[k];
        height = after_given(&near.above, k, height);
        height = after_kept(near.here, near.over, near.under, k, height);
        after[k - 1] = after_given(&near.below, k, height);
    }
}

#endif
