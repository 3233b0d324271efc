/* Rigid motions of many points, and derivatives by them. See rcdn.geometry.jacobians and rcdn.calibration.bundle. */
#include "elementary.h"
#include "kernel.h"

/* Square of an angle, rad, below which the series of its functions are used */
#define SMALL 1e-8
/* A whole turn, rad */
#define TURN (2 * PI)

/* Rotation matrices out (count, 3, 3) of rotation vectors (count, 3), rad (Rodrigues). */
KERNEL(rcdn_rotations, (SIZE, count, vectors, 0), (IN, double, vectors, count, 3), (OUT, double, out, count, 3, 3)) {
    for (index_t n = 0; n < count; n++) {
        const double x = vectors[3 * n], y = vectors[3 * n + 1], z = vectors[3 * n + 2];
        const double square = x * x + y * y + z * z, angle = sqrt(square);
        double c, s;
        cosine_sine(fmod(angle, TURN), &c, &s);
        const double a = square < SMALL ? 1 - square / 6 : s / angle,
                     b = square < SMALL ? 0.5 - square / 24 : (1 - c) / square;
        const double R[9] = {1 - b * (y * y + z * z), b * x * y - a * z,       b * x * z + a * y,
                             b * x * y + a * z,       1 - b * (x * x + z * z), b * y * z - a * x,
                             b * x * z - a * y,       b * y * z + a * x,       1 - b * (x * x + y * y)};
        memcpy(out + 9 * n, R, sizeof R);
    }
    return 0;
}

/* Points (count, 3) after the motion `number` (count) of T (motions, 4, 4) each. */
KERNEL(rcdn_rigid_points, (SIZE, motions, T, 0), (IN, double, T, motions, 4, 4), (SIZE, count, points, 0),
       (WITHIN, int64_t, number, 0, motions - 1, count), (IN, double, points, count, 3), (OUT, double, out, count, 3)) {
    for (index_t n = 0; n < count; n++) {
        const double *row = T + 16 * number[n], *p = points + 3 * n;
        for (int a = 0; a < 3; a++, row += 4)
            out[3 * n + a] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
    }
    return 0;
}

/* Derivatives out (count, 2, 6) by a small motion, rotation before shift, of what depends on points (count, 3) with the
 * derivatives by_point (count, 2, 3). */
KERNEL(rcdn_rigid_slopes, (SIZE, count, points, 0), (IN, double, by_point, count, 2, 3), (IN, double, points, count, 3),
       (OUT, double, out, count, 2, 6)) {
    for (index_t n = 0; n < count; n++)
        for (int row = 0; row < 2; row++) {
            const double *s = by_point + 3 * (2 * n + row), *p = points + 3 * n;
            double *to = out + 6 * (2 * n + row);
            to[0] = p[1] * s[2] - p[2] * s[1];
            to[1] = p[2] * s[0] - p[0] * s[2];
            to[2] = p[0] * s[1] - p[1] * s[0];
            memcpy(to + 3, s, 3 * sizeof *s);
        }
    return 0;
}

/* Derivatives out (count, 2, 3) by points before the motion `number` (count) of T (motions, 4, 4) each, of what has the
 * derivatives by_point (count, 2, 3) by those after it. */
KERNEL(rcdn_slopes_before, (SIZE, motions, T, 0), (IN, double, T, motions, 4, 4), (SIZE, count, by_point, 0),
       (WITHIN, int64_t, number, 0, motions - 1, count), (IN, double, by_point, count, 2, 3),
       (OUT, double, out, count, 2, 3)) {
    for (index_t n = 0; n < count; n++)
        for (int row = 0; row < 2; row++) {
            const double *R = T + 16 * number[n], *s = by_point + 3 * (2 * n + row);
            for (int a = 0; a < 3; a++)
                out[3 * (2 * n + row) + a] = s[0] * R[a] + s[1] * R[4 + a] + s[2] * R[8 + a];
        }
    return 0;
}
