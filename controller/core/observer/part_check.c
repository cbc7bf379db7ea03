/* Counts of the part's cells, and the cells that get no more ink.
 *
 * The ledger needs no scan: with the least credible volume of a droplet it gives a lower bound of each height. A cell
 * whose bound is a layer above its target gets no more ink. Nor do the neighbours of a cell that is higher than its
 * droplets explain: their droplets flow to it. */
#include "scan_fit.h"

/* layers above the target, by the ledger, from which a cell is capped (assumed) */
static const double RESERVE = 1.0;
/* layers above target and ledger that count as high; droplets that vary by 40 % reach 0.3 (assumed) */
static const double HIGH = 0.4;
static const double HIGH_FOREIGN = 0.25; /* the same for droplets that spill unlike the model's (assumed) */
/* layers above target and ledger from which the neighbours are capped: their droplets flow to the cell (assumed) */
static const double RISEN = 0.9;
static const double UNSURE = 0.3; /* standard deviation of an unknown height, in layers (assumed) */
static const double BLIND = 0.5;  /* share of the part without readings that counts as blind (assumed) */

/* Caps a cell and its neighbours in the part. */
static void cap_near(const EstimatorOptions *options, size_t cell, uint8_t *capped) {
    const size_t ny = options->ny, i = cell / ny, j = cell % ny;
    for (size_t row = i > 0 ? i - 1 : 0; row <= i + 1 && row < options->nx; row++)
        for (size_t column = j > 0 ? j - 1 : 0; column <= j + 1 && column < ny; column++)
            capped[row * ny + column] |= options->part[row * ny + column] != 0;
}

/* Layer and volume of the droplets [m, 1], and height above which a cell is high [m]. */
typedef struct {
    double layer, volume, high;
} PartLimits;

static PartLimits part_limits(const ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    const Knowledge *known = evidence->after->known;
    const double layer = layer_of(options) * options->drop_levels;
    return (PartLimits){layer, learnt_volume(options, known),
                        (is_spill_foreign(&known->trust) ? HIGH_FOREIGN : HIGH) * layer};
}

/* Height of a cell above its target and above its droplets [m]. */
static double rise_of(const ScanEvidence *evidence, double volume, size_t cell) {
    const double target = evidence->options->target[cell], by_droplets = volume * evidence->after->ledger[cell];
    return evidence->after->height[cell] - (target > by_droplets ? target : by_droplets);
}

static void take_largest(CellSums *sums, size_t which, double value, size_t cell) {
    if (value > sums->largest[which]) {
        sums->largest[which] = value;
        sums->at[which] = cell;
    }
}

/* Counts of the part's cells, and largest heights. */
enum { PART, BLIND_CELLS, UNSEEN_CELLS, CAPPED_CELLS, HIGH_CELLS, RISEN_CELLS, EXCESS = 0, RISE };

static void look_at_rows(void *context, const RowRange *range) {
    const ScanEvidence *evidence = context;
    const EstimatorOptions *options = evidence->options;
    const SurfaceEstimate *after = evidence->after;
    const PartLimits limits = part_limits(evidence);
    const double unsure = UNSURE * UNSURE * limits.layer * limits.layer;
    CellSums sums = {.count = {0}};
    for (size_t cell = range->top * evidence->ny; cell < range->bottom * evidence->ny; cell++) {
        after->capped[cell] = 0;
        if (!options->part[cell])
            continue;
        sums.count[PART]++;
        sums.count[BLIND_CELLS] += !evidence->valid[cell];
        sums.count[UNSEEN_CELLS] += after->unseen[cell] > options->unseen_layers && after->variance[cell] > unsure;
        take_largest(&sums, EXCESS, limits.volume * after->ledger[cell] - after->height[cell], cell);
        if (options->take_as_read)
            continue;
        const double full = options->target[cell] + RESERVE * limits.layer,
                     rise = rise_of(evidence, limits.volume, cell);
        after->capped[cell] = options->volume_least * after->ledger[cell] > full;
        sums.count[CAPPED_CELLS] += after->capped[cell];
        sums.count[HIGH_CELLS] += rise > limits.high;
        sums.count[RISEN_CELLS] += rise > RISEN * limits.layer;
        take_largest(&sums, RISE, rise, cell);
    }
    evidence->sums[range->chunk] = sums;
}

void look_at_part(const ScanEvidence *evidence) {
    const EstimatorOptions *options = evidence->options;
    const PartLimits limits = part_limits(evidence);
    LoopTrust *trust = &evidence->after->known->trust;
    const CellSums sums = over_rows(evidence, look_at_rows, evidence);
    const size_t *count = sums.count;
    for (size_t cell = 0; count[RISEN_CELLS] > 0 && cell < evidence->cells; cell++)
        if (options->part[cell] && rise_of(evidence, limits.volume, cell) > RISEN * limits.layer)
            cap_near(options, cell, evidence->after->capped);
    trust->unseen_cells = (int64_t)count[UNSEEN_CELLS];
    trust->capped_cells = (int64_t)count[CAPPED_CELLS];
    trust->high_cells = (int64_t)count[HIGH_CELLS];
    trust->excess = sums.largest[EXCESS];
    trust->rise = sums.largest[RISE];
    trust->excess_cell = (int64_t)sums.at[EXCESS];
    trust->rise_cell = (int64_t)sums.at[RISE];
    trust->blind_share = count[PART] > 0 ? (double)count[BLIND_CELLS] / (double)count[PART] : 0.0;
    trust->blind_layers = trust->blind_share > BLIND ? trust->blind_layers + 1 : 0;
}
