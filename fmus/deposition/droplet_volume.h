/* Random deviation of droplet volumes from the nominal one; the random numbers depend on the place of a droplet
 * alone. */
#ifndef INKLOOP_DROPLET_VOLUME_H
#define INKLOOP_DROPLET_VOLUME_H

#include <stddef.h>
#include <stdint.h>

typedef enum { PER_DROPLET = 1, PER_CELL, PER_LAYER, PER_CELL_AND_LAYER } VariationKind;

typedef struct {
    double variation; /* amplitude p of the factor 1 - U[0, p] */
    VariationKind kind;
    double nozzle_variation; /* amplitude of the factor of a nozzle */
    int32_t nozzle_pitch;    /* cell (i, j) is jetted by nozzle j modulo this */
    int32_t seed;
} VolumeVariation;

/* `nominal`, times the factor of the droplet's kind, times the factor of its nozzle; lines are `ny` cells long. */
double droplet_volume(const VolumeVariation *how, double nominal, size_t ny, size_t cell, int32_t layer);

#endif
