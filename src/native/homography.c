/* Homographies by the normalised DLT (Hartley 1997), and the distortion of a lens that is seen beside one. See
 * rcdn.geometry.homography and rcdn.geometry.division. */
#include "kernel.h"

enum { UNKNOWNS = 9, ROWS = 64, SWEEPS = 30 };

/* Mean (2) of points (count, 2), and the scale that makes their mean distance from it √2. Returns whether both are
 * finite. */
INLINE int normaliser(index_t count, const double *points, double *mean, double *scale) {
    double x = 0, y = 0, far = 0;
    for (index_t k = 0; k < count; k++) {
        x += points[2 * k];
        y += points[2 * k + 1];
    }
    mean[0] = x / count;
    mean[1] = y / count;
    for (index_t k = 0; k < count; k++) {
        const double dx = points[2 * k] - mean[0], dy = points[2 * k + 1] - mean[1];
        far += sqrt(dx * dx + dy * dy);
    }
    far /= count;
    *scale = 1.4142135623730951 / (far > 1e-12 ? far : 1e-12);
    return far < INFINITY;
}

/* Triangularize the matrix of `rows` rows by Householder reflections; columns are ROWS + UNKNOWNS apart. */
INLINE void triangle(double a[UNKNOWNS][ROWS + UNKNOWNS], index_t rows) {
    for (index_t k = 0; k < UNKNOWNS && k < rows; k++) {
        double length = 0, *restrict v = a[k];
        for (index_t r = k; r < rows; r++)
            length += v[r] * v[r];
        if (!(length > 0))
            continue;
        const double end = v[k] > 0 ? -sqrt(length) : sqrt(length), lift = v[k] - end, factor = 1 / (end * lift);
        v[k] = lift;
        for (index_t c = k + 1; c < UNKNOWNS; c++) {
            double dot = 0, *restrict b = a[c];
            for (index_t r = k; r < rows; r++)
                dot += v[r] * b[r];
            dot *= factor;
            for (index_t r = k; r < rows; r++)
                b[r] += dot * v[r];
        }
        v[k] = end;
        for (index_t r = k + 1; r < rows; r++)
            v[r] = 0;
    }
}

/* Rotate two columns p, q of a matrix. */
INLINE void turn(double *p, double *q, double c, double s) {
    for (index_t r = 0; r < UNKNOWNS; r++) {
        const double x = p[r], y = q[r];
        p[r] = c * x - s * y;
        q[r] = s * x + c * y;
    }
}

/* The right singular vector of the smallest singular value of the triangle, by one-sided Jacobi rotations. */
INLINE void shortest(double a[UNKNOWNS][UNKNOWNS], double *out) {
    double v[UNKNOWNS][UNKNOWNS] = {{0}}, total = 0, least = INFINITY;
    for (index_t k = 0; k < UNKNOWNS; k++) {
        v[k][k] = 1;
        for (index_t r = 0; r < UNKNOWNS; r++)
            total += a[k][r] * a[k][r];
    }
    for (int again = 1, sweep = 0; again && sweep < SWEEPS; sweep++) {
        again = 0;
        for (index_t p = 0; p < UNKNOWNS - 1; p++)
            for (index_t q = p + 1; q < UNKNOWNS; q++) {
                double pp = 0, pq = 0, qq = 0;
                for (index_t r = 0; r < UNKNOWNS; r++) {
                    pp += a[p][r] * a[p][r];
                    pq += a[p][r] * a[q][r];
                    qq += a[q][r] * a[q][r];
                }
                if (!(fabs(pq) > 1e-16 * sqrt(pp * qq) + 1e-32 * total))
                    continue;
                const double ratio = (qq - pp) / (2 * pq), root = sqrt(1 + ratio * ratio);
                const double t = 1 / (ratio + (ratio < 0 ? -root : root)), c = 1 / sqrt(1 + t * t);
                turn(a[p], a[q], c, c * t);
                turn(v[p], v[q], c, c * t);
                again |= fabs(pq) > 1e-15 * sqrt(pp * qq) + 1e-31 * total;
            }
    }
    for (index_t k = 0; k < UNKNOWNS; k++) {
        double length = 0;
        for (index_t r = 0; r < UNKNOWNS; r++)
            length += a[k][r] * a[k][r];
        if (length < least) {
            least = length;
            memcpy(out, v[k], UNKNOWNS * sizeof(double));
        }
    }
}

/* H (3, 3) that maps `from` (count, 2) to `to` (count, 2). Returns 0 if these are not finite. */
INLINE int homography(index_t count, const double *from, const double *to, double *out) {
    double mean[2], other[2], scale, size, a[UNKNOWNS][ROWS + UNKNOWNS], upper[UNKNOWNS][UNKNOWNS], h[UNKNOWNS] = {0};
    if (!(normaliser(count, from, mean, &scale) & normaliser(count, to, other, &size)))
        return 0;
    memset(a, 0, sizeof a);
    for (index_t first = 0; first < count; first += ROWS / 2) { /* below the triangle of the previous rows */
        const index_t n = count - first < ROWS / 2 ? count - first : ROWS / 2;
        for (index_t k = 0; k < n; k++) {
            const double *p = from + 2 * (first + k), *q = to + 2 * (first + k);
            const double x = (p[0] - mean[0]) * scale, y = (p[1] - mean[1]) * scale;
            const double u = (q[0] - other[0]) * size, v = (q[1] - other[1]) * size;
            const double rows[2][UNKNOWNS] = {{x, y, 1, 0, 0, 0, -u * x, -u * y, -u},
                                              {0, 0, 0, x, y, 1, -v * x, -v * y, -v}};
            for (index_t c = 0; c < UNKNOWNS; c++) {
                a[c][UNKNOWNS + 2 * k] = rows[0][c];
                a[c][UNKNOWNS + 2 * k + 1] = rows[1][c];
            }
        }
        triangle(a, UNKNOWNS + 2 * n);
    }
    for (index_t c = 0; c < UNKNOWNS; c++)
        memcpy(upper[c], a[c], UNKNOWNS * sizeof(double));
    shortest(upper, h);
    for (index_t r = 0; r < 3; r++) { /* h · (from, normalised) */
        h[3 * r + 2] -= scale * (h[3 * r] * mean[0] + h[3 * r + 1] * mean[1]);
        h[3 * r] *= scale;
        h[3 * r + 1] *= scale;
    }
    for (index_t c = 0; c < 3; c++) { /* (to, normalised)⁻¹ · h */
        out[c] = h[c] / size + other[0] * h[6 + c];
        out[3 + c] = h[3 + c] / size + other[1] * h[6 + c];
        out[6 + c] = h[6 + c];
    }
    return 1;
}

/* H (3, 3) that maps `from` (count, 2) to `to` (count, 2). Returns 0 if these are not finite. */
FAST_KERNEL(rcdn_homography, (SIZE, count, from, 0), (IN, double, from, count, 2), (IN, double, to, count, 2),
            (OUT, double, out, 3, 3)) {
    return homography(count, from, to, out);
}

/* Root mean square distance of points `off` (count, 2) from those of the `plane` (count, 2) under the best homography and
 * the division model with coefficient `c`; infinite where there is none. `flat` (count, 2): workspace. */
INLINE double division_residual(index_t count, const double *plane, const double *off, double c, double *flat) {
    double H[9], sum = 0;
    for (index_t k = 0; k < count; k++) {
        const double x = off[2 * k], y = off[2 * k + 1], factor = 1 + c * (x * x + y * y);
        flat[2 * k] = x / factor;
        flat[2 * k + 1] = y / factor;
    }
    if (!homography(count, plane, flat, H))
        return INFINITY;
    for (index_t k = 0; k < count; k++) {
        const double *p = plane + 2 * k, depth = H[6] * p[0] + H[7] * p[1] + H[8];
        const double x = (H[0] * p[0] + H[1] * p[1] + H[2]) / depth, y = (H[3] * p[0] + H[4] * p[1] + H[5]) / depth;
        const double stretch = 2 / (1 + sqrt(1 - 4 * c * (x * x + y * y))); /* NaN where the lens shows nothing */
        const double dx = off[2 * k] - stretch * x, dy = off[2 * k + 1] - stretch * y;
        sum += dx * dx + dy * dy;
    }
    const double size = sqrt(sum / count);
    return size < INFINITY ? size : INFINITY;
}

/* The same of each of the `coefficients` (tried). */
FAST_KERNEL(rcdn_division_residuals, (SIZE, count, plane, 0), (SIZE, tried, coefficients, 0),
            (IN, double, coefficients, tried), (IN, double, plane, count, 2), (IN, double, off, count, 2),
            (ROOM, double, room, 2 * count), (OUT, double, out, tried)) {
    for (index_t k = 0; k < tried; k++)
        out[k] = division_residual(count, plane, off, coefficients[k], room);
    return 1;
}
