#include "droplet_increments.h"

#include <string.h>

#include "row_ranges.h"
#include "row_surface.h"

/* A pass, and maps of its increments; `after`: the surface that it leaves, NULL if not wanted. */
typedef struct {
    DropletPass droplets;
    size_t inks;
    const DropletIncrements *increments;
    bool is_first; /* the maps hold nothing yet */
    double *after;
} IncrementPass;

/* Volumes of the droplets of a kind, 0 elsewhere. */
static INLINED void volumes_of(const CellRow *row, size_t count, double kind, double *restrict volumes) {
    for (size_t k = 0; k < count + 2; k++) {
        const double volume = row->volume[k];
        volumes[k] = row->kind[k] == kind ? volume : 0.0;
    }
}

/* Increments of one row before they go into the maps, by inks and orders. */
typedef struct {
    double rates[INKS_MAX][ORDERS][BAND], squares[BAND], own[BAND];
} RowIncrements;

/* Whether the increments are read off the surface that the droplets leave: so for one ink with a unit, whose increments
 * are the growth of that surface. */
static INLINED bool is_of_surface(const IncrementPass *pass) {
    return pass->increments->unit && pass->inks == 1;
}

/* Height that each droplet of a row leaves on its own cell. */
static INLINED void add_own(const Surroundings *row, size_t count, double *restrict own) {
    const RowShares *over = row->over, *under = row->under;
    const double *kind = row->here->kind;
    const double *side = row->here->part[SIDE_PART], *corner = row->here->part[CORNER_PART];
    for (size_t k = 1; k <= count; k++) {
        double sides = side[k] - side[k] * over->up[k], corners = corner[k] - corner[k] * over->up_left[k - 1];
        sides += side[k] - side[k] * under->to_left[k - 1];
        sides += side[k] - side[k] * under->to_right[k];
        sides += side[k] - side[k] * under->down[k];
        corners += corner[k] - corner[k] * over->up_right[k];
        corners += corner[k] - corner[k] * under->down_left[k - 1];
        corners += corner[k] - corner[k] * under->down_right[k];
        own[k - 1] = kind[k] > 0.0 ? row->here->own[k] + sides + corners : 0.0;
    }
}

/* Adds to the rates of an ink the shares given by the next row. */
static INLINED void add_rates_from_next(const NextRow *next, size_t count, double kind, double rates[ORDERS][BAND]) {
    double volume[FRAMED_BAND], *restrict h2 = rates[1], *restrict h3 = rates[2];
    volumes_of(next->row, count, kind, volume);
    for (size_t k = 1; k <= count; k++) {
        h2[k - 1] += next->straight[k] * volume[k];
        double corners = h3[k - 1];
        corners += next->left[k - 1] * volume[k - 1];
        corners += next->right[k] * volume[k + 1];
        h3[k - 1] = corners;
    }
}

/* Adds to the rates of an ink the droplets of the row itself; own: height that each leaves on its own cell. */
static INLINED void add_rates_from_here(const Surroundings *row, size_t count, double kind, const Ink *ink,
                                        double rates[ORDERS][BAND], double *restrict own) {
    const RowShares *over = row->over, *under = row->under;
    double volumes[FRAMED_BAND], *restrict h1 = rates[0], *restrict h2 = rates[1], *restrict h3 = rates[2];
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

/* Adds the squares of the shares given by the next row. */
static INLINED double squares_from_next(const NextRow *next, size_t k, double sum) {
    const double *side = next->row->part[SIDE_PART], *corner = next->row->part[CORNER_PART];
    sum += square(next->left[k - 1] * corner[k - 1]);
    sum += square(next->straight[k] * side[k]);
    sum += square(next->right[k] * corner[k + 1]);
    return sum;
}

/* Adds the squares of each droplet's share in a cell, in the order of the cells that the shares come from. */
static INLINED void add_squares(const Surroundings *row, size_t count, const double *restrict own,
                                double *restrict squares) {
    const Surroundings near = *row;
    const double *side = near.here->part[SIDE_PART];
    for (size_t k = 1; k <= count; k++) {
        double sum = squares_from_next(&near.above, k, squares[k - 1]);
        sum += square(near.under->to_right[k - 1] * side[k - 1]);
        sum += square(own[k - 1]);
        sum += square(near.under->to_left[k] * side[k + 1]);
        squares[k - 1] = squares_from_next(&near.below, k, sum);
    }
}

/* Adds the rates of each ink, from above, here and below. */
static INLINED void add_rates(const IncrementPass *pass, const Surroundings *row, size_t count, RowIncrements *found) {
    for (size_t ink = 0; ink < pass->inks; ink++) {
        const double kind = (double)(ink + 1);
        if (row->above.row->is_jetted)
            add_rates_from_next(&row->above, count, kind, found->rates[ink]);
        if (row->here->is_jetted)
            add_rates_from_here(row, count, kind, &pass->droplets.ink[ink], found->rates[ink], found->own);
        if (row->below.row->is_jetted)
            add_rates_from_next(&row->below, count, kind, found->rates[ink]);
    }
}

static INLINED void add_from_rows(const IncrementPass *pass, const Surroundings *row, size_t count,
                                  RowIncrements *found) {
    if (!is_reached(row))
        return;
    if (!is_of_surface(pass))
        add_rates(pass, row, count, found);
    else if (row->here->is_jetted)
        add_own(row, count, found->own);
    add_squares(row, count, found->own, found->squares);
}

/* Values of a map, or 0 in the first pass. */
static INLINED void begin_with(const double *restrict map, size_t count, bool is_first, double *restrict values) {
    if (is_first)
        memset(values, 0, count * sizeof(double));
    else
        memcpy(values, map, count * sizeof(double));
}

/* Begins a row with the increments of earlier passes; rates that a pass adds up by itself begin at 0. */
static INLINED void begin_row(const IncrementPass *pass, size_t count, size_t cell, RowIncrements *found) {
    const DropletIncrements *into = pass->increments;
    const size_t cells = pass->droplets.nx * pass->droplets.ny;
    for (size_t map = 0; !is_of_surface(pass) && map < pass->inks * ORDERS; map++)
        begin_with(into->adds + map * cells + cell, count, pass->is_first || into->unit,
                   found->rates[map / ORDERS][map % ORDERS]);
    begin_with(into->squares + cell, count, pass->is_first, found->squares);
    memset(found->own, 0, count * sizeof(double));
}

/* Adds values to those of a map; in the first pass they become its values. */
static INLINED void add_to(double *restrict map, const double *restrict values, size_t count, bool is_first) {
    if (is_first)
        memcpy(map, values, count * sizeof(double));
    for (size_t k = 0; !is_first && k < count; k++)
        map[k] += values[k];
}

/* Height that the droplets of an ink add, in the proportions h1 : h2 : h3 of its unit. */
static INLINED void add_up(const Ink *unit, size_t count, double rates[ORDERS][BAND]) {
    const Ink one = *unit;
    for (size_t k = 0; k < count; k++)
        rates[0][k] = one.h1 * rates[0][k] + one.h2 * rates[1][k] + one.h3 * rates[2][k];
}

/* Stores a row in the maps, from cell `cell` on. */
static INLINED void put_row(const IncrementPass *pass, size_t count, size_t cell, RowIncrements *found) {
    const DropletIncrements *into = pass->increments;
    const size_t cells = pass->droplets.nx * pass->droplets.ny;
    for (size_t map = 0; !into->unit && map < pass->inks * ORDERS; map++)
        memcpy(into->adds + map * cells + cell, found->rates[map / ORDERS][map % ORDERS], count * sizeof(double));
    for (size_t ink = 0; into->unit && ink < pass->inks; ink++) {
        if (!is_of_surface(pass))
            add_up(&into->unit[ink], count, found->rates[ink]);
        add_to(into->adds + ink * cells + cell, found->rates[ink][0], count, pass->is_first);
    }
    memcpy(into->squares + cell, found->squares, count * sizeof(double));
    add_to(into->own + cell, found->own, count, pass->is_first);
}

/* Prefetches the maps of the row that is stored next, from cell `cell` on. */
static INLINED void prefetch_maps(const IncrementPass *pass, size_t count, size_t cell) {
    const DropletIncrements *into = pass->increments;
    const size_t cells = pass->droplets.nx * pass->droplets.ny, bytes = count * sizeof(double);
    for (size_t map = 0; map < pass->inks * maps_of_ink(into->unit); map++)
        prefetch_to_write(into->adds + map * cells + cell, bytes);
    prefetch_to_write(into->squares + cell, bytes);
    prefetch_to_write(into->own + cell, bytes);
    if (pass->after)
        prefetch_to_write(pass->after + cell, bytes);
}

/* Growth of the row to the surface `after`, in units of the ink. */
static INLINED void take_from_surface(const IncrementPass *pass, const Surroundings *row, size_t count,
                                      const double *restrict after, double *restrict adds) {
    const double volume = full_layer_height(pass->increments->unit) / full_layer_height(pass->droplets.ink);
    const double *height = row->here->height + 1;
    for (size_t k = 0; k < count; k++)
        adds[k] = volume * (after[k] - height[k]);
}

static INLINED void add_rows(const IncrementPass *pass, const RowRange *range) {
    Band band;
    RowIncrements found;
    double left[BAND];
    for (size_t first = 0; first < pass->droplets.ny; first += BAND) {
        begin_band(&pass->droplets, first, range->top, &band);
        for (size_t i = range->top; i < range->bottom; i++) { /* in the order of the cells that a share comes from */
            const Surroundings row = surround_row(&pass->droplets, i, &band);
            const size_t cell = i * pass->droplets.ny + first;
            double *after = pass->after ? pass->after + cell : left;
            if (i + 1 < range->bottom)
                prefetch_maps(pass, band.count, cell + pass->droplets.ny);
            begin_row(pass, band.count, cell, &found);
            add_from_rows(pass, &row, band.count, &found);
            if (pass->after || is_of_surface(pass))
                deposit_row(&row, band.count, after);
            if (is_of_surface(pass))
                take_from_surface(pass, &row, band.count, after, found.rates[0][0]);
            put_row(pass, band.count, cell, &found);
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
