/* The kernels of the deposition models behind plain arrays, for inkloop_lab.models: one pass or one layer at a time, no
 * FMI, no state between calls, any number of threads. A grid is nx * ny cells in C order; heights in metres. Arrays of
 * the caller are complete and checked before the call. */
#ifndef INKLOOP_MODELS_H
#define INKLOOP_MODELS_H

#include "droplet_volume.h"
#include "far_neighbours.h"
#include "line_pass.h"
#include "propagation.h"
#include "spherical_cap.h"

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define INKLOOP_MODELS_API __declspec(dllexport)
#else
#define INKLOOP_MODELS_API __attribute__((visibility("default")))
#endif

enum { MODELS_INTERFACE = 2 }; /* counts up with every change of a signature or struct below */
enum { MODELS_NO_MEMORY = INT32_MIN };

/* MODELS_INTERFACE of the library: the caller can refuse one that was built for other sources. */
INKLOOP_MODELS_API int32_t inkloop_models_interface(void);

/* Volume of each cell's droplet in layer `layer` (from 1 on) as a share of the nominal one. */
INKLOOP_MODELS_API void inkloop_droplet_volumes(size_t nx, size_t ny, const VolumeVariation *how, int32_t layer,
                                                double *volumes);

/* Surface `after` one pass of the layer map on `before` over the cells of `colour` (-1: all); `volume` scales each
 * droplet. Returns the heights that left the grid. */
INKLOOP_MODELS_API double inkloop_layer_pass(size_t nx, size_t ny, const double *before, double *after,
                                             const int32_t *pattern, const FarInk ink[2], int32_t reach,
                                             const double *volume, int32_t colour);

/* One layer of spherical caps, of materials 1 and 2, on `height`; returns the heights that left the grid. The base
 * radii reach at most inkloop_cap_reach_max() cells. */
INKLOOP_MODELS_API double inkloop_caps(size_t nx, size_t ny, double *height, const int32_t *pattern,
                                       const SphericalCap cap[2], double pitch, const double *volume);
INKLOOP_MODELS_API int32_t inkloop_cap_reach_max(void);

/* Drops one after the other on `cells`, `volume` of each cell's drop. */
INKLOOP_MODELS_API void inkloop_cap_shares(double height_scale, double base_radius, double pitch, CapShares *shares);
INKLOOP_MODELS_API void inkloop_add_drops(const InkMap *map, const DropModel *drop, const size_t *cells, size_t count,
                                          const double *volume);

/* Base radius of a droplet on level ground, and the fine surface of a grid: its size with the rim, from and to cells.
 */
INKLOOP_MODELS_API double inkloop_base_radius(double volume, double contact_angle);
INKLOOP_MODELS_API void inkloop_fine_size(const FineSurface *surface, size_t *columns, size_t *rows, size_t *rim);
INKLOOP_MODELS_API void inkloop_spread_cells(const FineSurface *surface, const double *cells);
INKLOOP_MODELS_API void inkloop_mean_cells(const FineSurface *surface, double *cells);

/* One pass over the lines `line`, `line` + `every`, ...; the bodies that fell back to the linear form, or
 * MODELS_NO_MEMORY. `lost`: volume beyond the grid [m3]. */
INKLOOP_MODELS_API int32_t inkloop_print_lines(const FineSurface *surface, const Liquid *liquid, const double *drops,
                                               size_t line, size_t every, double *lost);

#endif
