/* Wetted ground: droplets spread over the surface, a body fills the convex hull of their footprints. */
#ifndef INKLOOP_FOOTPRINT_H
#define INKLOOP_FOOTPRINT_H

#include "fine_surface.h"

enum { RAYS = 64 };

typedef struct {
    double x, y; /* in spacings from point (0, 0) of the fine surface */
} Place;

/* Base radius of a spherical cap of this volume and contact angle [m] (m3, rad). */
double cap_radius(double volume, double contact_angle);

/* Ends of the rays of a droplet that falls on `site`: along each ray the path over the surface is as long as `radius`
 * [m], times a factor that gives the polygon the area of the circle on level ground. */
void spread_droplet(const FineSurface *surface, Place site, double radius, Place ends[RAYS]);

/* The convex hull, counter-clockwise; sorts `places`, `hull` takes up to count + 1. Returns its number of corners. */
size_t convex_hull(Place *places, size_t count, Place *hull);

#endif
