/* The robust fit of a scan in register: ink, and correction of the datum.
 *
 * Errors of readings have a t distribution with the variance of sensor and droplets as scale. The fit of a displaced
 * scan (displaced_fit.c) uses the normal equations of this one where there are no walls. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "small_algebra.h"

/* step of a share by a full layer, as one share or as three: ink drifts while it is printed (assumed) */
static const double SHARE_STEP = 0.004, FULL_STEP = 0.014;
static const double LEAST_SHARE = 0.3, LARGEST_SHARE = 2.0;
enum { POWERS = 5 };

/* Sums over a row: of the weights, of the residual and of each column of a share, weighted, each with powers of w; and
 * of products of these. */
typedef struct {
    double of_one[POWERS], of_rest[ROW_TERMS], of_share[SHARES_MAX][ROW_TERMS];
    double rest_share[SHARES_MAX], share_share[SHARES_MAX * SHARES_MAX];
} RowMoments;

/* Some cells of a row: columns of shares, residuals and weights of the readings. */
typedef struct {
    double weight[BLOCK], rest[BLOCK], share[SHARES_MAX][BLOCK], w[BLOCK];
} FitCells;

static INLINED void load_cells(const ScanEvidence *evidence, const uint8_t *left_out, const double larger[CLASSES],
                               size_t first, size_t column, size_t count, FitCells *restrict cells) {
    const double *scan = evidence->scan + first, *predicted = evidence->predicted + first;
    const double *variance = evidence->variance + first, *squares = evidence->increments.squares + first;
    const double noise = evidence->noise_variance, droplets = evidence->droplet_variance;
    const int32_t *pattern = evidence->living.pattern + first;
    const uint8_t *valid = evidence->valid + first;
    for (size_t k = 0; k < count; k++) {
        const double rest = scan[k] - predicted[k], native = noise + variance[k] + droplets * squares[k];
        const double wide = (pattern[k] > 0 ? larger[OWN] : larger[SPILL]) * native;
        const double weight = (NU + 1.0) / (NU * wide + rest * rest);
        const bool counts = (valid[k] != 0) & (squares[k] > 0.0);
        cells->rest[k] = rest;
        cells->weight[k] = counts ? weight : 0.0;
    }
    places_in_row(evidence->ny, column, count, cells->w);
    for (size_t k = 0; left_out && k < count; k++)
        cells->weight[k] = left_out[first + k] ? 0.0 : cells->weight[k];
    for (size_t s = 0; s < evidence->shares; s++) {
        const ShareColumn of = share_column(evidence, s);
        for (size_t k = 0; k < count; k++)
            cells->share[s][k] = of.factor * of.map[first + k];
    }
}

/* Adds sums of `line`, weighted already, with powers of w. */
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

/* Adds the moments of a row to the normal equations; u: its place. */
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

/* Memory of the normal equations, shared by the threads. */
typedef struct {
    const ScanEvidence *evidence;
    const uint8_t *left_out;
    double larger[CLASSES];
    SmoothSums sums[CHUNKS];
} SmoothWork;

static INLINED void smooth_rows(void *context, const RowRange *range) {
    SmoothWork *work = context;
    const size_t nx = work->evidence->nx, ny = work->evidence->ny;
    FitCells cells;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        SmoothSums sums = {{0.0}, {0.0}};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++) {
            RowMoments row = {{0.0}, {0.0}, {{0.0}}, {0.0}, {0.0}};
            for (size_t column = 0; column < ny; column += BLOCK) {
                const size_t count = ny - column < BLOCK ? ny - column : BLOCK;
                load_cells(work->evidence, work->left_out, work->larger, i * ny + column, column, count, &cells);
                add_moments(&cells, work->evidence->shares, count, &row);
            }
            add_row(&row, place_on(i, nx), work->evidence->shares, &sums);
        }
        work->sums[chunk] = sums;
    }
}

CLONED_ROW_WORK(smooth_range, smooth_rows)

SmoothSums smooth_sums(const ScanEvidence *evidence, const uint8_t *left_out, const double *misfit) {
    const size_t n = DATUM_TERMS + evidence->shares;
    SmoothWork work = {.evidence = evidence, .left_out = left_out, .larger = {1.0, 1.0}};
    SmoothSums sums = {{0.0}, {0.0}};
    for (size_t class = 0; misfit && class < CLASSES; class++)
        work.larger[class] = fmax(misfit[class], 1.0);
    run_rows(evidence->living.threads, evidence->nx, evidence->ny, smooth_range, &work);
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

bool smooth_prior(const ScanEvidence *evidence, size_t stride, double *precision) {
    const size_t shares = evidence->shares;
    const bool has_heights = evidence->options->ink.model == INK_FULL;
    const bool is_free = has_heights && !evidence->known->registration.is_displaced;
    const size_t of_ink = has_heights ? ORDERS : 1;
    const double step = is_free ? FULL_STEP : SHARE_STEP;
    double covariance[SHARES_MAX * SHARES_MAX], of_shares[SHARES_MAX * SHARES_MAX];
    memcpy(covariance, evidence->known->share_covariance, sizeof covariance);
    for (size_t k = 0; k < shares; k++)
        for (size_t l = 0; l < shares; l++) /* steps of heights each on their own, of a volume all together */
            if (k == l || (!is_free && k / of_ink == l / of_ink))
                covariance[k * shares + l] += step * step * evidence->printed[k / of_ink];
    if (!invert_definite(shares, covariance, of_shares))
        return false;
    copy_block(DATUM_TERMS, evidence->datum.precision, DATUM_TERMS, precision, stride);
    copy_block(shares, of_shares, shares, precision + DATUM_TERMS * (stride + 1), stride);
    return true;
}

void take_smooth(const ScanEvidence *evidence, const double *x, const double *covariance, size_t all, InkFit *fit) {
    const size_t shares = evidence->shares, first = all - shares - DATUM_TERMS;
    const double *own = covariance + first * (all + 1);
    memcpy(fit->datum, x + first, sizeof fit->datum);
    copy_block(DATUM_TERMS, own, all, fit->datum_covariance, DATUM_TERMS);
    copy_block(shares, own + DATUM_TERMS * (all + 1), all, fit->covariance, shares);
    for (size_t k = 0; k < shares; k++)
        fit->share[k] = share_within(x[first + DATUM_TERMS + k]);
}

/* Solves for datum and shares. */
static bool solve_smooth(const ScanEvidence *evidence, const SmoothSums *sums, InkFit *fit) {
    const size_t shares = evidence->shares, n = DATUM_TERMS + shares;
    double matrix[ENTRIES_MAX] = {0.0}, covariance[ENTRIES_MAX], x[UNKNOWNS_MAX];
    if (!smooth_prior(evidence, n, matrix))
        return false;
    for (size_t k = 0; k < n * n; k++)
        matrix[k] += sums->matrix[k];
    memcpy(x, sums->side, n * sizeof *x);
    if (!solve_definite(n, matrix, x) || !invert_definite(n, matrix, covariance))
        return false;
    for (size_t k = 0; k < shares; k++)
        x[DATUM_TERMS + k] += evidence->known->share[k];
    take_smooth(evidence, x, covariance, n, fit);
    return true;
}

bool fit_in_register(const ScanEvidence *evidence, InkFit *fit) {
    memcpy(fit->share, evidence->known->share, sizeof fit->share);
    memcpy(fit->covariance, evidence->known->share_covariance, sizeof fit->covariance);
    /* the second round scales variances by the misfit of the first */
    for (int round = 0; round < 2 && (round == 0 || is_misfit(fit)); round++) {
        const SmoothSums sums = smooth_sums(evidence, NULL, round == 0 ? NULL : fit->misfit);
        if (!solve_smooth(evidence, &sums, fit))
            return false;
        take_misfits(evidence, fit);
    }
    return true;
}
