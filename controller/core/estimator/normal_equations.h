/* Normal equations of the unknowns of a scan, with robust weights. */
#ifndef INKLOOP_NORMAL_EQUATIONS_H
#define INKLOOP_NORMAL_EQUATIONS_H

#include "scan_linearisation.h"

/* Adds all readings to the `matrix` (UNKNOWNS * UNKNOWNS) and the right side, weighed by what the move `last` leaves of
 * each; with_strange: those that are far off, too. */
void add_normal_equations(const ScanEvidence *evidence, const Room *room, const double last[UNKNOWNS],
                          bool with_strange, double *matrix, double side[UNKNOWNS]);

#endif
