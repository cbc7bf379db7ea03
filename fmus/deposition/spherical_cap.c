#include "spherical_cap.h"

#include <math.h>

enum { NODES = 8, PANELS = 4, MOST_BREAKS = 6 };
static const double PI = 3.14159265358979323846;

/* Gauss-Legendre rule of 8 nodes on -1..1, the half above 0. */
static const double NODE[NODES / 2] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363};
static const double WEIGHT[NODES / 2] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                         0.1012285362903763};

double cap_volume(const SphericalCap *cap) {
    return PI / 6.0 * cap->height * (3.0 * cap->base_radius * cap->base_radius + cap->height * cap->height);
}

/* a^3 + 3 r^2 a = 6 V / pi, solved by a = 2 r sinh t. */
SphericalCap cap_of_volume(double volume, double base_radius) {
    const double r = base_radius;
    return (SphericalCap){r, 2.0 * r * sinh(asinh(3.0 * volume / (PI * r * r * r)) / 3.0)};
}

/* Node `k` of PANELS rules side by side on low..high, and its weight. The panels are equal in s after the substitution
 * (3 s - s^3) / 2, whose slope is 0 at both ends: where the rim crosses a side the integrands behave like the power 3/2
 * of the distance. */
static double node(double low, double high, int k, double *weight) {
    const double half = 0.5 * (high - low);
    const double sign = k % 2 == 0 ? 1.0 : -1.0;
    const double s = (2 * (k / NODES) + 1 + sign * NODE[k % NODES / 2]) / PANELS - 1.0;
    *weight = half * 1.5 * (1.0 - s * s) * WEIGHT[k % NODES / 2] / PANELS;
    return low + half * (1.0 + 0.5 * s * (3.0 - s * s));
}

static double clipped(double value, double limit) {
    return fmax(-limit, fmin(limit, value));
}

/* Volume over the strip of width dx at a distance x from the middle, between low and high, per dx. With half the chord
 * w and y = w sin(angle) the profile is smooth up to the rim: w^2 cos^2 / (root + centre), free of cancellation. */
static double strip(const SphericalCap *cap, double chord, double low, double high) {
    const double r = cap->base_radius, a = cap->height;
    const double sphere = (r * r + a * a) / (2.0 * a), centre = sphere - a;
    const double from = asin(clipped(low / chord, 1.0)), to = asin(clipped(high / chord, 1.0));
    double sum = 0.0;
    for (int k = 0; k < PANELS * NODES; k++) {
        double weight;
        const double across = chord * cos(node(from, to, k, &weight));
        sum += weight * across * (across * across) / (sqrt(centre * centre + across * across) + centre);
    }
    return sum;
}

/* Angles at which x = r sin(angle) enters or leaves the rectangle, or the rim crosses one of its sides; ascending. */
static int breaks(double r, double x_low, double x_high, double y_low, double y_high, double angle[MOST_BREAKS]) {
    const double first = asin(clipped(x_low / r, 1.0)), last = asin(clipped(x_high / r, 1.0));
    const double low = acos(clipped(y_low / r, 1.0)), high = acos(clipped(y_high / r, 1.0));
    const double found[] = {-fmin(low, PI - low), -fmin(high, PI - high), fmin(low, PI - low), fmin(high, PI - high)};
    int count = 0;
    angle[count++] = first;
    for (int k = 0; k < 4; k++) {
        if (found[k] <= first || found[k] >= last)
            continue;
        int place = count++;
        for (; angle[place - 1] > found[k]; place--)
            angle[place] = angle[place - 1];
        angle[place] = found[k];
    }
    angle[count++] = last;
    return count;
}

CapPart cap_over(const SphericalCap *cap, double x_low, double x_high, double y_low, double y_high) {
    const double r = cap->base_radius;
    double angle[MOST_BREAKS];
    const int count = breaks(r, x_low, x_high, y_low, y_high, angle);
    CapPart part = {0.0, 0.0};
    for (int piece = 0; piece + 1 < count; piece++) {
        for (int k = 0; k < PANELS * NODES; k++) {
            double weight;
            const double chord = r * cos(node(angle[piece], angle[piece + 1], k, &weight));
            const double low = fmax(y_low, -chord), high = fmin(y_high, chord);
            if (high <= low)
                continue;
            part.volume += weight * chord * strip(cap, chord, low, high);
            part.area += weight * chord * (high - low);
        }
    }
    return part;
}
