#include "objective.h"

#include <math.h>

static double variance(const Sums *sums, double count) {
    const double mean = sums->height / count;
    return fmax(sums->squared_height / count - mean * mean, 0.0);
}

double deviation(const Sums *sums, const Weighting *weighting) {
    return sqrt(variance(sums, weighting->count));
}

double objective(const Sums *sums, const Weighting *weighting) {
    const double mean_cost = sums->cost / weighting->count;
    return weighting->alpha * mean_cost + (1.0 - weighting->alpha) * deviation(sums, weighting);
}

double objective_change(const Sums *sums, const Sums *change, const Weighting *weighting) {
    const double count = weighting->count;
    const double mean_cost_change = change->cost / count;
    if (weighting->alpha == 1.0)
        return mean_cost_change;
    const double variance_change =
        change->squared_height / count - change->height * (2.0 * sums->height + change->height) / (count * count);
    const double before = variance(sums, count);
    const double deviations = sqrt(before) + sqrt(fmax(before + variance_change, 0.0));
    const double deviation_change = deviations > 0.0 ? variance_change / deviations : 0.0;
    return weighting->alpha * mean_cost_change + (1.0 - weighting->alpha) * deviation_change;
}
