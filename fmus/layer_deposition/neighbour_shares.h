/* Shares that the neighbours of a cell take of their parts (eq. 5), for a row of cells at once and without a branch.
 *
 * Of two neighbours at most the lower one gives less than a full part, so a pair costs one division. Rows are read in
 * bands of columns that fit into the cache, with a frame of one cell: a cell outside the grid lies infinitely low and
 * takes its full part. The shares of a cell without a droplet are products with -0.0, which change no sum. */
#ifndef INKLOOP_NEIGHBOUR_SHARES_H
#define INKLOOP_NEIGHBOUR_SHARES_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "droplet_pass.h"
#include "instruction_sets.h"

/* cells computed at once: loops over rows are extended to whole vectors, into cells that are 0 */
enum { VECTOR = 4 };
enum { BAND = 64, FRAMED_BAND = BAND + 2 * VECTOR }; /* columns (by trial); cell k of a band stands at 1 + k */
enum { SIDE_PART, CORNER_PART, PARTS };

/* Cells of a row. */
typedef struct {
    _Alignas(CACHE_LINE) double height[FRAMED_BAND];
    /* kind of the droplet: 0 none, 1 + index of the ink; as wide as the values it selects */
    double kind[FRAMED_BAND];
    double volume[FRAMED_BAND];       /* volume of the droplet [1] */
    double own[FRAMED_BAND];          /* h1 times volume [m] */
    double part[PARTS][FRAMED_BAND];  /* h2 and h3 times volume, without a droplet -0.0 [m] */
    double width[PARTS][FRAMED_BAND]; /* own plus part: height difference at which a share reaches 0 [m] */
    bool is_jetted;                   /* some cell has a droplet */
} CellRow;

/* Shares between the cells of a row and those of the next one. Element k belongs to cell k and the next cell in
 * to_right and down_right, to cell k and the cell below in down; in down_left cell k is the one below. Backwards:
 * to_left, up_left, up, up_right. */
typedef struct {
    _Alignas(CACHE_LINE) double to_right[FRAMED_BAND], down_left[FRAMED_BAND], down[FRAMED_BAND];
    double down_right[FRAMED_BAND], to_left[FRAMED_BAND], up_right[FRAMED_BAND], up[FRAMED_BAND], up_left[FRAMED_BAND];
} RowShares;

/* Some columns of a grid, three rows at a time. */
typedef struct {
    size_t first, count; /* columns */
    CellRow row[3];
    RowShares shares[2];
} Band;

/* An adjacent row, and the shares that its cells give to this one: cell k receives left[k - 1] of the part of cell k -
 * 1, straight[k] of that of cell k, right[k] of that of cell k + 1. */
typedef struct {
    const CellRow *row;
    const double *left, *straight, *right;
} NextRow;

/* A row of a band and the rows next to it. */
typedef struct {
    NextRow above, below;
    const CellRow *here;
    const RowShares *over, *under; /* shares with the row above and of this row */
} Surroundings;

/* Number of cells rounded up to whole vectors. */
static INLINED size_t whole_vectors(size_t count) {
    return (count + VECTOR - 1) & ~(size_t)(VECTOR - 1);
}

static INLINED void clear_row(CellRow *row) {
    row->is_jetted = false;
    for (size_t k = 0; k < FRAMED_BAND; k++) {
        row->height[k] = -DBL_MAX; /* not infinite: differences stay numbers */
        row->kind[k] = 0.0;
        row->volume[k] = row->own[k] = 0.0;
        row->part[SIDE_PART][k] = row->part[CORNER_PART][k] = -0.0;
        row->width[SIDE_PART][k] = row->width[CORNER_PART][k] = DBL_MIN;
    }
}

/* Height that each droplet of a row leaves, and its largest shares. */
static INLINED void spread_droplets(Ink one, Ink other, size_t count, CellRow *row) {
    const size_t whole = whole_vectors(count);
    for (size_t k = 0; k < whole; k++) {
        const double kind = row->kind[k], volume = row->volume[k];
        const double own = (kind > 1.0 ? other.h1 : one.h1) * volume, side = (kind > 1.0 ? other.h2 : one.h2) * volume,
                     corner = (kind > 1.0 ? other.h3 : one.h3) * volume;
        const double side_width = own + side, corner_width = own + corner;
        row->own[k] = own;
        row->part[SIDE_PART][k] = kind > 0.0 ? side : -0.0;
        row->part[CORNER_PART][k] = kind > 0.0 ? corner : -0.0;
        row->width[SIDE_PART][k] = side_width > DBL_MIN ? side_width : DBL_MIN; /* avoids a division by 0 */
        row->width[CORNER_PART][k] = corner_width > DBL_MIN ? corner_width : DBL_MIN;
    }
}

/* The droplets of row i; `from` and `end` counted with the frame. */
static INLINED void load_droplets(const DropletPass *pass, size_t i, size_t first, size_t from, size_t end,
                                  CellRow *row) {
    const size_t corner = i * pass->ny + first + from - 1;
    int32_t kind[FRAMED_BAND], any = 0; /* separate loops: gcc 12 does not vectorise them together */
    memcpy(kind + from, pass->pattern + corner, (end - from) * sizeof(int32_t));
    for (size_t k = from; pass->colour != COLOUR_ALL && k < end; k++)
        kind[k] = pass->colour == cell_colour(i, first + k - 1) ? kind[k] : 0;
    for (size_t k = from; k < end; k++)
        any |= kind[k];
    for (size_t k = from; k < end; k++)
        row->kind[k] = (double)kind[k];
    for (size_t k = from; !pass->factor && k < end; k++)
        row->volume[k] = 1.0;
    if (pass->factor)
        memcpy(row->volume + from, pass->factor + corner, (end - from) * sizeof(double));
    row->is_jetted = any != 0;
    if (any > 1)
        spread_droplets(pass->ink[0], pass->ink[1], end, row);
    else /* nothing to choose */
        spread_droplets(pass->ink[0], pass->ink[0], end, row);
}

/* Prefetches the cells of row `row` of the grid in a band. */
static INLINED void prefetch_row(const DropletPass *pass, const Band *band, size_t row) {
    const size_t corner = row * pass->ny + band->first;
    if (row >= pass->nx)
        return;
    prefetch(pass->before + corner, band->count * sizeof(double));
    prefetch(pass->pattern + corner, band->count * sizeof(int32_t));
    if (pass->factor)
        prefetch(pass->factor + corner, band->count * sizeof(double));
}

/* Loads row i - 1 of the grid; 0 and nx + 1 are the frame. Cells of the band beyond the grid stay 0. */
static INLINED void load_row(const DropletPass *pass, const Band *band, size_t i, CellRow *row) {
    const size_t from = band->first > 0 ? 0 : 1, end = band->count + (band->first + band->count < pass->ny ? 2 : 1);
    if (i == 0 || i > pass->nx) {
        clear_row(row);
        return;
    }
    memcpy(row->height + from, pass->before + (i - 1) * pass->ny + band->first + from - 1,
           (end - from) * sizeof(double));
    load_droplets(pass, i - 1, band->first, from, end, row);
    prefetch_row(pass, band, i);
}

/* Shares of `count` pairs of cells, and of those that fill a vector: given by one to the other, and received from
 * it. */
static INLINED void pair_shares(size_t count, const double *one, const double *other, const double *width_one,
                                const double *width_other, double *restrict given, double *restrict taken) {
    const size_t whole = whole_vectors(count);
    for (size_t k = 0; k < whole; k++) {
        const double rise = one[k] - other[k], fall = fabs(rise), mine = width_one[k], its = width_other[k];
        const double width = rise < 0.0 ? mine : its;
        const double share = 1.0 - (fall < width ? fall : width) / width;
        given[k] = rise >= 0.0 ? 1.0 : share;
        taken[k] = rise <= 0.0 ? 1.0 : share;
    }
}

static INLINED void row_shares(const CellRow *row, const CellRow *next, size_t count, RowShares *shares) {
    const double *side = row->width[SIDE_PART], *corner = row->width[CORNER_PART];
    const double *next_side = next->width[SIDE_PART], *next_corner = next->width[CORNER_PART];
    if (row->is_jetted)
        pair_shares(count + 1, row->height, row->height + 1, side, side + 1, shares->to_right, shares->to_left);
    if (!row->is_jetted && !next->is_jetted)
        return; /* the old values are not used */
    pair_shares(count + 1, row->height + 1, next->height, corner + 1, next_corner, shares->down_left, shares->up_right);
    pair_shares(count + 2, row->height, next->height, side, next_side, shares->down, shares->up);
    pair_shares(count + 1, row->height, next->height + 1, corner, next_corner + 1, shares->down_right, shares->up_left);
}

/* Begins a band with the columns from `first` on, before row `top`. */
static INLINED void begin_band(const DropletPass *pass, size_t first, size_t top, Band *band) {
    CellRow *above = &band->row[top % 3], *here = &band->row[(top + 1) % 3];
    band->first = first;
    band->count = pass->ny - first < BAND ? pass->ny - first : BAND;
    memset(band->shares, 0, sizeof band->shares);
    for (size_t k = 0; k < 3; k++)
        clear_row(&band->row[k]);
    load_row(pass, band, top, above);
    load_row(pass, band, top + 1, here);
    row_shares(above, here, band->count, &band->shares[top % 2]);
}

/* Row i and its neighbours; rows are read in order from the first one on. */
static INLINED Surroundings surround_row(const DropletPass *pass, size_t i, Band *band) {
    CellRow *below = &band->row[(i + 2) % 3];
    const CellRow *above = &band->row[i % 3], *here = &band->row[(i + 1) % 3];
    const RowShares *over = &band->shares[i % 2];
    RowShares *under = &band->shares[(i + 1) % 2];
    load_row(pass, band, i + 2, below);
    row_shares(here, below, band->count, under);
    return (Surroundings){{above, over->down_right, over->down, over->down_left},
                          {below, under->up_right, under->up, under->up_left},
                          here,
                          over,
                          under};
}

#endif
