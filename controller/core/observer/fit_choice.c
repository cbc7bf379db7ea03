#include "fit_choice.h"

#include <math.h>
#include <string.h>

#include "displaced_fit.h"
#include "map_update.h"
#include "register_fit.h"
#include "scan_doubts.h"

/* share of the datum's variance kept from scan to scan; its least value [m^2] */
static const double DATUM_KEPT = 0.8, LEAST_SPREAD = 1e-17;
/* ratio of lasting to vanishing surprises from which all are believed; plus this share of the readings (assumed) */
static const double LASTING = 2.0, FEW_LAST = 2e-4;
static const double USUAL_MISFIT = 2.0; /* misfit up to which droplets explain it */
static const double KEPT = 0.8;         /* share of what was learnt kept from layer to layer */
static const double LEAST_VARIATION = 0.01, LARGEST_FOUND = 9.0, LARGEST_VARIATION = 2.0; /* in DROPLET_STD^2 */
static const double EVIDENCE_MAX = 500.0;                                                 /* degrees of freedom */
static const double OF_A_MEDIAN = 0.37; /* degrees of freedom of a cell in the median of squares */
enum { EARLY = 12, LEAST_DROPLETS = 20 };

/* Variation of the droplets, by the residuals of the growth of cells. */
static void learn_droplets(const InkFit *fit, Knowledge *known) {
    LoopTrust *trust = &known->trust;
    const double unit = DROPLET_STD * DROPLET_STD, own = unit * fit->mean_droplets, variation = known->droplet_variance;
    if (fit->droplets < LEAST_DROPLETS || !(own > 0.0))
        return;
    const double surplus = (fit->misfit[OWN] - 1.0) * (fit->mean_base + variation * own) / own;
    const double found = fmax(LEAST_VARIATION, variation + surplus);
    const double share = variation * own / (fit->mean_base + variation * own);
    const double freedom = OF_A_MEDIAN * (double)fit->droplets * share * share;
    const double kept = KEPT * known->droplet_evidence, prior = (1.0 - KEPT) * FIRST_EVIDENCE;
    const double evidence = kept + prior + freedom; /* the forgotten share returns to the prior: droplets vary */
    const double mean = (kept * variation + prior + freedom * fmin(found, LARGEST_FOUND)) / evidence;
    known->droplet_variance = fmin(mean, LARGEST_VARIATION);
    known->droplet_evidence = fmin(evidence, EVIDENCE_MAX);
    trust->layers++;
    trust->surprise = KEPT * trust->surprise + (1.0 - KEPT) * fit->misfit[OWN];
    trust->spill = KEPT * trust->spill + (1.0 - KEPT) * fit->misfit[SPILL];
    if (trust->layers <= EARLY)
        trust->early += (found - trust->early) / (double)trust->layers;
}

static void learn_datum(const ScanDatum *datum, const InkFit *fit, Knowledge *known) {
    if (datum->noise_variance < 0.0)
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

/* Whether most surprises of earlier scans lasted: then readings are believed at once. */
static bool do_surprises_last(const Knowledge *known) {
    return known->lasting > LASTING * known->vanishing + FEW_LAST;
}

/* Learns the shares of surprises that vanished (errors of the sensor) and lasted (changes of the cells). */
static void learn_surprises(const Surprises *found, Knowledge *known) {
    const double seen = fmax((double)found->seen, 1.0);
    known->vanishing = 0.9 * known->vanishing + 0.1 * (double)found->vanished / seen;
    known->lasting = 0.9 * known->lasting + 0.1 * (double)found->lasted / seen;
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
static Surprises update_maps(const ScanEvidence *evidence, const SurfaceEstimate *before, const InkFit *fit,
                             bool is_unknown, bool may_be, LayerMaps *maps, SurfaceEstimate *after) {
    const Knowledge *known = after->known;
    const bool is_displaced = known->registration.is_displaced;
    FitRoom *room = &maps->room;
    const double *g = known->registration.estimate;
    double doubtful[GEOMETRY * GEOMETRY];
    doubtful_geometry(&known->registration, doubtful);
    MapUpdate update = {.evidence = evidence,
                        .before = before,
                        .fit = fit,
                        .geometry = is_displaced || may_be ? doubtful : NULL,
                        .walls = room->walls,
                        .spread_slope = room->spread_slope,
                        .full_own = maps->full_own,
                        .is_robust = (may_be || !are_droplets_foreign(&known->trust, fit)) && !do_surprises_last(known),
                        .is_telling = !is_unknown,
                        .scratch = {maps->slopes, room->lists[0], room->lists[1]},
                        .after = after};
    for (size_t class = 0; class < CLASSES && !may_be && !is_displaced; class++)
        update.extra[class] = fmax(fit->misfit[class] - USUAL_MISFIT, 0.0);
    if (!is_displaced)
        return update_in_register(&update);
    average_prediction(evidence, fit->share, g[SPREAD], room);
    return update_displaced(&update, g, room->averaged);
}

bool take_scan(const ScanEvidence *evidence, const SurfaceEstimate *before, int32_t number, bool is_unknown,
               LayerMaps *maps, SurfaceEstimate *after) {
    Knowledge *known = after->known;
    Registration *registration = &known->registration;
    const bool is_registered = evidence->options->register_scans && !is_unknown;
    InkFit in_register = {.droplets = 0}, displaced = in_register;
    if (!fit_in_register(evidence, &maps->room, &in_register) ||
        (is_registered && !fit_displaced(evidence, maps->slopes, &in_register, &maps->room, registration, &displaced)))
        return false;
    const bool is_displaced = registration->is_displaced;
    const bool may_be = is_registered && registration->fits > 0 && may_be_displaced(registration);
    const InkFit *fit = is_displaced && is_registered ? &displaced : &in_register;
    const Surprises found = update_maps(evidence, before, fit, is_unknown, may_be, maps, after);
    if (is_unknown)
        return true;
    learn_surprises(&found, known);
    learn_droplets(is_displaced || (may_be && is_misfit(&in_register)) ? &displaced : &in_register, known);
    learn_datum(evidence->datum, fit, known);
    memcpy(known->share, fit->share, sizeof known->share);
    memcpy(known->share_covariance, fit->covariance, sizeof known->share_covariance);
    if (!is_misfit(fit) && !known->trust.is_volume_believed)
        doubt_volume(evidence->options, known, number, &known->trust);
    return true;
}
