#include "surface_estimate.h"

#include <math.h>
#include <string.h>

/* Standard deviations before any scan (assumed): shift and spot [cells, cells^2], rotation [rad], magnification and the
 * rest [1]. */
static const double SHIFT_STD = 1.0, SPREAD_STD = 0.5, ROTATION_STD = 0.03, MAGNIFICATION_STD = 0.02, SHEAR_STD = 0.004;
/* standard deviation of a share of the ink before any scan (assumed) */
static const double SHARE_STD = 0.15, FULL_STD = 0.3;
static const double HELD = 1e-8; /* variance of the share of a height that is held: as good as none */
/* standard deviation of each term before any scan, in layers (assumed) */
static const double DATUM_STD[DATUM_TERMS] = {1.3, 0.8, 0.8, 0.4, 0.4, 0.4};
static const double FIRST_STEP = 0.1;  /* step of the shift from scan to scan before any is learnt [cells] */
static const double FIRST_ODDS = -3.0; /* log odds: one profiler in twenty is displaced (assumed) */
/* largest mean square residual, in variances of droplets and sensor: three standard deviations (assumed) */
static const double RESIDUALS_MAX = 9.0;
/* largest residual by spill: droplets that vary by 40 % reach 2.4, droplets unlike the model's 10 and more */
static const double SPILL_MAX = 6.0;
static const double MODEL_MAX = 0.3; /* largest deviation of a volume of droplets unlike the model's */
/* early residuals that no variation of droplets explains */
static const double FOREIGN = 5.0;
static const int64_t BLIND_LAYERS = 5; /* layers in a row (assumed) */
enum { PROBE_LAYERS = 5 };             /* period in layers after which dead cells are tried again (assumed) */

enum { REAL_MAPS = 6, BYTE_MAPS = 3 };

size_t estimate_size(size_t cells) {
    const size_t size = sizeof(Knowledge) + cells * (REAL_MAPS * sizeof(double) + sizeof(int32_t) + BYTE_MAPS);
    return (size + sizeof(double) - 1) / sizeof(double) * sizeof(double);
}

SurfaceEstimate estimate_in(void *block, size_t cells) {
    Knowledge *known = block;
    double *real = (double *)(known + 1);
    int32_t *whole = (int32_t *)(real + REAL_MAPS * cells);
    uint8_t *byte = (uint8_t *)(whole + cells);
    return (SurfaceEstimate){.height = real,
                             .variance = real + cells,
                             .ledger = real + 2 * cells,
                             .last = real + 3 * cells,
                             .surprise = real + 4 * cells,
                             .dead_evidence = real + 5 * cells,
                             .unseen = whole,
                             .last_valid = byte,
                             .surprised = byte + cells,
                             .capped = byte + 2 * cells,
                             .known = known};
}

size_t ink_shares(const InkPrior *prior) {
    return prior->model == INK_FULL ? prior->inks * ORDERS : prior->inks;
}

void learnt_inks(const EstimatorOptions *options, const Knowledge *known, Ink ink[INKS_MAX]) {
    const InkPrior *prior = &options->ink;
    memcpy(ink, prior->nominal, INKS_MAX * sizeof *ink);
    for (size_t k = 0; k < prior->inks; k++) {
        const double *its = known->share + (prior->model == INK_FULL ? k * ORDERS : k);
        const size_t next = prior->model == INK_FULL ? 1 : 0;
        ink[k] = (Ink){its[0] * ink[k].h1, its[next] * ink[k].h2, its[2 * next] * ink[k].h3};
    }
    if (prior->inks < INKS_MAX)
        ink[INKS_MAX - 1] = ink[0];
}

static double layers_of(const Ink ink[], size_t inks) {
    double height = 0.0;
    for (size_t k = 0; k < inks; k++)
        height += full_layer_height(&ink[k]);
    return height;
}

void take_volumes_alone(const EstimatorOptions *options, double *share, double *covariance) {
    const size_t inks = options->ink.inks, shares = inks * ORDERS;
    double weight[SHARES_MAX], volume[INKS_MAX] = {0.0}, joint[INKS_MAX][INKS_MAX] = {{0.0}};
    for (size_t k = 0; k < shares; k++) {
        const Ink *ink = &options->ink.nominal[k / ORDERS];
        weight[k] = (k % ORDERS > 0 ? 4.0 : 1.0) * ink_height(ink, k % ORDERS) / full_layer_height(ink);
        volume[k / ORDERS] += weight[k] * share[k];
    }
    for (size_t k = 0; k < shares; k++)
        for (size_t l = 0; l < shares; l++)
            joint[k / ORDERS][l / ORDERS] += weight[k] * weight[l] * covariance[k * shares + l];
    for (size_t k = 0; k < shares; k++) {
        share[k] = volume[k / ORDERS];
        for (size_t l = 0; l < shares; l++)
            covariance[k * shares + l] = joint[k / ORDERS][l / ORDERS] + (k == l ? HELD : 0.0);
    }
}

double learnt_volume(const EstimatorOptions *options, const Knowledge *known) {
    Ink ink[INKS_MAX];
    learnt_inks(options, known, ink);
    return layers_of(ink, options->ink.inks) / layers_of(options->ink.nominal, options->ink.inks);
}

double layer_of(const EstimatorOptions *options) {
    double layer = 0.0;
    for (size_t k = 0; k < options->ink.inks; k++)
        layer = fmax(layer, full_layer_height(&options->ink.nominal[k]));
    return layer;
}

static Registration no_registration(size_t nx, size_t ny) {
    static const double ROTATION[4] = {0.0, 1.0, -1.0, 0.0}, MAGNIFICATION[4] = {1.0, 0.0, 0.0, 1.0};
    const double edge[4] = {half_of(nx), half_of(ny), half_of(nx), half_of(ny)};
    Registration none = {.steps = {FIRST_STEP * FIRST_STEP, FIRST_STEP * FIRST_STEP}, .odds = FIRST_ODDS};
    double *covariance = none.covariance;
    covariance[SHIFT_X * GEOMETRY + SHIFT_X] = covariance[SHIFT_Y * GEOMETRY + SHIFT_Y] = SHIFT_STD * SHIFT_STD;
    covariance[SPREAD * GEOMETRY + SPREAD] = SPREAD_STD * SPREAD_STD;
    for (size_t i = 0; i < 4; i++)
        for (size_t j = 0; j < 4; j++) {
            const double turned = ROTATION_STD * ROTATION_STD * ROTATION[i] * ROTATION[j];
            const double grown = MAGNIFICATION_STD * MAGNIFICATION_STD * MAGNIFICATION[i] * MAGNIFICATION[j];
            const double rest = i == j ? SHEAR_STD * SHEAR_STD : 0.0;
            covariance[(ALONG_X_U + i) * GEOMETRY + ALONG_X_U + j] = (turned + grown + rest) * edge[i] * edge[j];
        }
    return none;
}

Knowledge first_knowledge(const EstimatorOptions *options) {
    const size_t n = ink_shares(&options->ink);
    const double deviation = options->ink.model == INK_FULL ? FULL_STD : SHARE_STD, layer = layer_of(options);
    Knowledge known = {.registration = no_registration(options->nx, options->ny),
                       .trust = {.early = 1.0, .surprise = 1.0, .spill = 1.0},
                       .noise.variance = fmax(options->noise_variance, options->steps_variance),
                       .droplet_variance = 1.0,
                       .droplet_evidence = FIRST_EVIDENCE,
                       .scans = 1};
    for (size_t k = 0; k < n; k++) {
        known.share[k] = 1.0;
        known.share_covariance[k * n + k] = options->ink.model == INK_OFF ? 0.0 : deviation * deviation;
    }
    for (size_t k = 0; k < DATUM_TERMS; k++)
        known.datum_spread[k] = DATUM_STD[k] * DATUM_STD[k] * layer * layer;
    return known;
}

bool is_spill_foreign(const LoopTrust *trust) {
    return trust->spill > SPILL_MAX;
}

static int64_t reasons_of(const LoopTrust *trust) {
    return (trust->unseen_cells > 0 ? UNTRUSTED_UNSEEN : 0) |
           (trust->blind_layers > BLIND_LAYERS ? UNTRUSTED_BLIND : 0) | (trust->ground_wrong ? UNTRUSTED_GROUND : 0) |
           (trust->surprise > RESIDUALS_MAX ? UNTRUSTED_RESIDUALS : 0) | (trust->capped_cells > 0 ? UNTRUSTED_INK : 0) |
           (trust->high_cells > 0 ? UNTRUSTED_HIGH : 0) | trust->stop;
}

static double droplet_deviation(const Knowledge *known) {
    const LoopTrust *trust = &known->trust;
    if (trust->early > FOREIGN)
        return fmin(DROPLET_STD * sqrt(trust->early), MODEL_MAX);
    return trust->layers > 0 ? DROPLET_STD * sqrt(known->droplet_variance) : 0.0;
}

bool is_probe(int64_t layer) {
    return layer % PROBE_LAYERS == 0;
}

/* Reports the estimated geometry of the scans. */
static void report_geometry(const Registration *registration, size_t nx, size_t ny, EstimateFigures *figures) {
    const double *covariance = registration->covariance, *g = registration->estimate;
    const double error = sqrt(covariance[SPREAD * (GEOMETRY + 1)]);
    const double rise = half_of(nx), run = half_of(ny), larger = fmax(covariance[0], covariance[GEOMETRY + 1]);
    figures->shift_x = g[SHIFT_X];
    figures->shift_y = g[SHIFT_Y];
    figures->shift_std = sqrt(larger);
    figures->spot_radius = registration->is_displaced ? sqrt(g[SPREAD]) : 0.0;
    figures->spot_std = sqrt(g[SPREAD] + error) - sqrt(g[SPREAD]);
    figures->rotation = 0.5 * (g[ALONG_Y_U] / rise - g[ALONG_X_W] / run);
    figures->magnification = 0.5 * (g[ALONG_X_U] / rise + g[ALONG_Y_W] / run);
    figures->is_displaced = registration->is_displaced;
}

EstimateFigures estimate_figures(const EstimatorOptions *options, const SurfaceEstimate *estimate) {
    const Knowledge *known = estimate->known;
    const LoopTrust *trust = &known->trust;
    EstimateFigures figures = {.volume = learnt_volume(options, known),
                               .droplet_std = droplet_deviation(known),
                               .noise_std = sqrt(known->noise.variance),
                               .ground = {trust->ground[0], trust->ground[1], trust->ground[2]},
                               .surprise = sqrt(trust->surprise),
                               .blind_share = trust->blind_share,
                               .excess = trust->excess,
                               .rise = trust->rise,
                               .stop_figure = trust->stop_figure,
                               .reasons = reasons_of(trust),
                               .stop = trust->stop,
                               .stop_layer = trust->stop_layer,
                               .transform = trust->transform,
                               .unseen_cells = trust->unseen_cells,
                               .capped_cells = trust->capped_cells,
                               .excess_cell = trust->excess_cell,
                               .rise_cell = trust->rise_cell,
                               .is_foreign = is_spill_foreign(trust),
                               .scans = known->scans};
    learnt_inks(options, known, figures.ink);
    if (known->registration.fits > 0)
        report_geometry(&known->registration, options->nx, options->ny, &figures);
    for (size_t cell = 0; cell < options->nx * options->ny; cell++)
        figures.dead_cells += estimate->dead_evidence[cell] >= DEAD_EVIDENCE;
    return figures;
}
