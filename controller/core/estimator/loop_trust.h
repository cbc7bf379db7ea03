/* What makes a print doubtful although it continues: what was seen, and whether that is beyond chance. */
#ifndef INKLOOP_LOOP_TRUST_H
#define INKLOOP_LOOP_TRUST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "median.h"

/* Reasons why a status is untrusted, to be added up. */
enum {
    UNTRUSTED_UNSEEN = 1,    /* cells of the part have lived on prediction for too many layers */
    UNTRUSTED_BLIND = 2,     /* most of the part was not measured in the last scan */
    UNTRUSTED_GROUND = 4,    /* the first scan shows an offset or a tilt of ground that is called flat */
    UNTRUSTED_RESIDUALS = 8, /* scans differ from predictions by more than droplets and sensor explain */
    UNTRUSTED_INK = 16,      /* cells are capped, ink_limit.h */
    UNTRUSTED_HIGH = 32      /* cells stand higher than they are to, ink_limit.h */
};

typedef struct {
    double ground[3];    /* of the first scan on ground called flat: height of its middle, and its rise over the grid
                            along x and y [m] */
    double early;        /* mean square of the residuals until the part is half built, in variances [1] */
    double residual;     /* of all layers, recent ones more [1] */
    double volume;       /* of the droplets of the last layer, as a share of the learnt one [1] */
    double usual;        /* ... of layers over most of the part, as a share of the nominal one, recent ones more [1] */
    double blind_share;  /* of the part that the last scan did not measure */
    double excess;       /* of ink: the most that a cell is above its scan by its droplets [m] */
    double rise;         /* the most that a cell stands above its target and what its droplets explain [m] */
    int64_t excess_cell; /* where there is the most excess */
    int64_t rise_cell;   /* where there is the most rise */
    int64_t layers;      /* that count in the residuals */
    int64_t capped_cells;
    int32_t ground_wrong; /* the ground is not the flat one beyond doubt */
    int32_t unseen_cells; /* of the part that have lived on prediction for too many layers */
    int64_t high_cells;
    double spill; /* mean square of the residuals of cells that only neighbours' droplets reached, in variances, recent
                     layers more [1]; droplets that vary leave it near 1, a model of other droplets does not */
} LoopTrust;

LoopTrust full_trust(void);

/* The reasons, added up. */
int32_t untrusted_reasons(const LoopTrust *trust);

/* Compares a first scan of nx * ny cells [m] with flat ground of height 0. layer: height of a full layer [m]. */
void compare_ground(size_t nx, size_t ny, const double *scan, const uint8_t *valid, double layer, LoopTrust *trust);

/* The volume of a layer's droplets, as a share of the learnt one: the median of shares, what cells with a droplet of
 * `part_cells` grew by over what was expected. What a layer differs by as a whole is that volume, not an error; the
 * layer is counted with it where it covers most of the part, whatever a minority of cells reads, else with the usual
 * one. learnt: the learnt volume as a share of the nominal one; `room` holds a map, here and below. */
double learn_volume(const ValueLists *shares, size_t count, size_t part_cells, double learnt, double *room,
                    LoopTrust *trust);

/* Adds a layer to the residuals: `count` squares in variances, of cells with a droplet. False if they are too few to
 * show anything. is_early: the part was less than half built. */
bool add_residuals(const ValueLists *squares, size_t count, bool is_early, double *room, LoopTrust *trust);

/* The same of cells that only neighbours' droplets reached: squares [m^2], by the mean `variance` of all of them: that
 * of a cell that hardly anything should reach is no scale for what does. */
void add_spill(const ValueLists *squares, size_t count, double variance, double *room, LoopTrust *trust);

/* By how much droplets differ more from the model than they are taken to: a factor on their standard deviation, at
 * least 1. Layers up to half of the part show it: there every cell still lacks ink, whatever scans read at walls. */
double droplet_misfit(const LoopTrust *trust);

/* Whether droplets spill onto their neighbours in another way than the model's. Plans that look far ahead promise more
 * than such a plant keeps. */
bool is_plant_foreign(const LoopTrust *trust);

/* Standard deviation of a droplet's volume, as a share of it, where it was taken to be `assumed`: what the residuals of
 * the layers show, the recent ones more; where those until half of the part are more than droplets explain, what they
 * show. 0 before there are any. */
double droplet_deviation(const LoopTrust *trust, double assumed);

#endif
