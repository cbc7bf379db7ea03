/* Estimates the surface after scans with one thread and with four: the same bits. The scans are in register, displaced,
 * and late. Prints what differs and ends with 1.
 * Built with -fsanitize=thread, it reports races between the rows too. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "counter_random.h"
#include "layer_surface.h"
#include "observer.h"

/* Cells enough for four threads, in rows that no block ends with. */
enum { ROWS = 450, COLUMNS = 447, CELLS = ROWS * COLUMNS, LAYERS = 3 };

static SurfaceEstimate estimates[2][LAYERS + 1]; /* by threads and layer */
static double target[CELLS], surface[CELLS], after[CELLS], volume[CELLS], scan[CELLS];
static uint8_t part[CELLS], valid[CELLS];
static int32_t pattern[CELLS];

/* The scan of the surface, with noise and holes. */
static void take_scan(uint64_t key) {
    for (size_t cell = 0; cell < CELLS; cell++) {
        valid[cell] = random_unit(key, cell) < 0.98;
        scan[cell] = valid[cell] ? surface[cell] + 1e-6 * (random_unit(key + 1, cell) - 0.5) : 0.0;
    }
}

static void print_layer(const JettedLayer *layer, const Ink ink[2], uint64_t key) {
    for (size_t cell = 0; cell < CELLS; cell++) {
        const double drawn = random_unit(key, cell);
        pattern[cell] = part[cell] && drawn < 0.8 ? (drawn < 0.5 ? 1 : 2) : 0;
        volume[cell] = 1.0 - 0.2 * random_unit(key + 1, cell);
    }
    JettedLayer real = *layer;
    real.factor = volume;
    layer_surface(&real, surface, ink, NULL, after);
    memcpy(surface, after, sizeof surface);
}

static const char *difference(const SurfaceEstimate *one, const SurfaceEstimate *four) {
    if (memcmp(one->height, four->height, sizeof after) != 0)
        return "the heights";
    if (memcmp(one->variance, four->variance, sizeof after) != 0)
        return "their variances";
    if (memcmp(one->ledger, four->ledger, sizeof after) != 0)
        return "the ledger";
    if (memcmp(one->dead_evidence, four->dead_evidence, sizeof after) != 0)
        return "the evidence of dead cells";
    if (memcmp(one->known, four->known, sizeof *one->known) != 0)
        return "what is known";
    return memcmp(one->known, four->known, estimate_size(CELLS)) != 0 ? "another map" : NULL;
}

int main(void) {
    const EstimatorOptions options = {.nx = ROWS,
                                      .ny = COLUMNS,
                                      .part = part,
                                      .target = target,
                                      .ink = {2, {{4.4e-6, 0.6e-6, 0.2e-6}, {3.9e-6, 0.55e-6, 0.15e-6}}, INK_SCALE},
                                      .drop_levels = 1,
                                      .flat_ground = 1,
                                      .register_scans = 1,
                                      .unseen_layers = 5,
                                      .noise_variance = -1.0,
                                      .first_variance = 1e-11,
                                      .volume_least = 0.5,
                                      .volume_most = 1.25};
    static const int32_t order[1] = {0};
    JettedLayer layer = {ROWS, COLUMNS, pattern, NULL, 1, order, 1};
    for (size_t cell = 0; cell < CELLS; cell++) {
        const size_t i = cell / COLUMNS, j = cell % COLUMNS;
        part[cell] = i > 5 && j > 5 && i + 6 < ROWS && j + 6 < COLUMNS;
        target[cell] = part[cell] ? 1e-4 : 0.0;
    }
    for (size_t k = 0; k < 2; k++)
        for (size_t number = 0; number <= LAYERS; number++) {
            void *block = calloc(1, estimate_size(CELLS)); /* the system takes it back at the end */
            if (!block)
                return 1;
            estimates[k][number] = estimate_in(block, CELLS);
        }
    take_scan(1);
    for (size_t k = 0; k < 2; k++)
        if (!estimate_first(&options, 0, scan, valid, &estimates[k][0]))
            return 1;
    for (size_t number = 1; number <= LAYERS; number++) {
        layer.threads = 1;
        print_layer(&layer, options.ink.nominal, 10 * number);
        if (number < LAYERS) /* the last scan shows the layer before */
            take_scan(10 * number + 5);
        for (size_t k = 0; k < 2; k++) {
            Registration *registration = &estimates[k][number - 1].known->registration;
            registration->is_displaced = number == 2;
            registration->odds = number == 2 ? 1e3 : -3.0;
            registration->estimate[SPREAD] = number == 2 ? 0.5 : 0.0;
            layer.threads = k == 0 ? 1 : 4;
            if (!estimate_next(&options, &estimates[k][number - 1], &layer, (int32_t)number, false, scan, valid,
                               &estimates[k][number]))
                return 1;
        }
        const char *differs = difference(&estimates[0][number], &estimates[1][number]);
        if (differs) {
            printf("one thread and four, layer %zu: %s\n", number, differs);
            return 1;
        }
    }
    return 0;
}
