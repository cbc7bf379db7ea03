#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "median.h"
#include "small_algebra.h"

static const double FOREIGN_MISFIT = 4.0; /* two standard deviations: no droplet of the model's (assumed) */
static const double SHARE_STEP = 0.007, FULL_STEP = 0.014; /* of a share from layer to layer (assumed) */
static const double LEAST_SHARE = 0.3, LARGEST_SHARE = 2.0;

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

/* Precision of the shares before the scan. */
static bool share_prior(const ScanEvidence *evidence, double *precision) {
    const size_t n = ink_shares(&evidence->options->ink);
    const double step = evidence->options->ink.model == INK_FULL ? FULL_STEP : SHARE_STEP;
    double covariance[SHARES_MAX * SHARES_MAX];
    memcpy(covariance, evidence->known->share_covariance, n * n * sizeof *covariance);
    for (size_t k = 0; k < n; k++)
        covariance[k * n + k] += step * step;
    return invert_definite(n, covariance, precision);
}

enum { BLOCK = 64, POWERS = 5 };

/* Sums of a row: of the weights with powers of w; of the rest and of each column of a share with them, weighted; and of
 * products of these. */
typedef struct {
    double of_one[POWERS], of_rest[ROW_TERMS], of_share[SHARES_MAX][ROW_TERMS];
    double rest_share[SHARES_MAX], share_share[SHARES_MAX * SHARES_MAX];
} RowMoments;

/* Some cells of a row: columns of shares, what is left of their readings, and its weight. */
typedef struct {
    double weight[BLOCK], rest[BLOCK], share[SHARES_MAX][BLOCK], w[BLOCK];
} FitCells;

static INLINED void load_cells(const ScanEvidence *evidence, size_t shares, const uint8_t *left_out,
                               const double larger[CLASSES], size_t first, size_t column, size_t count,
                               FitCells *restrict cells) {
    const double *scan = evidence->scan + first, *predicted = evidence->predicted + first;
    const double *variance = evidence->variance + first, *squares = evidence->increments->squares + first;
    const double noise = evidence->noise_variance, droplets = evidence->droplet_variance;
    const int32_t *pattern = evidence->layer->pattern + first;
    const uint8_t *valid = evidence->valid + first;
    const double step = evidence->options->ny > 1 ? 2.0 / ((double)evidence->options->ny - 1.0) : 0.0;
    for (size_t k = 0; k < count; k++) {
        const double rest = scan[k] - predicted[k], native = noise + variance[k] + droplets * squares[k];
        const double wide = (pattern[k] > 0 ? larger[OWN] : larger[SPILL]) * native;
        const double weight = (NU + 1.0) / (NU * wide + rest * rest);
        const bool counts = (valid[k] != 0) & (squares[k] > 0.0);
        cells->rest[k] = rest;
        cells->weight[k] = counts ? weight : 0.0;
        cells->w[k] = step > 0.0 ? step * (double)(int32_t)(column + k) - 1.0 : 0.0;
    }
    for (size_t k = 0; left_out && k < count; k++)
        cells->weight[k] = left_out[first + k] ? 0.0 : cells->weight[k];
    for (size_t s = 0; s < shares; s++) {
        const ShareColumn of = share_column(evidence, s);
        for (size_t k = 0; k < count; k++)
            cells->share[s][k] = of.factor * of.map[first + k];
    }
}

/* Adds sums of `line` with powers of w, weighted already. */
static INLINED void add_powers(const double *line, const double *w, size_t count, size_t powers, double *sums) {
    double power[BLOCK];
    memcpy(power, line, count * sizeof *line);
    for (size_t p = 0; p < powers; p++) {
        sums[p] += lane_sum(power, count);
        for (size_t k = 0; p + 1 < powers && k < count; k++)
            power[k] *= w[k];
    }
}

static INLINED void add_moments(const FitCells *cells, size_t shares, size_t count, RowMoments *row) {
    double line[BLOCK];
    add_powers(cells->weight, cells->w, count, POWERS, row->of_one);
    for (size_t k = 0; k < count; k++)
        line[k] = cells->weight[k] * cells->rest[k];
    add_powers(line, cells->w, count, ROW_TERMS, row->of_rest);
    for (size_t s = 0; s < shares; s++) {
        for (size_t k = 0; k < count; k++)
            line[k] = cells->weight[k] * cells->share[s][k];
        add_powers(line, cells->w, count, ROW_TERMS, row->of_share[s]);
        row->rest_share[s] += lane_dot(line, cells->rest, count);
        for (size_t t = 0; t <= s; t++)
            row->share_share[s * SHARES_MAX + t] += lane_dot(line, cells->share[t], count);
    }
}

/* The moments of a row in the normal equations; u: its place. */
static void add_row(const RowMoments *row, double u, size_t shares, SmoothSums *sums) {
    static const size_t POWER[DATUM_TERMS] = {0, 0, 1, 0, 1, 2};
    const double factor[DATUM_TERMS] = {1.0, u, 1.0, u * u, u, 1.0};
    const size_t n = DATUM_TERMS + shares;
    for (size_t a = 0; a < DATUM_TERMS; a++) {
        sums->side[a] += factor[a] * row->of_rest[POWER[a]];
        for (size_t b = 0; b <= a; b++)
            sums->matrix[a * n + b] += factor[a] * factor[b] * row->of_one[POWER[a] + POWER[b]];
    }
    for (size_t s = 0; s < shares; s++) {
        const size_t a = DATUM_TERMS + s;
        sums->side[a] += row->rest_share[s];
        for (size_t b = 0; b < DATUM_TERMS; b++)
            sums->matrix[a * n + b] += factor[b] * row->of_share[s][POWER[b]];
        for (size_t t = 0; t <= s; t++)
            sums->matrix[a * n + DATUM_TERMS + t] += row->share_share[s * SHARES_MAX + t];
    }
}

/* What the threads share that add up the normal equations. */
typedef struct {
    const ScanEvidence *evidence;
    size_t shares;
    const uint8_t *left_out;
    double larger[CLASSES];
    SmoothSums sums[CHUNKS];
} SmoothWork;

static INLINED void smooth_rows(void *context, const RowRange *range) {
    SmoothWork *work = context;
    const size_t nx = work->evidence->options->nx, ny = work->evidence->options->ny;
    FitCells cells;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        SmoothSums sums = {{0.0}, {0.0}};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++) {
            RowMoments row = {{0.0}, {0.0}, {{0.0}}, {0.0}, {0.0}};
            for (size_t column = 0; column < ny; column += BLOCK) {
                const size_t count = ny - column < BLOCK ? ny - column : BLOCK;
                load_cells(work->evidence, work->shares, work->left_out, work->larger, i * ny + column, column, count,
                           &cells);
                add_moments(&cells, work->shares, count, &row);
            }
            add_row(&row, place_on(i, nx), work->shares, &sums);
        }
        work->sums[chunk] = sums;
    }
}

CLONED_ROW_WORK(smooth_range, smooth_rows)

SmoothSums smooth_sums(const ScanEvidence *evidence, size_t shares, const uint8_t *left_out, const double *misfit) {
    const size_t n = DATUM_TERMS + shares;
    SmoothWork work = {.evidence = evidence, .shares = shares, .left_out = left_out, .larger = {1.0, 1.0}};
    SmoothSums sums = {{0.0}, {0.0}};
    for (size_t class = 0; misfit && class < CLASSES; class++)
        work.larger[class] = fmax(misfit[class], 1.0);
    run_rows(evidence->layer->threads, evidence->options->nx, evidence->options->ny, smooth_range, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        for (size_t k = 0; k < n * n; k++)
            sums.matrix[k] += work.sums[chunk].matrix[k];
        for (size_t k = 0; k < n; k++)
            sums.side[k] += work.sums[chunk].side[k];
    }
    for (size_t a = 0; a < n; a++)
        for (size_t b = a + 1; b < n; b++)
            sums.matrix[a * n + b] = sums.matrix[b * n + a];
    return sums;
}

double share_within(double share) {
    return fmin(LARGEST_SHARE, fmax(LEAST_SHARE, share));
}

bool smooth_prior(const ScanEvidence *evidence, size_t shares, size_t stride, double *precision) {
    double of_shares[SHARES_MAX * SHARES_MAX];
    if (shares > 0 && !share_prior(evidence, of_shares))
        return false;
    for (size_t a = 0; a < DATUM_TERMS; a++)
        for (size_t b = 0; b < DATUM_TERMS; b++)
            precision[a * stride + b] = evidence->datum->precision[a * DATUM_TERMS + b];
    for (size_t a = 0; a < shares; a++)
        for (size_t b = 0; b < shares; b++)
            precision[(DATUM_TERMS + a) * stride + DATUM_TERMS + b] = of_shares[a * shares + b];
    return true;
}

void take_smooth(const double *x, const double *covariance, size_t first, size_t shares, size_t all, InkFit *fit) {
    memcpy(fit->datum, x + first, sizeof fit->datum);
    for (size_t a = 0; a < DATUM_TERMS; a++)
        for (size_t b = 0; b < DATUM_TERMS; b++)
            fit->datum_covariance[a * DATUM_TERMS + b] = covariance[(first + a) * all + first + b];
    for (size_t a = 0; a < shares; a++) {
        fit->share[a] = share_within(x[first + DATUM_TERMS + a]);
        for (size_t b = 0; b < shares; b++)
            fit->covariance[a * shares + b] = covariance[(first + DATUM_TERMS + a) * all + first + DATUM_TERMS + b];
    }
}

/* Solves for datum and shares. */
static bool solve_smooth(const ScanEvidence *evidence, size_t shares, const SmoothSums *sums, InkFit *fit) {
    const size_t n = DATUM_TERMS + shares;
    double matrix[ENTRIES_MAX] = {0.0}, covariance[ENTRIES_MAX], x[UNKNOWNS_MAX];
    if (!smooth_prior(evidence, shares, n, matrix))
        return false;
    for (size_t k = 0; k < n * n; k++)
        matrix[k] += sums->matrix[k];
    memcpy(x, sums->side, n * sizeof *x);
    if (!solve_definite(n, matrix, x) || !invert_definite(n, matrix, covariance))
        return false;
    for (size_t k = 0; k < shares; k++)
        x[DATUM_TERMS + k] += evidence->known->share[k];
    take_smooth(x, covariance, 0, shares, n, fit);
    return true;
}

/* Lists of squares by class in the rows of a chunk, and sums over cells with a droplet. */
typedef struct {
    size_t counts[CLASSES];
    double base, droplets; /* [m^2] */
} ChunkMisfits;

typedef struct {
    const ScanEvidence *evidence;
    const InkFit *fit;
    double *lists[CLASSES];
    size_t shares;
    ChunkMisfits found[CHUNKS];
} MisfitWork;

/* Appends the values that are chosen; returns the end. No branch depends on a cell. */
static INLINED double *append(const double *values, const uint8_t *chosen, size_t count, double *end) {
    for (size_t k = 0; k < count; k++) {
        *end = values[k];
        end += chosen[k];
    }
    return end;
}

static INLINED void misfit_cells(const MisfitWork *work, const double row[ROW_TERMS], size_t first, size_t column,
                                 size_t count, double *ends[CLASSES], ChunkMisfits *found) {
    const ScanEvidence *evidence = work->evidence;
    const double none[CLASSES] = {1.0, 1.0}, *variance = evidence->variance + first;
    const double *squares = evidence->increments->squares + first;
    const int32_t *pattern = evidence->layer->pattern + first;
    const uint8_t *valid = evidence->valid + first;
    uint8_t chosen[CLASSES][BLOCK];
    double square[BLOCK], base[BLOCK], droplets[BLOCK];
    FitCells cells;
    load_cells(evidence, work->shares, NULL, none, first, column, count, &cells);
    for (size_t s = 0; s < work->shares; s++) {
        const double change = work->fit->share[s] - evidence->known->share[s];
        for (size_t k = 0; k < count; k++)
            cells.rest[k] -= change * cells.share[s][k];
    }
    for (size_t k = 0; k < count; k++) {
        const double w = cells.w[k], rest = cells.rest[k] - (row[0] + w * (row[1] + w * row[2]));
        base[k] = evidence->noise_variance + variance[k];
        square[k] = rest * rest / (base[k] + evidence->droplet_variance * squares[k]);
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
    found->base += lane_sum(base, count);
    found->droplets += lane_sum(droplets, count);
    for (size_t class = 0; class < CLASSES; class++)
        ends[class] = append(square, chosen[class], count, ends[class]);
}

static INLINED void misfit_rows(void *context, const RowRange *range) {
    MisfitWork *work = context;
    const size_t nx = work->evidence->options->nx, ny = work->evidence->options->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        const size_t begin = chunk_row(nx, chunk) * ny;
        double *ends[CLASSES] = {work->lists[OWN] + begin, work->lists[SPILL] + begin};
        ChunkMisfits found = {{0, 0}, 0.0, 0.0};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++) {
            double row[ROW_TERMS];
            datum_of_row(work->fit->datum, place_on(i, nx), row);
            for (size_t column = 0; column < ny; column += BLOCK) {
                const size_t count = ny - column < BLOCK ? ny - column : BLOCK;
                misfit_cells(work, row, i * ny + column, column, count, ends, &found);
            }
        }
        for (size_t class = 0; class < CLASSES; class++)
            found.counts[class] = (size_t)(ends[class] - (work->lists[class] + begin));
        work->found[chunk] = found;
    }
}

CLONED_ROW_WORK(misfit_range, misfit_rows)

/* Residuals on the cells of each class, as medians. */
static void take_misfits(const ScanEvidence *evidence, FitRoom *room, InkFit *fit) {
    const size_t nx = evidence->options->nx, ny = evidence->options->ny;
    MisfitWork work = {.evidence = evidence,
                       .fit = fit,
                       .lists = {room->lists[OWN], room->lists[SPILL]},
                       .shares = learnt_shares(evidence->options)};
    ValueLists lists[CLASSES] = {{.nx = nx, .ny = ny, .map = room->lists[OWN]},
                                 {.nx = nx, .ny = ny, .map = room->lists[SPILL]}};
    size_t counts[CLASSES] = {0, 0};
    double base = 0.0, droplets = 0.0;
    run_rows(evidence->layer->threads, nx, ny, misfit_range, &work);
    for (size_t chunk = 0; chunk < CHUNKS; chunk++) {
        for (size_t class = 0; class < CLASSES; class++)
            counts[class] += lists[class].lengths[chunk] = work.found[chunk].counts[class];
        base += work.found[chunk].base;
        droplets += work.found[chunk].droplets;
    }
    fit->droplets = counts[OWN];
    fit->mean_base = counts[OWN] > 0 ? base / (double)counts[OWN] : 0.0;
    fit->mean_droplets = counts[OWN] > 0 ? droplets / (double)counts[OWN] : 0.0;
    for (size_t class = 0; class < CLASSES; class++)
        fit->misfit[class] =
            counts[class] < LEAST_READINGS ? 1.0 : median_of_lists(&lists[class], room->spread_slope) / MEDIAN_SQUARE;
}

bool is_foreign(double misfit) {
    return misfit >= FOREIGN_MISFIT;
}

bool is_misfit(const InkFit *fit) {
    return is_foreign(fmax(fit->misfit[OWN], fit->misfit[SPILL]));
}

bool fit_in_register(const ScanEvidence *evidence, FitRoom *room, InkFit *fit) {
    const size_t shares = learnt_shares(evidence->options);
    memcpy(fit->share, evidence->known->share, sizeof fit->share);
    memcpy(fit->covariance, evidence->known->share_covariance, sizeof fit->covariance);
    for (int round = 0; round < 2; round++) { /* the second one with what the first leaves */
        const SmoothSums sums = smooth_sums(evidence, shares, NULL, round == 0 ? NULL : fit->misfit);
        if (!solve_smooth(evidence, shares, &sums, fit))
            return false;
        take_misfits(evidence, room, fit);
        if (!is_misfit(fit))
            return true;
    }
    return true;
}
