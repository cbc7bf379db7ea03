#include "displacement_response.h"

#include <string.h>

#include "map_memory.h"
#include "near_cells.h"

bool first_response(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double *response) {
    const size_t cells = nx * ny;
    double *scratch = take_raw_maps(cells, 3 * sizeof(double) + 1);
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
