/* How the errors of the heights go with the displacement of the scans: the response, DISPLACEMENTS maps. */
#ifndef INKLOOP_DISPLACEMENT_RESPONSE_H
#define INKLOOP_DISPLACEMENT_RESPONSE_H

#include <string.h>

#include "instruction_sets.h"
#include "scan_registration.h"

/* What the first scan, a map of heights, makes of the response: all of its slopes. False if there is no memory. */
bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response);

enum { CARRIED = 64 }; /* cells at most */

/* How the innovation of some cells with walls among them goes with the displacement before, and with the step of the
 * shift. */
static INLINED void slopes_at_walls(const WallColumns *columns, const double *response, size_t cells, size_t first,
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
static INLINED void leave_elsewhere(const double *before, size_t cells, size_t first, size_t count, const double *gain,
                                    double left[DISPLACEMENTS][CARRIED]) {
    for (size_t k = 0; k < DISPLACEMENTS; k++) {
        const double *its = before + k * cells + first;
        for (size_t c = 0; c < count; c++)
            left[k][c] = its[c] - gain[c] * its[c];
    }
}

/* The same with walls among them, and what it leaves of the step of the shift. */
static INLINED void leave_at_walls(const WallColumns *columns, const double *before, size_t cells, size_t first,
                                   size_t count, size_t *wall, const double *gain, double left[DISPLACEMENTS][CARRIED],
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

/* The response of `count` cells from `first` on, after their heights took the shares `gain` of the innovation; `wall`:
 * number of walls before them, carried along. The response may stand where the one before did. What no displacement
 * explains any longer is added to the `variance` of these cells [m^2], if it is not NULL. */
static INLINED void carry_response(size_t cells, size_t first, size_t count, const RegisteredScan *registered,
                                   size_t *wall, const double *before, const double *gain, double *response,
                                   double *variance) {
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

#endif
