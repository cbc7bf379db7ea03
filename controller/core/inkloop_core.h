/* Entry points of the search core. All are pure: arrays in, arrays out, no state between calls, any number of threads.
 * A grid is nx * ny cells in C order; heights in metres. Arrays of the caller are complete and checked before the call.
 */
#ifndef INKLOOP_CORE_H
#define INKLOOP_CORE_H

#include <stddef.h>
#include <stdint.h>

#include "horizon_planner.h"
#include "horizon_problem.h"
#include "layer_step.h"
#include "shortest_plan.h"
#include "step_problem.h"

#if defined(_WIN32)
#define INKLOOP_CORE_API __declspec(dllexport)
#else
#define INKLOOP_CORE_API __attribute__((visibility("default")))
#endif

enum { CORE_INTERFACE = 19 }; /* counts up with every change of a signature or struct below */

/* CORE_INTERFACE of the library: the caller can refuse one that was built for other sources. */
INKLOOP_CORE_API int32_t inkloop_core_interface(void);

/* Surface after one layer of `passes` (1, or 4 in the colours `order`, each on the surface that the last one left).
 * `factor` scales each cell's droplet, NULL: all 1. `scratch` and `after` hold nx * ny; returns the height that left
 * the grid [m]. */
INKLOOP_CORE_API double inkloop_layer(size_t nx, size_t ny, const double *height, const int32_t *pattern,
                                      const Ink ink[2], const double *factor, int32_t passes, const int32_t order[4],
                                      double *scratch, double *after);

/* Objective of a plan (layers * nx * ny). CORE_DONE or CORE_NO_MEMORY. */
INKLOOP_CORE_API int32_t inkloop_objective(const HorizonProblem *problem, const int32_t *plan, Objective *value);

/* For tests and benchmarks. Improves `plan` (in: start, out: the best found) by annealing, if requested, then by the
 * requested moves until none helps (CORE_DONE), or until CORE_BUDGET, CORE_TIME or CORE_STOPPED. It never ends worse
 * than it began. The same input gives the same bits, on any number of threads, unless the clock ends it. */
INKLOOP_CORE_API int32_t inkloop_search(const HorizonProblem *problem, const SearchOptions *options, int32_t *plan,
                                        SearchReport *report);

/* The stochastic greedy search of Lu, Zheng, Mishra (2015, IV-C) with random batches of at most `batch` flips, for
 * problems with at most one choice on each cell. */
INKLOOP_CORE_API int32_t inkloop_paper_search(const HorizonProblem *problem, int32_t *plan, int64_t batch,
                                              int64_t iterations_max, uint64_t seed, SearchReport *report);

/* For tests. Moves relaxed `droplets` (layers * nx * ny, relaxed_surface.h; in: start, out: not worse) against the
 * gradient of the smoothed objective. CORE_DONE, CORE_TIME or CORE_NO_MEMORY. */
INKLOOP_CORE_API int32_t inkloop_relax(const HorizonProblem *problem, const RelaxationOptions *options,
                                       double *droplets, RelaxationReport *report);

/* Rounds relaxed droplets to a plan (error_diffusion.h). CORE_DONE or CORE_NO_MEMORY. */
INKLOOP_CORE_API int32_t inkloop_diffuse(const HorizonProblem *problem, const double *droplets, int32_t *plan);

/* The horizons and the worth of a layer for a FINISH_.... */
INKLOOP_CORE_API void inkloop_finish(int32_t finish, Finish *chosen);

/* Number of the variables that a LayerStep points to, in the order of variables.toml. */
INKLOOP_CORE_API size_t inkloop_variables(void);

/* Size in bytes of an estimate in one block: knowledge, then the maps in the order of SurfaceEstimate; and of the
 * knowledge alone. */
INKLOOP_CORE_API size_t inkloop_estimate_size(size_t cells);
INKLOOP_CORE_API size_t inkloop_knowledge_size(void);

/* The estimate after the first scan, and after each one that follows a layer (observer.h), in blocks. pattern, factor:
 * see JettedLayer. CORE_DONE, CORE_NO_MEMORY, or CORE_NO_SCAN: the first scan has too few readings. */
INKLOOP_CORE_API int32_t inkloop_estimate_first(const LayerStep *step, int32_t layer, const double *measured,
                                                const uint8_t *valid, void *estimate);
INKLOOP_CORE_API int32_t inkloop_estimate_next(const LayerStep *step, const void *before, const int32_t *pattern,
                                               const double *factor, int32_t number, int32_t is_unknown,
                                               const double *measured, const uint8_t *valid, void *after);

/* Figures of an estimate: those reported, those that a plan needs besides the surface, and the cells that count as
 * dead. */
INKLOOP_CORE_API void inkloop_estimate_figures(const LayerStep *step, void *estimate, EstimateFigures *figures,
                                               uint8_t *dead);

/* Clears the distrust after a person has looked: the print resumes, and the next scan is accepted unchecked. */
INKLOOP_CORE_API void inkloop_trust_again(void *estimate, size_t cells);

/* The state of a controller and its step (step_state.h, layer_step.h, step_outputs.h). The head comes first in a
 * state. */
INKLOOP_CORE_API size_t inkloop_state_head_size(void);
INKLOOP_CORE_API size_t inkloop_state_size(size_t cells, size_t layers);
INKLOOP_CORE_API size_t inkloop_state_layers(const LayerStep *step, const void *state, size_t size);
INKLOOP_CORE_API void inkloop_state_start(const LayerStep *step, size_t layers, int32_t layers_printed, void *state);
INKLOOP_CORE_API void inkloop_state_plan(const void *state, PlanFigures *figures);
INKLOOP_CORE_API int32_t inkloop_step_is_due(const LayerStep *step, const void *state);
INKLOOP_CORE_API int32_t inkloop_step_begin(const LayerStep *step, const void *before, void *after);
INKLOOP_CORE_API void inkloop_step_take(const LayerStep *step, const void *before, const int32_t *plan, size_t layers,
                                        const PlanFigures *figures, void *after);
INKLOOP_CORE_API void inkloop_step_outputs(const LayerStep *step, const void *state);

/* The problem of the layers after layer number `layer` (step_problem.h), and the best plan found for it, of no
 * more layers than are worth it (shortest_plan.h), with the work that the options allow. relaxation: RELAX_... with
 * `relaxed`; last: the plan before, NULL: none; seconds_max: guard by the clock; device: NULL, or what repairs plans.
 * CORE_DONE, CORE_NO_MEMORY or CORE_NO_DEVICE. */
INKLOOP_CORE_API void inkloop_layer_problem(const LayerStep *step, const SurfaceToPlan *surface, int32_t layer,
                                            const ProblemMaps *maps, HorizonProblem *problem);
INKLOOP_CORE_API int32_t inkloop_plan(const LayerStep *step, int32_t layer, const HorizonProblem *problem,
                                      int32_t relaxation, const double *relaxed, const int32_t *last,
                                      size_t last_layers, double seconds_max, DeviceSearch *device,
                                      AfterSweep *after_sweep, int32_t *plan, PlanReport *report);

/* Pattern and drops of a layer of a plan, as they are printed. */
INKLOOP_CORE_API void inkloop_pattern(const int32_t *layer, size_t cells, int32_t inks, int32_t *pattern,
                                      int32_t *drop_level);

#endif
