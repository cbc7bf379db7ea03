/* Cells whose droplets do not come, detected from the growth of the print itself. */
#ifndef INKLOOP_DEAD_CELLS_H
#define INKLOOP_DEAD_CELLS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Evidence from which on a cell is dead: three layers of it; by chance less than once in a million cells (Wald 1945:
 * exp -15). */
#define DEAD_EVIDENCE 15.0

/* Logarithm of how much likelier nothing comes than a weak droplet [1], cell by cell (Wald 1945; Page 1954: never below
 * 0): `before` the layer, and with it in `after`.
 *
 * own: what the cell's droplet was to leave on it [m], 0 where there was none or it was not seen: such a layer is no
 * evidence, nor is one in which most of the part got nothing; grown: what the neighbours' droplets do not explain of
 * its growth [m], with its variance [m^2]; part_cells: number of cells of the part. */
void dead_evidence(size_t cells, const double *before, const double *own, const double *grown, const double *variance,
                   size_t part_cells, double *after);

/* Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned. */
bool is_probe(int64_t layer);

#endif
