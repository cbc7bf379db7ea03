#include "estimate_doubts.h"

#include <math.h>
#include <string.h>

#include "dead_cells.h"
#include "layer_surface.h"
#include "near_cells.h"
#include "row_ranges.h"

/* The limit of the ink by what is known of droplets. */
static InkLimit ink_limit(const EstimatorOptions *options, const SurfaceEstimate *estimate) {
    const double levels = options->drop_levels;
    double layer = 0.0, squares = 0.0, own = 0.0;
    for (size_t k = 0; k < options->ink.inks; k++) {
        const Ink ink = options->ink.nominal[k];
        layer = fmax(layer, full_layer_height(&ink));
        squares = fmax(squares, ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3));
        own = fmax(own, estimate->ink[k].h1);
    }
    return (InkLimit){.nx = options->nx,
                      .ny = options->ny,
                      .part = options->part,
                      .target = options->target,
                      .layer = levels * layer,
                      .droplet_std = levels * DROPLET_STD * droplet_misfit(&estimate->trust) * sqrt(squares),
                      .own = levels * own};
}

/* Cells of the part in the rows of a chunk; and the one that is the most above its scan by its droplets. */
typedef struct {
    size_t cells, blind, unseen, excess_cell;
    double excess; /* [m] */
} PartCells;

/* What the threads share. */
typedef struct {
    const EstimatorOptions *options;
    const SurfaceEstimate *estimate;
    const uint8_t *valid;
    PartCells part[CHUNKS];
} Look;

static INLINED void look_at_block(const Look *look, size_t first, size_t count, PartCells *part) {
    const uint8_t *is_part = look->options->part + first, *valid = look->valid + first;
    const double *reckoned = look->estimate->reckoned + first, *height = look->estimate->height + first;
    const int32_t *unseen = look->estimate->unseen + first, limit = look->options->unseen_layers;
    uint8_t counted[BLOCK], blind[BLOCK], is_unseen[BLOCK];
    double most = 0.0; /* of any cells: few blocks are looked at for that of the part */
    for (size_t k = 0; k < count; k++) {
        counted[k] = is_part[k] != 0;
        blind[k] = (is_part[k] != 0) & (valid[k] == 0);
        is_unseen[k] = (is_part[k] != 0) & (unseen[k] > limit);
    }
    for (size_t k = 0; k < count; k++) {
        const double excess = reckoned[k] - height[k];
        most = excess > most ? excess : most;
    }
    for (size_t k = 0; most > part->excess && k < count; k++)
        if (is_part[k] && reckoned[k] - height[k] > part->excess) {
            part->excess = reckoned[k] - height[k];
            part->excess_cell = first + k;
        }
    part->cells += count_marked(counted, count);
    part->blind += count_marked(blind, count);
    part->unseen += count_marked(is_unseen, count);
}

static INLINED void look_at_rows(void *context, const RowRange *range) {
    Look *look = context;
    const size_t nx = look->options->nx, ny = look->options->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t end = chunk_row(nx, chunk + 1) * ny;
        PartCells part = {0, 0, 0, 0, 0.0};
        for (size_t first = chunk_row(nx, chunk) * ny; first < end; first += BLOCK)
            look_at_block(look, first, end - first < BLOCK ? end - first : BLOCK, &part);
        look->part[chunk] = part;
    }
}

CLONED_ROW_WORK(look_at_range, look_at_rows)

void look_at_cells(const EstimatorOptions *options, const uint8_t *valid, size_t threads, SurfaceEstimate *estimate) {
    LoopTrust *trust = &estimate->trust;
    Look look = {.options = options, .estimate = estimate, .valid = valid};
    size_t part_cells = 0, blind = 0;
    trust->unseen_cells = 0;
    trust->excess = 0.0;
    trust->excess_cell = 0;
    run_rows(threads, options->nx, options->ny, look_at_range, &look);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        const PartCells *part = &look.part[chunk];
        part_cells += part->cells;
        blind += part->blind;
        trust->unseen_cells += (int32_t)part->unseen;
        if (part->excess > trust->excess) {
            trust->excess = part->excess;
            trust->excess_cell = (int64_t)part->excess_cell;
        }
    }
    trust->blind_share = part_cells > 0 ? (double)blind / (double)part_cells : 0.0;
    trust->capped_cells = trust->high_cells = trust->rise_cell = 0;
    trust->rise = 0.0;
    if (options->take_as_read) {
        memset(estimate->capped, 0, options->nx * options->ny);
        return;
    }
    const InkLimit limit = ink_limit(options, estimate);
    HighCells high;
    trust->capped_cells = (int64_t)mark_capped(&limit, estimate->height, estimate->reckoned, estimate->capped, &high);
    trust->high_cells = (int64_t)high.count;
    trust->rise = high.highest;
    trust->rise_cell = (int64_t)high.cell;
}

void begin_trust(const EstimatorOptions *options, int32_t layer, const double *measured, const uint8_t *valid,
                 SurfaceEstimate *estimate) {
    const size_t cells = options->nx * options->ny;
    const bool is_flat = options->flat_ground && layer == 0 && !options->take_as_read;
    for (size_t cell = 0; cell < cells; cell++)
        estimate->reckoned[cell] = is_flat ? 0.0 : estimate->height[cell];
    if (is_flat)
        compare_ground(options->nx, options->ny, measured, valid, full_layer_height(&options->ink.nominal[0]),
                       &estimate->trust);
    look_at_cells(options, valid, 1, estimate);
}

static bool revives(const SurfaceEstimate *before, const SurfaceEstimate *after, size_t cell) {
    return before->dead_evidence[cell] >= DEAD_EVIDENCE && after->dead_evidence[cell] < DEAD_EVIDENCE;
}

void forgive_dead(const EstimatorOptions *options, const SurfaceEstimate *before, uint8_t *marks,
                  SurfaceEstimate *after) {
    const size_t nx = options->nx, ny = options->ny, cells = nx * ny;
    uint8_t *outside = marks, *inside = marks + cells;
    for (size_t cell = 0; cell < cells; cell++)
        outside[cell] = !options->part[cell];
    for (size_t cell = 0; cell < cells; cell++)
        inside[cell] = revives(before, after, cell) && !is_near_marked(outside, nx, ny, cell);
    for (size_t added = 1; added > 0;) {
        added = 0;
        for (size_t cell = 0; cell < cells; cell++)
            if (!inside[cell] && revives(before, after, cell) && is_near_marked(inside, nx, ny, cell)) {
                inside[cell] = 1;
                added++;
            }
    }
    for (size_t cell = 0; cell < cells; cell++)
        if (inside[cell])
            after->reckoned[cell] = after->height[cell];
}
