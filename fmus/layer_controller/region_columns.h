/* The region of material A: columns for the core, from the maps of the parameters. */
#ifndef INKLOOP_REGION_COLUMNS_H
#define INKLOOP_REGION_COLUMNS_H

#include "layer_controller_variables.h"
#include "step_options.h"

/* The intervals of each cell as columns in the scratch memory of the instance, where both materials are printed, each
 * in its place; false if there is no memory. */
bool add_region(Instance *instance, LayerStep *step);

#endif
