/* The surface that a pass leaves, row by row. */
#ifndef INKLOOP_ROW_SURFACE_H
#define INKLOOP_ROW_SURFACE_H

#include "neighbour_shares.h"

/* Adds to each cell of a row what it is given from the next one. */
static INLINED void add_given(const NextRow *next, size_t count, double *restrict after) {
    const double *side = next->row->part[SIDE_PART], *corner = next->row->part[CORNER_PART];
    for (size_t k = 1; k <= count; k++) {
        double height = after[k - 1];
        height += corner[k - 1] * next->left[k - 1];
        height += side[k] * next->straight[k];
        height += corner[k + 1] * next->right[k];
        after[k - 1] = height;
    }
}

/* Adds what the droplets of a row leave on it. */
static INLINED void add_kept(const Surroundings *row, size_t count, double *restrict after) {
    const RowShares *over = row->over, *under = row->under;
    const int32_t *kind = row->here->kind;
    const double *side = row->here->part[SIDE_PART], *corner = row->here->part[CORNER_PART];
    for (size_t k = 1; k <= count; k++) {
        double kept = 0.0, height = after[k - 1];
        kept += corner[k] - corner[k] * over->up_left[k - 1];
        kept += side[k] - side[k] * over->up[k];
        kept += corner[k] - corner[k] * over->up_right[k];
        kept += side[k] - side[k] * under->to_left[k - 1];
        kept += side[k] - side[k] * under->to_right[k];
        kept += corner[k] - corner[k] * under->down_left[k - 1];
        kept += side[k] - side[k] * under->down[k];
        kept += corner[k] - corner[k] * under->down_right[k];
        const double own = row->here->own[k] + kept;
        height += side[k - 1] * under->to_right[k - 1];
        height += kind[k] != 0 ? own : -0.0;
        height += side[k + 1] * under->to_left[k];
        after[k - 1] = height;
    }
}

/* The heights of a row and what reaches them, in the order of the cells that it comes from. */
static INLINED void deposit_row(const Surroundings *row, size_t count, double *after) {
    memcpy(after, row->here->height + 1, count * sizeof *after);
    if (row->above.row->is_jetted)
        add_given(&row->above, count, after);
    if (row->here->is_jetted)
        add_kept(row, count, after);
    if (row->below.row->is_jetted)
        add_given(&row->below, count, after);
}

#endif
