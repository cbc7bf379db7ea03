#include "droplet_increments.h"

#include <string.h>

#include "row_ranges.h"
#include "row_surface.h"

/* A pass, and maps for what it adds; `after`: the surface that it leaves, NULL if it is not wanted. */
typedef struct {
    DropletPass droplets;
    size_t inks;
    const DropletIncrements *increments;
    bool is_first; /* nothing stands in the maps yet */
    double *after;
} IncrementPass;

/* Volumes of the droplets of a kind, 0 elsewhere. */
static INLINED void volumes_of(const CellRow *row, size_t count, int32_t kind, double *restrict volumes) {
    for (size_t k = 0; k < count + 2; k++) {
        const double volume = row->volume[k];
        volumes[k] = row->kind[k] == kind ? volume : 0.0;
    }
}

/* Adds the rates of an ink by what is given from the next row. */
static INLINED void add_rates_from_next(const NextRow *next, size_t count, int32_t kind, double *restrict h2,
                                        double *restrict h3) {
    double volume[FRAMED_BAND];
    volumes_of(next->row, count, kind, volume);
    for (size_t k = 1; k <= count; k++) {
        h2[k - 1] += next->straight[k] * volume[k];
        double corners = h3[k - 1];
        corners += next->left[k - 1] * volume[k - 1];
        corners += next->right[k] * volume[k + 1];
        h3[k - 1] = corners;
    }
}

/* Adds the rates of an ink by the droplets of a row itself; own: what each leaves on its cell. */
static INLINED void add_rates_from_here(const Surroundings *row, size_t count, int32_t kind, const Ink *ink,
                                        double *restrict h1, double *restrict h2, double *restrict h3,
                                        double *restrict own) {
    const RowShares *over = row->over, *under = row->under;
    double volumes[FRAMED_BAND];
    volumes_of(row->here, count, kind, volumes);
    for (size_t k = 1; k <= count; k++) {
        const double volume = volumes[k];
        double side = 0.0, corner = 0.0, sides = h2[k - 1];
        side += volume - over->up[k] * volume;
        side += volume - under->to_left[k - 1] * volume;
        side += volume - under->to_right[k] * volume;
        side += volume - under->down[k] * volume;
        corner += volume - over->up_left[k - 1] * volume;
        corner += volume - over->up_right[k] * volume;
        corner += volume - under->down_left[k - 1] * volume;
        corner += volume - under->down_right[k] * volume;
        sides += under->to_right[k - 1] * volumes[k - 1];
        sides += side;
        sides += under->to_left[k] * volumes[k + 1];
        h1[k - 1] += volume;
        h2[k - 1] = sides;
        h3[k - 1] += corner;
        own[k - 1] += ink->h1 * volume + ink->h2 * side + ink->h3 * corner;
    }
}

static INLINED double square(double x) {
    return x * x;
}

static INLINED void add_squares_from_next(const NextRow *next, size_t count, double *restrict squares) {
    const double *side = next->row->part[SIDE_PART], *corner = next->row->part[CORNER_PART];
    for (size_t k = 1; k <= count; k++) {
        double sum = squares[k - 1];
        sum += square(next->left[k - 1] * corner[k - 1]);
        sum += square(next->straight[k] * side[k]);
        sum += square(next->right[k] * corner[k + 1]);
        squares[k - 1] = sum;
    }
}

static INLINED void add_squares_from_here(const Surroundings *row, size_t count, const double *restrict own,
                                          double *restrict squares, double *restrict owns) {
    const double *side = row->here->part[SIDE_PART];
    for (size_t k = 1; k <= count; k++) {
        double sum = squares[k - 1];
        sum += square(row->under->to_right[k - 1] * side[k - 1]);
        sum += square(own[k - 1]);
        sum += square(row->under->to_left[k] * side[k + 1]);
        squares[k - 1] = sum;
        owns[k - 1] += own[k - 1];
    }
}

/* Adds to the maps, from cell `cell` on, what is given from the next row. */
static INLINED void add_from_next(const IncrementPass *pass, const NextRow *next, size_t count, size_t cell) {
    const size_t cells = pass->droplets.nx * pass->droplets.ny;
    if (!next->row->is_jetted)
        return;
    for (size_t ink = 0; ink < pass->inks; ink++) {
        double *h2 = pass->increments->rates + (ink * ORDERS + 1) * cells + cell;
        add_rates_from_next(next, count, (int32_t)ink + 1, h2, h2 + cells);
    }
    add_squares_from_next(next, count, pass->increments->squares + cell);
}

/* The same for the droplets of the row itself. */
static INLINED void add_from_here(const IncrementPass *pass, const Surroundings *row, size_t count, size_t cell) {
    const size_t cells = pass->droplets.nx * pass->droplets.ny;
    double own[BAND];
    if (!row->here->is_jetted)
        return;
    memset(own, 0, count * sizeof *own);
    for (size_t ink = 0; ink < pass->inks; ink++) {
        double *h1 = pass->increments->rates + ink * ORDERS * cells + cell;
        add_rates_from_here(row, count, (int32_t)ink + 1, &pass->droplets.ink[ink], h1, h1 + cells, h1 + 2 * cells,
                            own);
    }
    add_squares_from_here(row, count, own, pass->increments->squares + cell, pass->increments->own + cell);
}

/* From above, here and below, in this order; the loop needs the code for a next row only once. */
static INLINED void add_from_rows(const IncrementPass *pass, const Surroundings *row, size_t count, size_t cell) {
    for (const NextRow *next = &row->above; next; next = next == &row->above ? &row->below : NULL) {
        add_from_next(pass, next, count, cell);
        if (next == &row->above)
            add_from_here(pass, row, count, cell);
    }
}

/* Clears the maps, from cell `cell` on. */
static INLINED void clear_cells(const IncrementPass *pass, size_t count, size_t cell) {
    const size_t cells = pass->droplets.nx * pass->droplets.ny;
    for (size_t rate = 0; rate < pass->inks * ORDERS; rate++)
        memset(pass->increments->rates + rate * cells + cell, 0, count * sizeof(double));
    memset(pass->increments->squares + cell, 0, count * sizeof(double));
    memset(pass->increments->own + cell, 0, count * sizeof(double));
}

static INLINED void add_rows(const IncrementPass *pass, const RowRange *range) {
    Band band;
    for (size_t first = 0; first < pass->droplets.ny; first += BAND) {
        begin_band(&pass->droplets, first, range->top, &band);
        for (size_t i = range->top; i < range->bottom; i++) { /* in the order of the cells that a share comes from */
            const Surroundings row = surround_row(&pass->droplets, i, &band);
            const size_t cell = i * pass->droplets.ny + first;
            if (pass->is_first)
                clear_cells(pass, band.count, cell);
            add_from_rows(pass, &row, band.count, cell);
            if (pass->after)
                deposit_row(&row, band.count, pass->after + cell);
        }
    }
}

CLONED_ROW_WORK(add_pass, add_rows)

void droplet_increments(const JettedLayer *layer, const double *height, size_t inks, const Ink ink[], double *scratch,
                        const DropletIncrements *increments, double *after) {
    const size_t cells = layer->nx * layer->ny;
    IncrementPass pass = {{layer->nx, layer->ny, height, layer->pattern, {ink[0], ink[inks - 1]}, layer->factor, 0},
                          inks,
                          increments,
                          true,
                          NULL};
    for (int32_t number = 0; number < layer->passes; number++) {
        pass.droplets.colour = layer->passes == 1 ? COLOUR_ALL : layer->order[number];
        pass.after = number + 1 == layer->passes ? after : scratch + (size_t)(number % 2) * cells;
        run_rows(layer->threads, layer->nx, layer->ny, add_pass, &pass);
        pass.droplets.before = pass.after;
        pass.is_first = false;
    }
}

/* Volumes of the droplets of a kind in a row of the grid, with the frame; 0 outside. */
static void load_volumes(const JettedLayer *layer, size_t row, size_t first, size_t count, int32_t kind,
                         double *restrict volumes) {
    const bool is_inside = row > 0 && row <= layer->nx;
    const size_t from = first > 0 ? 0 : 1, end = count + (first + count < layer->ny ? 2 : 1);
    memset(volumes, 0, (count + 2) * sizeof *volumes);
    if (!is_inside)
        return;
    const int32_t *pattern = layer->pattern + (row - 1) * layer->ny + first + from - 1;
    const double *factor = layer->factor ? layer->factor + (row - 1) * layer->ny + first + from - 1 : NULL;
    for (size_t k = from; k < end; k++)
        volumes[k] = pattern[k - from] == kind ? 1.0 : 0.0;
    for (size_t k = from; factor && k < end; k++)
        volumes[k] = volumes[k] == 0.0 ? 0.0 : factor[k - from];
}

void flat_rates(const JettedLayer *layer, size_t inks, size_t row, size_t first, size_t count, double *rates) {
    double rows[3][FLAT_CELLS + 2];
    for (size_t ink = 0; ink < inks; ink++, rates += ORDERS * FLAT_CELLS) {
        double *restrict h1 = rates, *restrict h2 = h1 + FLAT_CELLS, *restrict h3 = h2 + FLAT_CELLS;
        for (size_t k = 0; k < 3; k++)
            load_volumes(layer, row + k, first, count, (int32_t)ink + 1, rows[k]);
        for (size_t k = 1; k <= count; k++) {
            h1[k - 1] = rows[1][k];
            h2[k - 1] = rows[0][k] + rows[1][k - 1] + rows[1][k + 1] + rows[2][k];
            h3[k - 1] = rows[0][k - 1] + rows[0][k + 1] + rows[2][k - 1] + rows[2][k + 1];
        }
    }
}
