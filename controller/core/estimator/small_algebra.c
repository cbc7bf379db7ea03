#include "small_algebra.h"

#include <math.h>
#include <string.h>

static const double SINGULAR = 1e-12; /* of a diagonal entry: what is left of it there is rounding (assumed) */
enum { SWEEPS_MAX = 30 };             /* of Jacobi's method; some six reach the last bit */

bool solve_definite(size_t n, const double *a, double *b) {
    double l[ENTRIES_MAX] = {0.0};
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j <= i; j++) {
            double left = a[i * n + j];
            for (size_t k = 0; k < j; k++)
                left -= l[i * n + k] * l[j * n + k];
            if (i == j && !(left > SINGULAR * a[i * n + i]))
                return false;
            l[i * n + j] = i == j ? sqrt(left) : left / l[j * n + j];
        }
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t k = 0; k < i; k++)
            b[i] -= l[i * n + k] * b[k];
        b[i] /= l[i * n + i];
    }
    for (size_t i = n; i-- > 0;) {
        for (size_t k = i + 1; k < n; k++)
            b[i] -= l[k * n + i] * b[k];
        b[i] /= l[i * n + i];
    }
    return true;
}

/* One rotation that makes entry (p, q) zero (Jacobi 1846; Golub and Van Loan, 8.5.2). */
static void rotate(size_t n, double *a, double *vectors, size_t p, size_t q) {
    const double tau = (a[q * n + q] - a[p * n + p]) / (2.0 * a[p * n + q]);
    const double t = (tau >= 0.0 ? 1.0 : -1.0) / (fabs(tau) + sqrt(1.0 + tau * tau));
    const double c = 1.0 / sqrt(1.0 + t * t), s = t * c;
    for (size_t k = 0; k < n; k++) {
        const double left = a[k * n + p], right = a[k * n + q];
        a[k * n + p] = c * left - s * right;
        a[k * n + q] = s * left + c * right;
    }
    for (size_t k = 0; k < n; k++) {
        const double upper = a[p * n + k], lower = a[q * n + k];
        a[p * n + k] = c * upper - s * lower;
        a[q * n + k] = s * upper + c * lower;
        const double left = vectors[k * n + p], right = vectors[k * n + q];
        vectors[k * n + p] = c * left - s * right;
        vectors[k * n + q] = s * left + c * right;
    }
    a[p * n + q] = a[q * n + p] = 0.0;
}

/* Eigenvalues on the diagonal of `a`, eigenvectors in the columns of `vectors`. */
static void diagonalise(size_t n, double *a, double *vectors) {
    for (size_t k = 0; k < n * n; k++)
        vectors[k] = k / n == k % n ? 1.0 : 0.0;
    for (int sweep = 0; sweep < SWEEPS_MAX; sweep++) {
        bool is_diagonal = true;
        for (size_t p = 0; p < n; p++) {
            for (size_t q = p + 1; q < n; q++) {
                if (fabs(a[p * n + q]) <= 1e-17 * sqrt(fabs(a[p * n + p] * a[q * n + q])))
                    continue;
                is_diagonal = false;
                rotate(n, a, vectors, p, q);
            }
        }
        if (is_diagonal)
            return;
    }
}

void pseudo_inverse(size_t n, const double *a, double relative, double *inverse) {
    double values[ENTRIES_MAX], vectors[ENTRIES_MAX], largest = 0.0;
    memcpy(values, a, n * n * sizeof(double));
    diagonalise(n, values, vectors);
    for (size_t k = 0; k < n; k++)
        largest = fmax(largest, fabs(values[k * n + k]));
    memset(inverse, 0, n * n * sizeof(double));
    for (size_t k = 0; k < n; k++) {
        if (!(fabs(values[k * n + k]) > relative * largest))
            continue;
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < n; j++)
                inverse[i * n + j] += vectors[i * n + k] * vectors[j * n + k] / values[k * n + k];
    }
}

bool invert_definite(size_t n, const double *matrix, double *inverse) {
    for (size_t k = 0; k < n; k++) {
        double column[UNKNOWNS_MAX] = {0.0};
        column[k] = 1.0;
        if (!solve_definite(n, matrix, column))
            return false;
        for (size_t i = 0; i < n; i++)
            inverse[i * n + k] = column[i];
    }
    return true;
}

bool is_zero(const double *values, size_t count) {
    for (size_t k = 0; k < count; k++)
        if (values[k] != 0.0)
            return false;
    return true;
}
