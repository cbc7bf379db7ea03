/* The readings of a linearised scan as normal equations of its unknowns. */
#ifndef INKLOOP_NORMAL_EQUATIONS_H
#define INKLOOP_NORMAL_EQUATIONS_H

#include "scan_linearisation.h"

enum { REST = UNKNOWNS };

/* By their lower triangle and, in column REST, their right side. */
typedef struct {
    double of[UNKNOWNS][UNKNOWNS + 1];
} NormalSums;

/* Adds the readings, weighed by what a `move` of the unknowns leaves of them. Where they stand in the sums already, by
 * what the move `before` left (NULL: they do not), only what their weights differ by is added: few are outliers.
 * with_strange: readings far off count, too. */
void add_normal_equations(const ScanEvidence *evidence, const Room *room, const double move[UNKNOWNS],
                          const double before[UNKNOWNS], bool with_strange, NormalSums *sums);

#endif
