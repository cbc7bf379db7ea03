/* Linear algebra of a handful of unknowns: symmetric matrices of n * n values in C order, n at most UNKNOWNS_MAX. */
#ifndef INKLOOP_SMALL_ALGEBRA_H
#define INKLOOP_SMALL_ALGEBRA_H

#include <stdbool.h>
#include <stddef.h>

enum { UNKNOWNS_MAX = 19, ENTRIES_MAX = UNKNOWNS_MAX * UNKNOWNS_MAX };

/* Solves a x = b for a positive definite `a`; x comes in `b`. False, and `b` unchanged, if it is singular to rounding.
 */
bool solve_definite(size_t n, const double *a, double *b);

/* Inverse of a positive definite matrix; false if it is singular to rounding. */
bool invert_definite(size_t n, const double *matrix, double *inverse);

#endif
