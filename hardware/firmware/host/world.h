/* The printer below the emulated nodes: a substrate, droplets, a gate, a lamp, a stage and a profile sensor.
 *
 * Surface and readings are those of the FMUs LayerDeposition and ProfileSensor, from the same kernels. Not modelled:
 * heat, cure dose, ink that is still wet, a stage that loses steps; a pass that is interrupted has printed the lines
 * along x that its share of the time reached. */
#ifndef INKLOOP_WORLD_H
#define INKLOOP_WORLD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "droplet_volume.h"
#include "hal.h"
#include "layer_map.h"
#include "reading.h"

enum { /* defects, one bit each; a gate that stays open and closed has end switches that contradict each other */
       BROKEN_GATE_STAYS_OPEN = 1,
       BROKEN_GATE_STAYS_CLOSED = 2,
       BROKEN_LAMP_STAYS_ON = 4,
       BROKEN_NOT_READY = 8,
       BROKEN_WORK_FAILS = 16,
       BROKEN_WORK_HANGS = 32,
       BROKEN_STORAGE_FULL = 64, /* results of a step cannot be stored */
       BROKEN_LAMP_STAYS_OFF = 128
};

typedef struct {
    uint16_t nx, ny;
    Ink ink[2];
    VolumeVariation variation;
    Instrument instrument; /* resolution > 0: one step of a reading, a whole number of nanometres */
    uint32_t pass_ms, scan_ms, home_ms, move_ms, purge_ms, gate_ms;
    uint32_t watchdog_ms; /* period of the hardware watchdog of each node; 0: none */
} WorldOptions;

typedef struct {
    WorldOptions options;
    double *height; /* (nx, ny) [m], the surface as it is */
    double *before, *factor, *spot, *lines, *reading;
    int32_t *jetted;
    bool *valid;
    double datum;  /* steps to add to every reading of the last scan */
    int32_t scans; /* number of finished scans */
    uint64_t droplets;
    uint32_t now, broken;
    bool gate_driven, lamp_driven, homed;
    uint32_t gate_since;
    uint32_t gate_openings, lamp_pulses;
    uint32_t lamp_with_gate; /* ticks in which the lamp was on and the gate not closed: must stay 0 */
} World;

/* The start values of the FMUs, but a sensor with steps of 0.1 um; 9 x 9 cells, short mechanical times. */
WorldOptions world_defaults(void);

/* Bytes of the grids of a world. */
size_t world_size(const WorldOptions *options);

/* A world over `grids`, memory of the caller of that size, zeroed and aligned for doubles. */
void world_init(World *world, const WorldOptions *options, void *grids);

/* Points a world at its grids, wherever they are now; NULL: at nothing, to be kept or moved as bytes. */
void world_link(World *world, void *grids);

void world_tick(World *world, uint32_t now);

uint32_t world_lines(const World *world);
void world_set_gate(World *world, bool open);
void world_set_lamp(World *world, bool on);

/* Prints a share (0 to 1) of a pass, on its first lines. */
void world_jet(World *world, const Work *work, double share);
void world_scan(World *world);

MapShape world_map_shape(const World *world);
bool world_map_reading(const World *world, uint32_t cell, int16_t *reading);

#endif
