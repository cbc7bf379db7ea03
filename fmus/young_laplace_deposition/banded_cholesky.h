/* Cholesky factorisation of a symmetric positive definite band matrix. */
#ifndef INKLOOP_BANDED_CHOLESKY_H
#define INKLOOP_BANDED_CHOLESKY_H

#include <stdbool.h>
#include <stddef.h>

/* The lower triangle by columns: element (row, column) at column * (bandwidth + 1) + row - column; elements below the
 * last row are neither read nor written. */

/* Replaces the matrix by its factor L of L L^T; false, and a spoilt matrix, if it is not positive definite. */
bool band_factor(double *matrix, size_t size, size_t bandwidth);

/* Replaces two right-hand sides by their solutions. */
void band_solve(const double *restrict factor, size_t size, size_t bandwidth, double *restrict one,
                double *restrict other);

#endif
