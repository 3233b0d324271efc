/* Solvers of small linear systems. Each keeps its order of operations, and with it the last bits of what is built on
 * it: systems of two and three unknowns by cofactors; positive definite ones by elimination, by blocks for many
 * unknowns, by Gauss–Jordan where the inverse is wanted, and by Cholesky's factor where its inverse is; least squares by
 * Gram–Schmidt. Sizes are constants at each call, but for Cholesky's factor, so that loops are compiled for them. */
#ifndef RCDN_SOLVERS_H
#define RCDN_SOLVERS_H

#include "elementary.h"

/* Solve (a b; c d) x = (u, v) by cofactors, to `out` (2). Returns the determinant; where it is 0, `out` is of no use.
 */
INLINE double solve_two(double a, double b, double c, double d, double u, double v, double out[2]) {
    const double det = a * d - b * c;
    out[0] = (d * u - b * v) / det;
    out[1] = (a * v - c * u) / det;
    return det;
}

/* Solve (a b c; b d f; c f g) x = (u, v, w) by cofactors, to `out` (3). */
INLINE void solve_three(double a, double b, double c, double d, double f, double g, double u, double v, double w,
                        double out[3]) {
    const double aa = d * g - f * f, bb = c * f - b * g, cc = b * f - c * d, det = a * aa + b * bb + c * cc;
    out[0] = (aa * u + bb * v + cc * w) / det;
    out[1] = (bb * u + (a * g - c * c) * v + (b * c - a * f) * w) / det;
    out[2] = (cc * u + (b * c - a * f) * v + (a * d - b * b) * w) / det;
}

/* Solve the positive definite m (n, n) x = pull (n, 2) in place, by elimination; only the upper triangle of `m` is
 * used. */
INLINE void solve_definite(index_t n, double *m, double *pull) {
    for (index_t k = 0; k < n; k++) {
        const double inverse = 1 / m[k * n + k];
        for (index_t r = k + 1; r < n; r++) {
            const double c = m[k * n + r] * inverse;
            for (index_t j = r; j < n; j++)
                m[r * n + j] -= c * m[k * n + j];
            pull[2 * r] -= c * pull[2 * k];
            pull[2 * r + 1] -= c * pull[2 * k + 1];
        }
    }
    for (index_t k = n - 1; k >= 0; k--)
        for (index_t a = 0; a < 2; a++) {
            double sum = pull[2 * k + a];
            for (index_t j = k + 1; j < n; j++)
                sum -= m[k * n + j] * pull[2 * j + a];
            pull[2 * k + a] = sum / m[k * n + k];
        }
}

/* Least pivot of a matrix with unit diagonal; most rows of a matrix that is inverted. */
#define LEAST_PIVOT 1e-13
#define INVERTIBLE 16

INLINE void subtract_row(index_t width, double *restrict row, const double *restrict pivot, double share) {
    for (index_t j = 0; j < width; j++)
        row[j] -= share * pivot[j];
}

INLINE void rescale(index_t n, index_t width, double *m, const double *size) {
    for (index_t k = 0; k < n; k++)
        for (index_t j = 0; j < width; j++)
            m[k * width + j] *= size[k] * size[j];
}

/* Invert a symmetric positive definite matrix in the first n rows and columns of `m` (., width), in place; width is at
 * most INVERTIBLE. A direction that rounding has left without stiffness is given a small one. */
INLINE void invert_definite(index_t n, index_t width, double *m) {
    double size[INVERTIBLE], row[INVERTIBLE];
    for (index_t k = 0; k < width; k++)
        size[k] = k < n ? 1 / sqrt(m[k * width + k]) : 0;
    rescale(n, width, m, size);
    for (index_t k = 0; k < n; k++) {
        double *own = m + k * width;
        const double share = 1 / (own[k] > LEAST_PIVOT ? own[k] : LEAST_PIVOT);
        for (index_t j = 0; j < width; j++) {
            row[j] = own[j] * share;
            own[j] = 0;
        }
        row[k] = 1 + share; /* so that - share × the old column k remains in it */
        for (index_t i = 0; i < n; i++)
            subtract_row(width, m + i * width, row, m[i * width + k]);
        row[k] = share;
        for (index_t j = 0; j < width; j++)
            own[j] = row[j];
    }
    rescale(n, width, m, size);
}

/* Cholesky's lower factor in place of a symmetric matrix m (n, n), whose rows lie `stride` apart, from its lower
 * triangle. Returns whether it is positive definite. */
INLINE int factorise(index_t n, index_t stride, double *m) {
    for (index_t k = 0; k < n; k++)
        for (index_t j = 0; j <= k; j++) {
            double *row = m + k * stride, *other = m + j * stride, sum = row[j];
            for (index_t l = 0; l < j; l++)
                sum -= row[l] * other[l];
            if (j == k && !(sum > 0))
                return 0;
            row[j] = j < k ? sum / other[j] : sqrt(sum);
        }
    return 1;
}

/* Inverse in place of a lower triangular matrix m (n, n), whose rows lie `stride` apart, and the sum of its squares: the
 * trace of the inverse of the matrix whose factor it is. */
INLINE double invert_lower(index_t n, index_t stride, double *m) {
    double trace = 0;
    for (index_t k = 0; k < n; k++) {
        double *row = m + k * stride;
        const double pivot = row[k];
        for (index_t j = 0; j < k; j++) {
            double sum = 0;
            for (index_t l = j; l < k; l++)
                sum += row[l] * m[l * stride + j];
            m[k + j * stride] = -sum / pivot; /* in the upper triangle, until the whole row is there */
        }
        for (index_t j = 0; j < k; j++) {
            row[j] = m[k + j * stride];
            trace += row[j] * row[j];
        }
        row[k] = 1 / pivot;
        trace += row[k] * row[k];
    }
    return trace;
}

/* Unknowns that are eliminated together. */
enum { PANEL = 8 };

/* a, b (columns from..to) += PANEL rows that lie `stride` apart, times ca, cb. */
INLINE void add_rows(double *restrict a, double *restrict b, const double *rows, index_t stride, const double *ca,
                     const double *cb, index_t from, index_t to) {
    const double a0 = ca[0], a1 = ca[1], a2 = ca[2], a3 = ca[3], a4 = ca[4], a5 = ca[5], a6 = ca[6], a7 = ca[7];
    const double b0 = cb[0], b1 = cb[1], b2 = cb[2], b3 = cb[3], b4 = cb[4], b5 = cb[5], b6 = cb[6], b7 = cb[7];
    const double *restrict r0 = rows, *restrict r1 = r0 + stride, *restrict r2 = r1 + stride,
                           *restrict r3 = r2 + stride;
    const double *restrict r4 = r3 + stride, *restrict r5 = r4 + stride, *restrict r6 = r5 + stride,
                           *restrict r7 = r6 + stride;
    for (index_t j = from; j < to; j++) {
        a[j] += a0 * r0[j] + a1 * r1[j] + a2 * r2[j] + a3 * r3[j] + a4 * r4[j] + a5 * r5[j] + a6 * r6[j] + a7 * r7[j];
        b[j] += b0 * r0[j] + b1 * r1[j] + b2 * r2[j] + b3 * r3[j] + b4 * r4[j] + b5 * r5[j] + b6 * r6[j] + b7 * r7[j];
    }
}

/* Cholesky: eliminate the unknowns `first`..`last` (multiples of PANEL) from m (rows, stride), with an even number of
 * rows. Rows of unknowns become those of the upper factor; further columns are right-hand sides and become their
 * forward substitutions; further rows become the Schur complement. Returns the log of the determinant. */
INLINE double eliminate_blocks(double *m, index_t first, index_t last, index_t rows, index_t stride) {
    double log_det = 0;
    for (index_t top = first; top < last; top += PANEL) {
        double det = 1;
        for (index_t k = top; k < top + PANEL; k++) {
            double *restrict row = m + k * stride;
            for (index_t l = top; l < k; l++) {
                const double *restrict above = m + l * stride;
                const double c = above[k];
                for (index_t j = top; j < stride; j++)
                    row[j] -= c * above[j];
            }
            det *= row[k];
            const double scale = 1 / sqrt(row[k]);
            for (index_t j = top; j < stride; j++)
                row[j] *= scale;
        }
        log_det += natural_log(det);
        for (index_t i = top + PANEL; i < rows; i += 2) {
            double ca[PANEL], cb[PANEL];
            for (index_t k = 0; k < PANEL; k++) {
                ca[k] = -m[(top + k) * stride + i];
                cb[k] = -m[(top + k) * stride + i + 1];
            }
            add_rows(m + i * stride, m + (i + 1) * stride, m + top * stride, stride, ca, cb, i & ~(index_t)(PANEL - 1),
                     stride);
        }
    }
    return log_det;
}

/* Least squares of at most so many rows and columns, and the number of right-hand sides. */
#define MOST_ROWS 48
#define MOST_TERMS 6
#define RIGHT_SIDES 2
/* Squared length, relative to the longest column's, below which the remainder of a column counts as zero. Offsets are
 * small integers: a non-zero remainder has more than 1e-6. */
#define NOTHING 1e-16

typedef double Columns[MOST_TERMS + RIGHT_SIDES][MOST_ROWS];

INLINE double dot(const double *a, const double *b, index_t n) {
    double sum = 0;
    for (index_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Orthonormalise the columns, the longest remaining one first (modified Gram-Schmidt), together with the right-hand
 * sides: r (terms, terms + sides) by column, `order` of the columns. Returns the rank. */
INLINE index_t orthogonal(Columns a, index_t n, index_t terms, double r[MOST_TERMS][MOST_TERMS + RIGHT_SIDES],
                          index_t *order) {
    double left[MOST_TERMS], longest = 0;
    for (index_t j = 0; j < terms; j++) {
        order[j] = j;
        left[j] = dot(a[j], a[j], n);
        longest = fmax(longest, left[j]);
    }
    for (index_t k = 0; k < terms; k++) {
        index_t best = k;
        for (index_t j = k + 1; j < terms; j++)
            best = left[order[j]] > left[order[best]] ? j : best;
        const index_t own = order[best];
        order[best] = order[k];
        order[k] = own;
        if (!(left[own] > NOTHING * longest))
            return k;
        r[k][own] = sqrt(left[own]);
        double *q = a[own];
        const double scale = 1 / r[k][own];
        for (index_t i = 0; i < n; i++)
            q[i] *= scale;
        for (index_t j = k + 1; j < terms + RIGHT_SIDES; j++) {
            const index_t other = j < terms ? order[j] : MOST_TERMS + j - terms;
            double *rest = a[other];
            const double share = dot(q, rest, n);
            double square = 0;
            for (index_t i = 0; i < n; i++) {
                rest[i] -= share * q[i];
                square += rest[i] * rest[i];
            }
            r[k][other] = share;
            if (j < terms)
                left[other] = square;
        }
    }
    return terms;
}

/* The solution (terms) by back substitution, for one right-hand side. */
INLINE void substitute(double r[MOST_TERMS][MOST_TERMS + RIGHT_SIDES], const index_t *order, index_t terms,
                       index_t side, double *x) {
    for (index_t k = terms - 1; k >= 0; k--) {
        double sum = r[k][MOST_TERMS + side];
        for (index_t j = k + 1; j < terms; j++)
            sum -= r[k][order[j]] * x[order[j]];
        x[order[k]] = sum / r[k][order[k]];
    }
}

/* The solution of least norm of an underdetermined system: rows of r are orthonormalised, r = L Z, L w = right-hand
 * side, x = Z' w. */
INLINE void smallest(double r[MOST_TERMS][MOST_TERMS + RIGHT_SIDES], const index_t *order, index_t terms, index_t rank,
                     double x[RIGHT_SIDES][MOST_TERMS]) {
    double z[MOST_TERMS][MOST_TERMS] = {{0}}, w[RIGHT_SIDES];
    for (index_t k = 0; k < rank; k++) {
        for (index_t j = k; j < terms; j++)
            z[k][order[j]] = r[k][order[j]];
        for (int side = 0; side < RIGHT_SIDES; side++)
            w[side] = r[k][MOST_TERMS + side];
        for (index_t i = 0; i < k; i++) {
            const double share = dot(z[i], z[k], terms);
            for (index_t j = 0; j < terms; j++)
                z[k][j] -= share * z[i][j];
            for (int side = 0; side < RIGHT_SIDES; side++)
                w[side] -= share * r[i][MOST_TERMS + side];
        }
        const double length = sqrt(dot(z[k], z[k], terms));
        for (index_t j = 0; j < terms; j++)
            z[k][j] /= length;
        for (int side = 0; side < RIGHT_SIDES; side++) {
            r[k][MOST_TERMS + side] = w[side] / length;
            for (index_t j = 0; j < terms; j++)
                x[side][j] = (k ? x[side][j] : 0) + r[k][MOST_TERMS + side] * z[k][j];
        }
    }
}

#endif
