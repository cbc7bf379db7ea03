#include "footprint.h"

#include <math.h>
#include <stdlib.h>

static const double PI = 3.14159265358979323846;
static const double STEP = 0.25; /* of a ray, in spacings */

double cap_radius(double volume, double contact_angle) {
    const double t = tan(0.5 * contact_angle); /* height over radius; V = pi h (3 r^2 + h^2) / 6 */
    return cbrt(6.0 * volume / (PI * t * (3.0 + t * t)));
}

/* Distance of a ray in the plane, in spacings, at which its path over the surface has this length. */
static double march(const FineSurface *surface, Place site, double along_x, double along_y, double length) {
    double way = 0.0, path = 0.0, last = height_at(surface, site.x, site.y);
    for (;;) {
        const double next = way + STEP;
        const double height = height_at(surface, site.x + next * along_x, site.y + next * along_y);
        const double climb = (height - last) / surface->spacing, piece = sqrt(STEP * STEP + climb * climb);
        if (path + piece >= length)
            return way + STEP * (length - path) / piece;
        path += piece;
        way = next;
        last = height;
    }
}

void spread_droplet(const FineSurface *surface, Place site, double radius, Place ends[RAYS]) {
    const double angle = 2.0 * PI / RAYS;
    const double length = radius / surface->spacing * sqrt(angle / sin(angle));
    for (int ray = 0; ray < RAYS; ray++) {
        const double along_x = cos(ray * angle), along_y = sin(ray * angle);
        const double way = march(surface, site, along_x, along_y, length);
        ends[ray] = (Place){site.x + way * along_x, site.y + way * along_y};
    }
}

static int by_x(const void *left, const void *right) {
    const Place *a = left, *b = right;
    if (a->x != b->x)
        return a->x < b->x ? -1 : 1;
    return a->y < b->y ? -1 : a->y > b->y;
}

/* Above 0 where a, b, c turn to the left. */
static double turn(Place a, Place b, Place c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/* Andrew's monotone chain: the lower side from the left, then the upper side back. */
size_t convex_hull(Place *places, size_t count, Place *hull) {
    qsort(places, count, sizeof *places, by_x);
    size_t size = 0;
    for (size_t k = 0; k < count; k++) {
        while (size >= 2 && turn(hull[size - 2], hull[size - 1], places[k]) <= 0.0)
            size--;
        hull[size++] = places[k];
    }
    const size_t lower = size + 1;
    for (size_t k = count - 1; k-- > 0;) {
        while (size >= lower && turn(hull[size - 2], hull[size - 1], places[k]) <= 0.0)
            size--;
        hull[size++] = places[k];
    }
    return size - 1;
}
