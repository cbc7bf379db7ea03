/* Choice between the two fits of a scan, in register and displaced, and update of the estimate by it.
 *
 * The chosen fit updates the maps (map_update.c), ink, datum, variation of the droplets and shares of surprises. */
#include "scan_fit.h"

#include <math.h>
#include <string.h>

#include "median.h"

/* two standard deviations: the droplets do not follow the model (assumed) */
static const double FOREIGN_MISFIT = 4.0;

/* share of the datum's variance kept from scan to scan; its least value [m^2] */
static const double DATUM_KEPT = 0.8, LEAST_SPREAD = 1e-17;
/* ratio of lasting to vanishing surprises from which all are believed; plus this share of the readings (assumed) */
static const double LASTING = 2.0, FEW_LAST = 2e-4;
static const double USUAL_MISFIT = 2.0; /* misfit up to which droplets explain it */
static const double KEPT = 0.8;         /* share of what was learnt kept from layer to layer */
/* in DROPLET_STD^2; the largest: uniform volumes within 20 % */
static const double LEAST_VARIATION = 0.01, LARGEST_FOUND = 9.0, LARGEST_VARIATION = 4.0 / 3.0;
static const double EVIDENCE_MAX = 500.0; /* degrees of freedom */
enum { EARLY = 12, LEAST_DROPLETS = 20 };

/* Whether so many variances are more than sensor and model's droplets explain. */
static bool is_foreign(double misfit) {
    return misfit >= FOREIGN_MISFIT;
}

bool is_misfit(const InkFit *fit) {
    return is_foreign(fmax(fit->misfit[OWN], fit->misfit[SPILL]));
}

bool may_be_displaced(const Registration *registration) {
    const size_t fits = registration->fits < REMEMBERED ? (size_t)registration->fits : REMEMBERED;
    double last[REMEMBERED];
    memcpy(last, registration->misfits, sizeof last);
    return !is_foreign(median(last, fits));
}

/* Variation of the droplets, by the residuals of the growth of cells. */
static void learn_droplets(const InkFit *fit, Knowledge *known) {
    LoopTrust *trust = &known->trust;
    const double unit = DROPLET_STD * DROPLET_STD, own = unit * fit->mean_droplets, variation = known->droplet_variance;
    if (fit->droplets < LEAST_DROPLETS)
        return;
    const double all = fit->mean_base + variation * own, share = variation * own / all;
    const double found = fmax(LEAST_VARIATION, variation + (fit->scatter - 1.0) * all / own);
    const double by_median = fmax(LEAST_VARIATION, variation + (fit->misfit[OWN] - 1.0) * all / own);
    const double freedom = (double)fit->droplets * share * share;
    const double kept = KEPT * known->droplet_evidence, prior = (1.0 - KEPT) * FIRST_EVIDENCE;
    const double evidence = kept + prior + freedom; /* the forgotten share returns to the prior: droplets vary */
    const double mean = (kept * variation + prior + freedom * fmin(found, LARGEST_FOUND)) / evidence;
    known->droplet_variance = fmin(mean, LARGEST_VARIATION);
    known->droplet_evidence = fmin(evidence, EVIDENCE_MAX);
    trust->layers++;
    trust->surprise = KEPT * trust->surprise + (1.0 - KEPT) * fit->misfit[OWN];
    trust->spill = KEPT * trust->spill + (1.0 - KEPT) * fit->misfit[SPILL];
    if (trust->layers <= EARLY)
        trust->early += (by_median - trust->early) / (double)trust->layers;
}

static void learn_datum(const ScanDatum *datum, const InkFit *fit, Knowledge *known) {
    if (datum->noise.variance < 0.0)
        return;
    memcpy(known->datum, datum->term, sizeof known->datum);
    for (size_t k = 0; k < DATUM_TERMS; k++) {
        known->datum[k] += fit->datum[k];
        known->datum_spread[k] = DATUM_KEPT * known->datum_spread[k] +
                                 (1.0 - DATUM_KEPT) * fmax(known->datum[k] * known->datum[k], LEAST_SPREAD);
    }
}

/* Whether the droplets do not follow the model: misfits have been high for some time, or are so again. A few spikes on
 * few cells are no evidence, and a layer of few droplets shows nothing. */
static bool are_droplets_foreign(const LoopTrust *trust, const InkFit *fit) {
    const double own = KEPT * trust->surprise + (1.0 - KEPT) * fit->misfit[OWN];
    const double spill = KEPT * trust->spill + (1.0 - KEPT) * fit->misfit[SPILL];
    const double lasting = fmax(own, spill);
    return is_foreign(lasting) || (is_misfit(fit) && lasting > USUAL_MISFIT);
}

/* Learns the shares of surprises that vanished (errors of the sensor) and lasted (changes of the cells). */
static void learn_surprises(const size_t found[], Knowledge *known) {
    const double seen = fmax((double)found[SEEN], 1.0);
    known->vanishing = 0.9 * known->vanishing + 0.1 * (double)found[VANISHED] / seen;
    known->lasting = 0.9 * known->lasting + 0.1 * (double)found[LASTED] / seen;
}

/* Covariance of the geometry in readings at walls: while scans count as in register, weighted by the probability that
 * they are displaced. */
static void doubtful_geometry(const Registration *registration, double *covariance) {
    const double odds = 1.0 / (1.0 + exp(-registration->odds));
    memcpy(covariance, registration->covariance, sizeof registration->covariance);
    for (size_t a = 0; a < GEOMETRY && !registration->is_displaced; a++)
        for (size_t b = 0; b < GEOMETRY; b++)
            covariance[a * GEOMETRY + b] =
                odds * (covariance[a * GEOMETRY + b] + registration->estimate[a] * registration->estimate[b]);
}

/* Updates the maps; may_be: scans may be displaced. */
static CellSums update_maps(const ScanEvidence *evidence, const InkFit *fit, bool may_be) {
    const Knowledge *known = evidence->after->known;
    const bool is_displaced = known->registration.is_displaced;
    const double *g = known->registration.estimate;
    /* most surprises of earlier scans lasted: readings are believed at once */
    const bool do_last = known->lasting > LASTING * known->vanishing + FEW_LAST;
    double doubtful[GEOMETRY * GEOMETRY];
    doubtful_geometry(&known->registration, doubtful);
    MapUpdate update = {.evidence = evidence,
                        .fit = fit,
                        .geometry = is_displaced || may_be ? doubtful : NULL,
                        .is_robust = (may_be || !are_droplets_foreign(&known->trust, fit)) && !do_last};
    for (size_t class = 0; class < CLASSES && !may_be && !is_displaced; class++)
        update.extra[class] = fmax(fit->misfit[class] - USUAL_MISFIT, 0.0);
    if (!is_displaced)
        return update_in_register(&update);
    average_prediction(evidence, fit->share, g[SPREAD]);
    return update_displaced(&update);
}

bool take_scan(const ScanEvidence *evidence) {
    Knowledge *known = evidence->after->known;
    Registration *registration = &known->registration;
    const bool is_registered = evidence->options->register_scans && !evidence->is_unknown;
    InkFit in_register = {.droplets = 0}, displaced = in_register;
    if (!fit_in_register(evidence, &in_register) ||
        (is_registered && !fit_displaced(evidence, &in_register, registration, &displaced)))
        return false;
    const bool is_displaced = registration->is_displaced;
    const bool may_be = is_registered && registration->fits > 0 && may_be_displaced(registration);
    const InkFit *fit = is_displaced && is_registered ? &displaced : &in_register;
    const CellSums found = update_maps(evidence, fit, may_be);
    if (evidence->is_unknown)
        return true;
    learn_surprises(found.count, known);
    learn_droplets(is_displaced || (may_be && is_misfit(&in_register)) ? &displaced : &in_register, known);
    learn_datum(&evidence->datum, fit, known);
    memcpy(known->share, fit->share, sizeof known->share);
    memcpy(known->share_covariance, fit->covariance, sizeof known->share_covariance);
    if (evidence->options->ink.model == INK_FULL && is_displaced)
        take_volumes_alone(evidence->options, known->share, known->share_covariance);
    if (!is_misfit(fit) && !known->trust.is_volume_believed)
        doubt_volume(evidence->options, evidence->number, known);
    return true;
}
