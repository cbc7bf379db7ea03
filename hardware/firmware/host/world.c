#include "world.h"

#include "emulated_parameters.h"

#include <math.h>
#include <string.h>

enum { ALL_COLOURS = 255, GRIDS = 6 /* of doubles */ };
static const double NANOMETRE = 1e-9;

WorldOptions world_defaults(void) {
    WorldOptions options = {EMULATED_STARTS, .nx = 9,       .ny = 9,        .pass_ms = 50, .scan_ms = 50,
                            .home_ms = 20,   .move_ms = 20, .purge_ms = 20, .gate_ms = 5,  .watchdog_ms = 300};
    options.instrument.resolution = 0.1e-6; /* a resolution of 0, the FMU's start value, gives no step for a map */
    return options;
}

static size_t cells_of(const World *world) {
    return (size_t)world->options.nx * world->options.ny;
}

size_t world_size(const WorldOptions *options) {
    return (size_t)options->nx * options->ny * (GRIDS * sizeof(double) + sizeof(int32_t) + sizeof(bool));
}

void world_link(World *world, void *grids) {
    const size_t cells = cells_of(world);
    double *grid = grids, **const places[GRIDS] = {&world->height, &world->before, &world->factor,
                                                   &world->spot,   &world->lines,  &world->reading};
    for (size_t k = 0; k < GRIDS; k++)
        *places[k] = grids ? grid + k * cells : NULL;
    world->jetted = grids ? (int32_t *)(grid + GRIDS * cells) : NULL;
    world->valid = grids ? (bool *)(world->jetted + cells) : NULL;
}

void world_init(World *world, const WorldOptions *options, void *grids) {
    memset(world, 0, sizeof *world);
    world->options = *options;
    world_link(world, grids);
}

static bool gate_has_arrived(const World *world) {
    return world->now - world->gate_since >= world->options.gate_ms;
}

uint32_t world_lines(const World *world) {
    uint32_t lines = 0;
    const bool stays_open = world->broken & BROKEN_GATE_STAYS_OPEN;
    const bool stays_closed = world->broken & BROKEN_GATE_STAYS_CLOSED;
    if (stays_open || (world->gate_driven && gate_has_arrived(world) && !stays_closed))
        lines |= LINE_GATE_OPEN;
    if (stays_closed || (!world->gate_driven && gate_has_arrived(world) && !stays_open))
        lines |= LINE_GATE_CLOSED;
    const bool stays_off = world->broken & BROKEN_LAMP_STAYS_OFF;
    if ((world->lamp_driven && !stays_off) || world->broken & BROKEN_LAMP_STAYS_ON)
        lines |= LINE_LAMP_ON;
    if (!(world->broken & BROKEN_NOT_READY))
        lines |= LINE_READY;
    if (world->homed)
        lines |= LINE_HOMED;
    return lines;
}

static void note_violation(World *world) {
    const uint32_t gate = world_lines(world) & (LINE_GATE_CLOSED | LINE_GATE_OPEN);
    if (world->lamp_driven && gate != LINE_GATE_CLOSED)
        world->lamp_with_gate++;
}

void world_tick(World *world, uint32_t now) {
    world->now = now;
}

void world_set_gate(World *world, bool open) {
    if (open == world->gate_driven)
        return;
    world->gate_driven = open;
    world->gate_since = world->now;
    world->gate_openings += open ? 1 : 0;
    note_violation(world);
}

void world_set_lamp(World *world, bool on) {
    world->lamp_pulses += on && !world->lamp_driven ? 1 : 0;
    world->lamp_driven = on;
    note_violation(world);
}

void world_jet(World *world, const Work *work, double share) {
    const WorldOptions *options = &world->options;
    const size_t nx = options->nx, ny = options->ny, lines = (size_t)(share * (double)nx);
    const int colour = work->colour == ALL_COLOURS ? COLOUR_ALL : work->colour;
    for (size_t cell = 0; cell < cells_of(world); cell++) {
        const bool reached = cell / ny < lines;
        world->jetted[cell] = reached ? pattern_cell(work->pattern, (uint32_t)cell) : 0;
        if (world->jetted[cell] == 0 || (colour != COLOUR_ALL && colour != cell_colour(cell / ny, cell % ny)))
            continue;
        world->factor[cell] = droplet_volume(&options->variation, 1.0, ny, cell, work->layer);
        world->droplets++;
    }
    memcpy(world->before, world->height, cells_of(world) * sizeof *world->height);
    deposit_pass(world->before, world->height, nx, ny, world->jetted, options->ink, world->factor, colour);
}

/* Steps added to all readings: 0, unless the surface has grown beyond 16 bits. */
static double datum_of(const World *world) {
    const double step = world->options.instrument.resolution;
    double low = 0.0, high = 0.0;
    bool any = false;
    for (size_t cell = 0; cell < cells_of(world); cell++) {
        if (!world->valid[cell])
            continue;
        const double steps = rint(world->reading[cell] / step);
        low = any ? fmin(low, steps) : steps;
        high = any ? fmax(high, steps) : steps;
        any = true;
    }
    return low >= INT16_MIN && high <= INT16_MAX ? 0.0 : rint(0.5 * (low + high));
}

void world_scan(World *world) {
    const WorldOptions *options = &world->options;
    read_surface(&options->instrument, world->height, options->nx, options->ny, world->scans, world->spot, world->lines,
                 world->reading, world->valid);
    world->scans++;
    world->datum = datum_of(world);
}

MapShape world_map_shape(const World *world) {
    const double step = world->options.instrument.resolution;
    return (MapShape){.nx = world->options.nx,
                      .ny = world->options.ny,
                      .lsb_nm = (uint16_t)rint(step / NANOMETRE),
                      .datum = (int32_t)world->datum};
}

bool world_map_reading(const World *world, uint32_t cell, int16_t *reading) {
    if (!world->valid[cell])
        return false;
    const double steps = rint(world->reading[cell] / world->options.instrument.resolution) - world->datum;
    if (steps < INT16_MIN || steps > INT16_MAX)
        return false;
    *reading = (int16_t)steps;
    return true;
}
