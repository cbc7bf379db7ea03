/* Heights and shares are multiples of 2^-54 m, a twentieth of a femtometre.
 *
 * Doubles that are such multiples and lie below 0.5 m add and subtract without rounding. So a surface depends on the
 * plan alone, not on the order in which droplets were put and taken: to flip and undo gives the same bits, and a
 * surface kept up to date cell by cell is the one evaluated from scratch. */
#ifndef INKLOOP_LATTICE_H
#define INKLOOP_LATTICE_H

#include <math.h>

/* The nearest multiple: a double between 0.25 and 0.5 has no finer digit. For values within 0.125 m. */
static inline double on_lattice(double metres) {
    const double middle = 0.375;
    return (metres + middle) - middle;
}

/* The same for heights within 0.5 m. */
static inline double height_on_lattice(double metres) {
    return rint(metres * 0x1p54) * 0x1p-54;
}

#endif
