#include "displacement_response.h"

#include <string.h>

#include "map_memory.h"
#include "near_cells.h"

bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response) {
    const size_t cells = nx * ny;
    double *scratch = take_maps(cells, 3 * sizeof(double) + 1);
    if (!scratch)
        return false;
    uint8_t *unseen = (uint8_t *)(scratch + 3 * cells);
    const Patch whole = {0, nx, 0, ny};
    for (size_t cell = 0; cell < cells; cell++)
        unseen[cell] = !valid[cell];
    const DisplacedView view = displaced_view((Displacement){0.0, 0.0, 0.0});
    const Rows slopes[DISPLACEMENTS] = {{response, 0}, {response + cells, 0}, {response + 2 * cells, 0}};
    displaced_scan_slopes(nx, ny, scan, &view, &whole, &(Scratch){scratch, 0, nx}, slopes);
    for (size_t i = 0; i < nx; i++) {
        uint8_t *near = (uint8_t *)scratch; /* of the row */
        mark_near_row(unseen, nx, ny, i, near);
        for (size_t k = 0; k < DISPLACEMENTS; k++) {
            double *row = response + k * cells + i * ny;
            for (size_t j = 0; j < ny; j++)
                row[j] = near[j] ? 0.0 : -row[j];
        }
    }
    give_maps(scratch);
    return true;
}

/* How the innovation of some cells with walls among them goes with the displacement before, and with the step of the
 * shift. */
static void slopes_at_walls(const WallColumns *columns, const double *response, size_t cells, size_t first,
                            size_t count, size_t *wall, double sensitivity[DISPLACEMENTS][CARRIED],
                            double step[SHIFTS][CARRIED]) {
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        memcpy(sensitivity[k], response + k * cells + first, count * sizeof(double));
    for (size_t k = 0; k < SHIFTS; k++)
        for (size_t c = 0; c < count; c++)
            step[k][c] = 0.0;
    for (size_t c = 0; c < count; c++) {
        const size_t place = column_place(columns, first + c, wall);
        for (size_t k = 0; columns->is_wall[first + c] && k < DISPLACEMENTS; k++)
            sensitivity[k][c] = columns->of[k][place];
        for (size_t k = 0; columns->is_wall[first + c] && k < SHIFTS; k++)
            step[k][c] = columns->of[STEP + k][place];
    }
}

/* What the innovation leaves of the response of some cells, of which none is a wall. */
static void leave_elsewhere(const double *before, size_t cells, size_t first, size_t count, const double *gain,
                            double left[DISPLACEMENTS][CARRIED]) {
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        const double *its = before + k * cells + first;
        for (size_t c = 0; c < count; c++)
            left[k][c] = its[c] - gain[c] * its[c];
    }
}

/* The same with walls among them, and what it leaves of the step of the shift. */
static void leave_at_walls(const WallColumns *columns, const double *before, size_t cells, size_t first, size_t count,
                           size_t *wall, const double *gain, double left[DISPLACEMENTS][CARRIED],
                           double step[SHIFTS][CARRIED]) {
    double sensitivity[DISPLACEMENTS][CARRIED];
    slopes_at_walls(columns, before, cells, first, count, wall, sensitivity, step);
    for (size_t k = 0; k < DISPLACEMENTS; k++)
        for (size_t c = 0; c < count; c++)
            left[k][c] = before[k * cells + first + c] - gain[c] * sensitivity[k][c];
    for (size_t k = 0; k < SHIFTS; k++)
        for (size_t c = 0; c < count; c++) {
            step[k][c] = -gain[c] * step[k][c];
            left[k][c] -= step[k][c];
        }
}

void carry_response(size_t cells, size_t first, size_t count, const RegisteredScan *registered, size_t *wall,
                    const double *before, const double *gain, double *response, double *variance) {
    const double *previous = registered->previous, *rest = registered->rest;
    const bool has_walls = memchr(registered->columns.is_wall + first, 1, count);
    double left[DISPLACEMENTS][CARRIED], step[SHIFTS][CARRIED];
    if (has_walls)
        leave_at_walls(&registered->columns, before, cells, first, count, wall, gain, left, step);
    else
        leave_elsewhere(before, cells, first, count, gain, left);
    for (size_t c = 0; variance && c < count; c++)
        for (size_t i = 0; i < DISPLACEMENTS; i++)
            for (size_t j = 0; j < DISPLACEMENTS; j++)
                variance[c] += left[i][c] * rest[i * DISPLACEMENTS + j] * left[j][c];
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        double *carried = response + k * cells + first;
        const double x = previous[k], y = previous[DISPLACEMENTS + k], spread = previous[2 * DISPLACEMENTS + k];
        const bool has_step = has_walls && k < SHIFTS;
        for (size_t c = 0; has_step && c < count; c++)
            carried[c] = step[k][c] + left[0][c] * x + left[1][c] * y + left[2][c] * spread;
        for (size_t c = 0; !has_step && c < count; c++)
            carried[c] = left[0][c] * x + left[1][c] * y + left[2][c] * spread;
    }
}
