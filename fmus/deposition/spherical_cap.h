/* A droplet at rest on a plane as a spherical cap, and its parts over the cells of a grid. */
#ifndef INKLOOP_SPHERICAL_CAP_H
#define INKLOOP_SPHERICAL_CAP_H

typedef struct {
    double base_radius, height; /* [m]; the height at most the base radius, that is a contact angle up to 90 degrees */
} SphericalCap;

/* Part of a cap over a rectangle. */
typedef struct {
    double volume; /* [m3] */
    double area;   /* area of the base [m2] */
} CapPart;

double cap_volume(const SphericalCap *cap);

/* The cap of a volume [m3] on a base radius [m]. */
SphericalCap cap_of_volume(double volume, double base_radius);

/* The part over x_low..x_high, y_low..y_high [m] from the middle of the cap; accurate to 1e-11 of the whole cap. */
CapPart cap_over(const SphericalCap *cap, double x_low, double x_high, double y_low, double y_high);

#endif
