/* The robust fit of a scan in register: ink, and correction of the datum.
 *
 * Errors of readings have a t distribution with the variance of sensor and droplets as scale. The fit of a displaced
 * scan (displaced_fit.c) uses the normal equations of this one where there are no walls. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "median.h"
#include "small_algebra.h"

/* step of a share by a full layer, as one share or as three: ink drifts while it is printed (assumed) */
static const double SHARE_STEP = 0.004, FULL_STEP = 0.014;
static const double LEAST_SHARE = 0.3, LARGEST_SHARE = 2.0;

enum { SMOOTH_MAX = DATUM_TERMS + SHARES_MAX };         /* unknowns */
enum { POWERS = 3, ROW_MAX = POWERS + SHARES_MAX + 1 }; /* columns of a row */

/* Normal equations of a chunk of rows. */
typedef struct {
    double matrix[SMOOTH_MAX][SMOOTH_MAX], side[SMOOTH_MAX];
} SmoothSums;

/* Memory of the normal equations, shared by the threads; larger: factor of the variances in each class. */
typedef struct {
    const ScanEvidence *evidence;
    const uint8_t *left_out;
    double larger[CLASSES];
    SmoothSums sums[CHUNKS];
} SmoothWork;

/* Adds products of the columns of a cell to those of its row: 1, w, w^2, shares, and the residual. */
static INLINED void add_reading(const SmoothWork *work, size_t shares, size_t cell, double w,
                                double row[ROW_MAX][ROW_MAX]) {
    const ScanEvidence *evidence = work->evidence;
    const size_t n = POWERS + shares + 1;
    const double rest = evidence->scan[cell] - evidence->predicted[cell];
    const double variance = work->larger[class_of(evidence, cell)] * native_variance(evidence, cell);
    const double weight = (NU + 1.0) / (NU * variance + rest * rest);
    double column[ROW_MAX] = {1.0, w, w * w};
    for (size_t s = 0; s < shares; s++)
        column[POWERS + s] = share_column(evidence, s).factor * share_column(evidence, s).map[cell];
    column[n - 1] = rest;
    for (size_t a = 0; a < n; a++)
        for (size_t b = 0; b <= a; b++)
            row[a][b] += weight * column[a] * column[b];
}

/* Adds the products of a row at u to the normal equations: each unknown is a factor times a column of the row. */
static void add_row(double row[ROW_MAX][ROW_MAX], double u, size_t shares, SmoothSums *sums) {
    const double factor[SMOOTH_MAX] = {1.0, u, 1.0, u * u, u, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0};
    static const size_t COLUMN[SMOOTH_MAX] = {0, 0, 1, 0, 1, 2, 3, 4, 5, 6, 7, 8};
    for (size_t a = 0; a < DATUM_TERMS + shares; a++) {
        const size_t of = COLUMN[a];
        sums->side[a] += factor[a] * row[POWERS + shares][of];
        for (size_t b = 0; b < DATUM_TERMS + shares; b++)
            sums->matrix[a][b] += factor[a] * factor[b] * (of > COLUMN[b] ? row[of][COLUMN[b]] : row[COLUMN[b]][of]);
    }
}

/* Adds some rows; shares: of the evidence, a constant for the compiler. */
static INLINED void add_rows(SmoothWork *work, const RowRange *range, size_t shares) {
    const size_t nx = work->evidence->nx, ny = work->evidence->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++)
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++) {
            double row[ROW_MAX][ROW_MAX] = {{0.0}};
            for (size_t cell = i * ny; cell < (i + 1) * ny; cell++)
                if (is_reached(work->evidence, cell) && !(work->left_out && work->left_out[cell]))
                    add_reading(work, shares, cell, place_on(cell - i * ny, ny), row);
            add_row(row, place_on(i, nx), shares, &work->sums[chunk]);
        }
}

static void smooth_rows(void *context, const RowRange *range) {
    const size_t shares = ((SmoothWork *)context)->evidence->shares;
    if (shares == 1)
        add_rows(context, range, 1);
    else
        add_rows(context, range, shares);
}

double share_within(double share) {
    return fmin(LARGEST_SHARE, fmax(LEAST_SHARE, share));
}

/* Stores the prior precision of datum and shares. False if it is not definite. */
static bool smooth_prior(const ScanEvidence *evidence, size_t stride, double *precision) {
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

bool smooth_equations(const ScanEvidence *evidence, const uint8_t *left_out, const InkFit *last, size_t stride,
                      double *matrix, double *side) {
    const size_t n = DATUM_TERMS + evidence->shares;
    SmoothWork work = {.evidence = evidence, .left_out = left_out};
    for (size_t class = 0; class < CLASSES; class++)
        work.larger[class] = is_misfit(last) ? fmax(last->misfit[class], 1.0) : 1.0;
    run_rows(evidence->living.threads, evidence->nx, evidence->ny, smooth_rows, &work);
    if (!smooth_prior(evidence, stride, matrix))
        return false;
    memset(side, 0, n * sizeof *side);
    for (const SmoothSums *sums = work.sums; sums < work.sums + CHUNKS; sums++)
        for (size_t a = 0; a < n; a++) {
            side[a] += sums->side[a];
            for (size_t b = 0; b < n; b++)
                matrix[a * stride + b] += sums->matrix[a][b];
        }
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
static bool solve_smooth(const ScanEvidence *evidence, InkFit *fit) {
    const size_t shares = evidence->shares, n = DATUM_TERMS + shares;
    double matrix[ENTRIES_MAX] = {0.0}, covariance[ENTRIES_MAX], x[UNKNOWNS_MAX];
    if (!smooth_equations(evidence, NULL, fit, n, matrix, x) || !solve_definite(n, matrix, x) ||
        !invert_definite(n, matrix, covariance))
        return false;
    for (size_t k = 0; k < shares; k++)
        x[DATUM_TERMS + k] += evidence->known->share[k];
    take_smooth(evidence, x, covariance, n, fit);
    return true;
}

/* Memory shared by the threads for misfits: lists of squares by class. */
typedef struct {
    const ScanEvidence *evidence;
    const InkFit *fit;
    ValueLists lists[CLASSES];
} MisfitWork;

enum { BASE, DROPLETS }; /* sums over cells with a droplet [m^2] */

static void misfit_rows(void *context, const RowRange *range) {
    MisfitWork *work = context;
    const ScanEvidence *evidence = work->evidence;
    const size_t nx = evidence->nx, ny = evidence->ny;
    for (size_t chunk = range->chunk; chunk < range->end; chunk++) {
        CellSums sums = {.count = {0}};
        for (size_t i = chunk_row(nx, chunk); i < chunk_row(nx, chunk + 1); i++)
            for (size_t j = 0; j < ny; j++) {
                const size_t cell = i * ny + j, class = class_of(evidence, cell);
                if (!is_reached(evidence, cell))
                    continue;
                const double rest = evidence->scan[cell] - evidence->predicted[cell] -
                                    share_change(evidence, work->fit->share, cell) -
                                    datum_at(work->fit->datum, place_on(i, nx), place_on(j, ny));
                double *list = evidence->lists[class] + chunk_row(nx, chunk) * ny;
                list[sums.count[class]++] = rest * rest / native_variance(evidence, cell);
                sums.sum[BASE] += class == OWN ? evidence->noise_variance + evidence->variance[cell] : 0.0;
                sums.sum[DROPLETS] += class == OWN ? evidence->increments.squares[cell] : 0.0;
            }
        for (size_t class = 0; class < CLASSES; class++)
            work->lists[class].lengths[chunk] = sums.count[class];
        evidence->sums[chunk] = sums;
    }
}

/* Medians of the squared residuals of a fit, and its means over droplets. */
static void take_misfits(const ScanEvidence *evidence, InkFit *fit) {
    MisfitWork work = {.evidence = evidence, .fit = fit};
    for (size_t class = 0; class < CLASSES; class++)
        work.lists[class] = (ValueLists){.nx = evidence->nx, .ny = evidence->ny, .map = evidence->lists[class]};
    const CellSums sums = over_rows(evidence, misfit_rows, &work);
    const double droplets = fmax((double)sums.count[OWN], 1.0);
    fit->droplets = sums.count[OWN];
    fit->mean_base = sums.sum[BASE] / droplets;
    fit->mean_droplets = sums.sum[DROPLETS] / droplets;
    for (size_t class = 0; class < CLASSES; class++)
        fit->misfit[class] = sums.count[class] < LEAST_READINGS
                                 ? 1.0
                                 : median_of_lists(&work.lists[class], evidence->spread_slope) / MEDIAN_SQUARE;
    fit->scatter =
        sums.count[OWN] < LEAST_READINGS ? 1.0 : variance_of_lists_within(&work.lists[OWN], fit->misfit[OWN]);
}

bool fit_in_register(const ScanEvidence *evidence, InkFit *fit) {
    memcpy(fit->share, evidence->known->share, sizeof fit->share);
    memcpy(fit->covariance, evidence->known->share_covariance, sizeof fit->covariance);
    /* the second round scales variances by the misfit of the first */
    for (int round = 0; round < 2 && (round == 0 || is_misfit(fit)); round++) {
        if (!solve_smooth(evidence, fit))
            return false;
        take_misfits(evidence, fit);
    }
    return true;
}
