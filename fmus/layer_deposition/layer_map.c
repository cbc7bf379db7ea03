#include "layer_map.h"

#include <stdbool.h>

#include "neighbour_shares.h"

double taken_share(double rise, double width) {
    if (rise >= 0.0)
        return 1.0;
    return rise <= -width ? 0.0 : 1.0 + rise / width;
}

/* Adds to each cell of a row what it is given from the next one. */
static INLINED void add_from_next(const NextRow *next, size_t count, double *restrict after) {
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
static INLINED void add_from_here(const Surroundings *row, size_t count, double *restrict after) {
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

/* Adds to each cell of a row what reaches it, in the order of the cells that it comes from. */
static INLINED void add_droplets(const Surroundings *row, size_t count, double *after) {
    if (row->above.row->is_jetted)
        add_from_next(&row->above, count, after);
    if (row->here->is_jetted)
        add_from_here(row, count, after);
    if (row->below.row->is_jetted)
        add_from_next(&row->below, count, after);
}

static INLINED void deposit(const DropletPass *pass, double *after) {
    Band band;
    for (size_t first = 0; first < pass->ny; first += BAND) {
        begin_band(pass, first, &band);
        for (size_t i = 0; i < pass->nx; i++) {
            const Surroundings row = surround_row(pass, i, &band);
            add_droplets(&row, band.count, after + i * pass->ny + first);
        }
    }
}

static void deposit_plain(const DropletPass *pass, double *after) {
    deposit(pass, after);
}

static WITH_AVX2 void deposit_avx2(const DropletPass *pass, double *after) {
    deposit(pass, after);
}

static bool is_inside(const DropletPass *pass, size_t i, size_t j, int di, int dj) {
    return (di >= 0 || i > 0) && (di <= 0 || i + 1 < pass->nx) && (dj >= 0 || j > 0) && (dj <= 0 || j + 1 < pass->ny);
}

/* What the droplet at cell (i, j) gives to neighbours outside the grid [m]. */
static double droplet_loss(const DropletPass *pass, size_t i, size_t j) {
    const size_t cell = i * pass->ny + j;
    double lost = 0.0;
    if (pass->pattern[cell] == 0 || (pass->colour != COLOUR_ALL && pass->colour != cell_colour(i, j)))
        return 0.0;
    const Ink *ink = &pass->ink[pass->pattern[cell] - 1];
    const double volume = pass->factor ? pass->factor[cell] : 1.0;
    for (int di = -1; di <= 1; di++)
        for (int dj = -1; dj <= 1; dj++)
            if (!is_inside(pass, i, j, di, dj))
                lost += (di == 0 || dj == 0 ? ink->h2 : ink->h3) * volume;
    return lost;
}

double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour) {
    const DropletPass pass = {nx, ny, before, pattern, {ink[0], ink[1]}, factor, colour};
    double lost = 0.0;
    (HAS_AVX2 ? deposit_avx2 : deposit_plain)(&pass, after);
    for (size_t i = 0; i < nx; i++) {
        const size_t step = i == 0 || i + 1 == nx || ny == 1 ? 1 : ny - 1; /* along the edge */
        for (size_t j = 0; j < ny; j += step)
            lost += droplet_loss(&pass, i, j);
    }
    return lost;
}
