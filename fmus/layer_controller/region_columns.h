/* The region of material A, from the maps of the parameters to the columns that the planner reads. */
#ifndef INKLOOP_REGION_COLUMNS_H
#define INKLOOP_REGION_COLUMNS_H

#include "ink_regions.h"
#include "layer_controller_variables.h"

#include <stdbool.h>

/* Whether both materials are printed, each in its place. */
bool has_region(const LayerControllerVariables *v);

/* The intervals of each cell in the scratch memory of the instance, `step` and `test` left 0; false if there is no
 * memory. */
bool region_columns(Instance *instance, const LayerControllerVariables *v, InkRegions *regions);

#endif
