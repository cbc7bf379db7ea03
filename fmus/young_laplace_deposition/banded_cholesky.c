#include "banded_cholesky.h"

#include <math.h>

static size_t below(size_t column, size_t size, size_t bandwidth) {
    const size_t left = size - 1 - column;
    return left < bandwidth ? left : bandwidth;
}

/* Turns a column into one of the factor; false if its diagonal is not positive. */
static bool scale_column(double *column, size_t count) {
    if (!(column[0] > 0.0))
        return false;
    column[0] = sqrt(column[0]);
    const double inverse = 1.0 / column[0];
    for (size_t k = 1; k <= count; k++)
        column[k] *= inverse;
    return true;
}

/* target -= share * one + other_share * other, for rows first .. last */
static void subtract(double *restrict target, double share, const double *restrict one, double other_share,
                     const double *restrict other, size_t first, size_t last) {
    for (size_t row = first; row <= last; row++)
        target[row] -= share * one[row] + other_share * other[row];
}

/* Factorises two columns at a time: the columns right of them are read and written half as often. */
bool band_factor(double *matrix, size_t size, size_t bandwidth) {
    const size_t stride = bandwidth + 1;
    for (size_t column = 0; column < size; column += 2) {
        double *one = matrix + column * stride, *other = one + stride - 1; /* element k of both is in the same row */
        const size_t count = below(column, size, bandwidth);
        if (!scale_column(one, count))
            return false;
        if (column + 1 == size)
            return true;
        for (size_t row = 1; row <= count; row++)
            other[row] -= one[1] * one[row];
        const size_t end = 1 + below(column + 1, size, bandwidth);
        if (!scale_column(other + 1, end - 1))
            return false;
        for (size_t k = 2; k <= end; k++) {
            double *target = one + k * (stride - 1);
            const double share = k > count ? 0.0 : one[k], other_share = other[k];
            subtract(target, share, one, other_share, other, k, count);
            if (end > count)
                target[end] -= other_share * other[end];
        }
    }
    return true;
}

void band_solve(const double *restrict factor, size_t size, size_t bandwidth, double *restrict one,
                double *restrict other) {
    const size_t stride = bandwidth + 1;
    for (size_t column = 0; column < size; column++) {
        const double *pivot = factor + column * stride;
        const double value = one[column] /= pivot[0], other_value = other[column] /= pivot[0];
        const size_t count = below(column, size, bandwidth);
        for (size_t k = 1; k <= count; k++) {
            one[column + k] -= pivot[k] * value;
            other[column + k] -= pivot[k] * other_value;
        }
    }
    for (size_t column = size; column-- > 0;) {
        const double *restrict pivot = factor + column * stride, *below_one = one + column,
                               *below_other = other + column;
        const size_t count = below(column, size, bandwidth);
        double value = 0.0, other_value = 0.0, odd = 0.0, other_odd = 0.0; /* short chains of sums */
        for (size_t k = 1; k + 1 <= count; k += 2) {
            value += pivot[k] * below_one[k];
            other_value += pivot[k] * below_other[k];
            odd += pivot[k + 1] * below_one[k + 1];
            other_odd += pivot[k + 1] * below_other[k + 1];
        }
        if (count % 2 == 1) {
            value += pivot[count] * below_one[count];
            other_value += pivot[count] * below_other[count];
        }
        one[column] = (one[column] - (value + odd)) / pivot[0];
        other[column] = (other[column] - (other_value + other_odd)) / pivot[0];
    }
}
