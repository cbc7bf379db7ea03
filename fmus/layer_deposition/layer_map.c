#include "layer_map.h"

#include <stdbool.h>

#include "row_surface.h"

double taken_share(double rise, double width) {
    if (rise >= 0.0)
        return 1.0;
    return rise <= -width ? 0.0 : 1.0 + rise / width;
}

static INLINED void deposit(const DropletPass *pass, size_t top, size_t bottom, double *after) {
    Band band;
    for (size_t first = 0; first < pass->ny; first += BAND) {
        begin_band(pass, first, top, &band);
        for (size_t i = top; i < bottom; i++) {
            const Surroundings row = surround_row(pass, i, &band);
            if (i + 1 < bottom)
                prefetch_to_write(after + (i + 1) * pass->ny + first, band.count * sizeof(double));
            deposit_row(&row, band.count, after + i * pass->ny + first);
        }
    }
}

static void deposit_plain(const DropletPass *pass, size_t top, size_t bottom, double *after) {
    deposit(pass, top, bottom, after);
}

static WITH_AVX2 void deposit_avx2(const DropletPass *pass, size_t top, size_t bottom, double *after) {
    deposit(pass, top, bottom, after);
}

void deposit_rows(const DropletPass *pass, size_t top, size_t bottom, double *after) {
    (HAS_AVX2 ? deposit_avx2 : deposit_plain)(pass, top, bottom, after);
}

static bool is_inside(const DropletPass *pass, size_t i, size_t j, int di, int dj) {
    return (di >= 0 || i > 0) && (di <= 0 || i + 1 < pass->nx) && (dj >= 0 || j > 0) && (dj <= 0 || j + 1 < pass->ny);
}

/* Height that the droplet at cell (i, j) gives to neighbours outside the grid [m]. */
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

double lost_in_pass(const DropletPass *pass) {
    double lost = 0.0;
    for (size_t i = 0; i < pass->nx; i++) {
        const size_t step = i == 0 || i + 1 == pass->nx || pass->ny == 1 ? 1 : pass->ny - 1; /* along the edge */
        for (size_t j = 0; j < pass->ny; j += step)
            lost += droplet_loss(pass, i, j);
    }
    return lost;
}

double deposit_pass(const double *before, double *after, size_t nx, size_t ny, const int32_t *pattern, const Ink ink[2],
                    const double *factor, int colour) {
    const DropletPass pass = {nx, ny, before, pattern, {ink[0], ink[1]}, factor, colour};
    deposit_rows(&pass, 0, nx, after);
    return lost_in_pass(&pass);
}
