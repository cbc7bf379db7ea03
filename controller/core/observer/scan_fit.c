#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "median.h"

/* two standard deviations: the droplets do not follow the model (assumed) */
static const double FOREIGN_MISFIT = 4.0;

void slope_squares(size_t nx, size_t ny, const double *height, double *squares) {
    for (size_t i = 0; i < nx; i++) {
        const double *here = height + i * ny, *up = i > 0 ? here - ny : here, *down = i + 1 < nx ? here + ny : here;
        double *restrict into = squares + i * ny;
        for (size_t j = 0; j < ny; j += ny > 1 ? ny - 1 : 1) { /* the ends of the row */
            const double along_x = 0.5 * (down[j] - up[j]);
            const double along_y = 0.5 * (here[j + 1 < ny ? j + 1 : j] - here[j > 0 ? j - 1 : j]);
            into[j] = along_x * along_x + along_y * along_y;
        }
        for (size_t j = 1; j + 1 < ny; j++) {
            const double along_x = 0.5 * (down[j] - up[j]), along_y = 0.5 * (here[j + 1] - here[j - 1]);
            into[j] = along_x * along_x + along_y * along_y;
        }
    }
}

ShareColumn share_column(const ScanEvidence *evidence, size_t share) {
    const InkPrior *prior = &evidence->options->ink;
    const size_t cells = evidence->options->nx * evidence->options->ny;
    const double factor = prior->model == INK_FULL ? ink_height(&prior->nominal[share / ORDERS], share % ORDERS) : 1.0;
    return (ShareColumn){evidence->increments->adds + share * cells, factor};
}

double share_change(const ScanEvidence *evidence, const double share[], size_t cell) {
    double change = 0.0;
    for (size_t k = 0; k < ink_shares(&evidence->options->ink); k++) {
        const ShareColumn column = share_column(evidence, k);
        change += (share[k] - evidence->known->share[k]) * column.factor * column.map[cell];
    }
    return change;
}

void average_prediction(const ScanEvidence *evidence, const double share[], double spread, FitRoom *room) {
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    double *predicted = room->lists[1];
    for (size_t cell = 0; cell < nx * ny; cell++)
        predicted[cell] = evidence->predicted[cell] + share_change(evidence, share, cell);
    average_under_spot(nx, ny, predicted, spread, room->lists[0], room->averaged, room->spread_slope);
}

/* Memory shared by the threads for misfits: lists of squares by class, and sums over cells with a droplet. */
typedef struct {
    const ScanEvidence *evidence;
    const InkFit *fit;
    const FitRoom *room;
    size_t shares;
    ValueLists lists[CLASSES];
    double base[CHUNKS], droplets[CHUNKS]; /* [m^2] */
} MisfitWork;

/* Appends the chosen values; returns the end. No branch depends on a cell. */
static INLINED double *append(const double *values, const uint8_t *chosen, size_t count, double *end) {
    for (size_t k = 0; k < count; k++) {
        *end = values[k];
        end += chosen[k];
    }
    return end;
}

static INLINED void misfit_cells(MisfitWork *work, size_t chunk, const double row[ROW_TERMS], size_t first,
                                 size_t column, size_t count, double *ends[CLASSES]) {
    const ScanEvidence *evidence = work->evidence;
    const double *variance = evidence->variance + first, *squares = evidence->increments->squares + first;
    const double *scan = evidence->scan + first, *predicted = evidence->predicted + first;
    const int32_t *pattern = evidence->layer->pattern + first;
    const uint8_t *valid = evidence->valid + first;
    uint8_t chosen[CLASSES][BLOCK];
    double rest[BLOCK], w[BLOCK], square[BLOCK], base[BLOCK], droplets[BLOCK];
    places_in_row(evidence->options->ny, column, count, w);
    for (size_t k = 0; k < count; k++)
        rest[k] = scan[k] - predicted[k];
    for (size_t s = 0; s < work->shares; s++) {
        const ShareColumn of = share_column(evidence, s);
        const double change = work->fit->share[s] - evidence->known->share[s];
        for (size_t k = 0; k < count; k++)
            rest[k] -= change * (of.factor * of.map[first + k]);
    }
    for (size_t k = 0; k < count; k++) {
        const double left = rest[k] - datum_in_row(row, w[k]);
        base[k] = evidence->noise_variance + variance[k];
        square[k] = left * left / (base[k] + evidence->droplet_variance * squares[k]);
    }
    for (size_t k = 0; k < count; k++) {
        const uint8_t reached = (valid[k] != 0) & (squares[k] > 0.0), own = pattern[k] > 0;
        chosen[OWN][k] = reached & own;
        chosen[SPILL][k] = reached & !own;
    }
    for (size_t k = 0; k < count; k++) {
        base[k] = chosen[OWN][k] ? base[k] : 0.0;
        droplets[k] = chosen[OWN][k] ? squares[k] : 0.0;
    }
    work->base[chunk] += lane_sum(base, count);
    work->droplets[chunk] += lane_sum(droplets, count);
    for (size_t class = 0; class < CLASSES; class++)
        ends[class] = append(square, chosen[class], count, ends[class]);
}

static INLINED void misfit_rows(void *context, const RowRange *range) {
    MisfitWork *work = context;
    const size_t nx = work->evidence->options->nx, ny = work->evidence->options->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(nx, chunk) * ny;
        double *ends[CLASSES] = {work->room->lists[OWN] + begin, work->room->lists[SPILL] + begin};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++) {
            double row[ROW_TERMS];
            datum_of_row(work->fit->datum, place_on(i, nx), row);
            for (size_t column = 0; column < ny; column += BLOCK) {
                const size_t count = ny - column < BLOCK ? ny - column : BLOCK;
                misfit_cells(work, chunk, row, i * ny + column, column, count, ends);
            }
        }
        for (size_t class = 0; class < CLASSES; class++)
            work->lists[class].lengths[chunk] = (size_t)(ends[class] - (work->room->lists[class] + begin));
    }
}

CLONED_ROW_WORK(misfit_range, misfit_rows)

void take_misfits(const ScanEvidence *evidence, FitRoom *room, InkFit *fit) {
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    MisfitWork work = {.evidence = evidence, .fit = fit, .room = room, .shares = learnt_shares(evidence->options)};
    size_t counts[CLASSES] = {0, 0};
    double base = 0.0, droplets = 0.0;
    for (size_t class = 0; class < CLASSES; class++)
        work.lists[class] = (ValueLists){.nx = nx, .ny = ny, .map = room->lists[class]};
    run_rows(evidence->layer->threads, nx, ny, misfit_range, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        for (size_t class = 0; class < CLASSES; class++)
            counts[class] += work.lists[class].lengths[chunk];
        base += work.base[chunk];
        droplets += work.droplets[chunk];
    }
    fit->droplets = counts[OWN];
    fit->mean_base = counts[OWN] > 0 ? base / (double)counts[OWN] : 0.0;
    fit->mean_droplets = counts[OWN] > 0 ? droplets / (double)counts[OWN] : 0.0;
    for (size_t class = 0; class < CLASSES; class++)
        fit->misfit[class] = counts[class] < LEAST_READINGS
                                 ? 1.0
                                 : median_of_lists(&work.lists[class], room->spread_slope) / MEDIAN_SQUARE;
}

bool is_foreign(double misfit) {
    return misfit >= FOREIGN_MISFIT;
}

bool is_misfit(const InkFit *fit) {
    return is_foreign(fmax(fit->misfit[OWN], fit->misfit[SPILL]));
}
