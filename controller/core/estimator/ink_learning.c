#include "ink_learning.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "layer_surface.h"

enum { ROUNDS = 5 }; /* of the ink by the widths of saturation that follow from it, until they agree (assumed) */
enum { FULL, SCALE };
static const double WIDTHS_AGREE = 0.01;
static const double FORGETTING = 0.8; /* weight of a layer against the next, as of the evidence */
static const double LEAST_GAIN = 0.2; /* share of what volumes predict wrong that three heights must spare: they fit
                                         some of any surface, and plans by them are worse (by trial: with 0.4 they take
                                         no ink, with 0.1 some that describes nothing) */

static bool agree(const Ink one[], const Ink other[], size_t inks) {
    for (size_t k = 0; k < inks; k++)
        for (size_t order = 0; order < ORDERS; order++) {
            const double height = ink_height(&other[k], order);
            if (fabs(ink_height(&one[k], order) - height) > WIDTHS_AGREE * fabs(height))
                return false;
        }
    return true;
}

/* The nominal inks in the volumes of the learnt ones. */
static void of_volumes(const InkPrior *prior, const Ink learnt[], Ink ink[INKS_MAX]) {
    for (size_t k = 0; k < prior->inks; k++) {
        const Ink nominal = prior->nominal[k];
        const double share = full_layer_height(&learnt[k]) / full_layer_height(&nominal);
        ink[k] = (Ink){share * nominal.h1, share * nominal.h2, share * nominal.h3};
    }
}

/* The increments of the layer with the widths of saturation of these inks, unless they are there. */
static void take_increments(const LearntLayer *learnt, const Ink ink[], size_t inks) {
    if (memcmp(learnt->held, ink, inks * sizeof *ink) == 0)
        return;
    droplet_increments(learnt->layer, learnt->before, inks, ink, learnt->scratch, &learnt->increments, NULL);
    memcpy(learnt->held, ink, inks * sizeof *ink);
}

/* The ink and the increments of the layer, by turns until they agree; the widths of saturation that were taken last. */
static void learn(const InkPrior *prior, const InkEvidence *before, const LearntLayer *learnt, InkEvidence *after,
                  Ink ink[INKS_MAX], Ink widths[INKS_MAX]) {
    const size_t inks = prior->inks;
    const ObservedLayer observed = {learnt->layer,  learnt->part, learnt->clear,   learnt->increments,
                                    learnt->before, learnt->scan, learnt->variance};
    likeliest_inks(prior, before, ink);
    for (int round = 0; round < ROUNDS; round++) {
        memcpy(widths, ink, INKS_MAX * sizeof *ink);
        take_increments(learnt, widths, inks);
        *after = *before;
        add_ink_evidence(prior, &observed, learnt->scratch, learnt->marks, after);
        likeliest_inks(prior, after, ink);
        if (agree(ink, widths, inks))
            return;
    }
}

/* Mean square of what an ink predicts wrong on the cells of the part, beyond the scatter of the scans [m^2]. */
static double prediction_error(const InkPrior *prior, const InkEvidence *evidence, const LearntLayer *learnt) {
    const size_t cells = learnt->layer->nx * learnt->layer->ny;
    PredictionVariance of_scans = *learnt->variance;
    Ink ink[INKS_MAX];
    double sum = 0.0, scatter[FLAT_CELLS];
    size_t count = 0;
    of_scans.droplets = 0.0;
    likeliest_inks(prior, evidence, ink);
    const Ink both[2] = {ink[0], ink[prior->inks - 1]};
    layer_surface(learnt->layer, learnt->before, both, learnt->scratch, learnt->values);
    for (size_t first = 0; first < cells; first += FLAT_CELLS) {
        const size_t some = cells - first < FLAT_CELLS ? cells - first : FLAT_CELLS;
        innovation_variance(&of_scans, first, some, scatter);
        for (size_t k = 0; k < some; k++) {
            const size_t cell = first + k;
            const double wrong = learnt->scan[cell] - learnt->values[cell];
            if (!learnt->part[cell] || !learnt->clear[cell])
                continue;
            sum += wrong * wrong - scatter[k];
            count++;
        }
    }
    return count > 0 ? sum / (double)count : 0.0;
}

static bool is_full_better(const double errors[2]) {
    return errors[FULL] < errors[SCALE] - LEAST_GAIN * fabs(errors[SCALE]);
}

void learn_ink(const InkPrior *prior, const InkKnowledge *before, const LearntLayer *layer, InkKnowledge *after,
               Ink ink[INKS_MAX], Ink widths[INKS_MAX]) {
    *after = *before;
    if (prior->model != INK_FULL) {
        learn(prior, &before->evidence, layer, &after->evidence, ink, widths);
        return;
    }
    InkPrior volumes = *prior;
    volumes.model = INK_SCALE;
    learn(&volumes, &before->volumes, layer, &after->volumes, ink, widths);
    if (memcmp(&after->volumes, &before->volumes, sizeof after->volumes) != 0) { /* a layer of hardly any droplets
                                                                                    shows nothing */
        after->errors[FULL] = FORGETTING * before->errors[FULL] + prediction_error(prior, &before->evidence, layer);
        after->errors[SCALE] = FORGETTING * before->errors[SCALE] + prediction_error(&volumes, &before->volumes, layer);
    }
    learn(prior, &before->evidence, layer, &after->evidence, ink, widths);
    if (!is_full_better(after->errors)) /* the last one learnt leaves the increments */
        learn(&volumes, &before->volumes, layer, &after->volumes, ink, widths);
    LearntLayer last = *layer;
    last.increments.squares = layer->values; /* the variances stay those that the inks were learnt with */
    of_volumes(prior, ink, widths);          /* what droplets spill is surer by the nominal proportions */
    take_increments(&last, widths, prior->inks);
}
