/* Lens models: pixels of camera points with their derivatives, and rays of pixels. See rcdn.geometry.models. */
#include "elementary.h"
#include "kernel.h"

/* CENTRAL: pinhole, brown and rational, with OpenCV's coefficients k1 k2 p1 p2 k3 k4 k5 k6; FISHEYE: Kannala–Brandt's k1
 * to k4; DIVISION: one coefficient. Other coefficients are 0. */
enum { CENTRAL, FISHEYE, DIVISION, COEFFICIENTS = 8, CORE = 4, NEWTON = 20, BISECTIONS = 60 };
CONSTANTS(lens, CENTRAL, FISHEYE, DIVISION, COEFFICIENTS)

/* Angle, rad, below which a point is on the axis for a fisheye's derivatives */
#define NEAR_AXIS 1e-7
/* Distance from the axis below which a point is on it: of a fisheye's point in its own unit, of a pixel in focal lengths */
#define ON_AXIS 1e-12
/* Largest |x / z| and |y / z| of the rays that are looked for */
#define FARTHEST 20.0
/* Largest error of a ray's distorted point, focal lengths, × (1 + radius) for a fisheye */
#define GOOD 1e-10
/* Error below which Newton's method ends, focal lengths */
#define EXACT 1e-13

/* A distorted point, focal lengths, and its derivatives by the point and by the coefficients. */
typedef struct {
    double d[2], by_point[2][3], by_lens[2][COEFFICIENTS];
} Distorted;

/* Denominator of a central lens's radial factor at a squared radius. */
INLINE double denominator(const double *k, double r2) {
    return 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
}

/* Radial factor of a central lens at a squared radius, and its derivative. */
INLINE double radial_factor(const double *k, double r2, double *slope) {
    const double below = denominator(k, r2);
    const double factor = (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / below;
    *slope = (k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]) - factor * (k[5] + r2 * (2 * k[6] + r2 * 3 * k[7]))) / below;
    return factor;
}

/* Distorted point d (2) of the normalised point n (2) of a central lens, and the entries ∂x′/∂x, ∂x′/∂y = ∂y′/∂x, ∂y′/∂y
 * of its Jacobian. */
INLINE void distort_central(const double *k, const double *n, double *d, double *by_n) {
    const double x = n[0], y = n[1], p1 = k[2], p2 = k[3], r2 = x * x + y * y;
    double slope;
    const double g = radial_factor(k, r2, &slope);
    d[0] = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x);
    d[1] = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y;
    by_n[0] = g + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x;
    by_n[1] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
    by_n[2] = g + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
}

INLINE void central_point(const double *k, const double *p, const int slopes, Distorted *out) {
    const double z = p[2] > 0 ? p[2] : NAN, n[2] = {p[0] / z, p[1] / z};
    double s[3];
    distort_central(k, n, out->d, s);
    if (!slopes)
        return;
    for (int a = 0; a < 2; a++) {
        out->by_point[a][0] = s[a] / z;
        out->by_point[a][1] = s[a + 1] / z;
        out->by_point[a][2] = -(s[a] * n[0] + s[a + 1] * n[1]) / z;
    }
    const double r2 = n[0] * n[0] + n[1] * n[1];
    double slope, power = r2 / denominator(k, r2);
    const double g = radial_factor(k, r2, &slope);
    for (int i = 0; i < 3; i++, power *= r2)
        for (int a = 0; a < 2; a++) {
            out->by_lens[a][i < 2 ? i : 4] = n[a] * power;
            out->by_lens[a][5 + i] = -n[a] * power * g;
        }
    out->by_lens[0][2] = out->by_lens[1][3] = 2 * n[0] * n[1];
    out->by_lens[0][3] = r2 + 2 * n[0] * n[0];
    out->by_lens[1][2] = r2 + 2 * n[1] * n[1];
}

/* Radius of a fisheye's point at the angle t from the axis, and its derivative. */
INLINE double fisheye_radius(const double *k, double t, double *slope) {
    const double t2 = t * t;
    *slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
    return t * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
}

/* On the axis, derivatives are their limit, which doesn't depend on the direction of approach; straight behind the
 * camera there is none, nor a point. Squares of far points would overflow without hypot. */
INLINE void fisheye_point(const double *k, const double *p, const int slopes, Distorted *out) {
    const double r = hypot(p[0], p[1]), z = p[2], t = angle_of(r, z), square = r * r + z * z;
    double slope;
    const double ahead = r <= ON_AXIS && z > 0 ? 1 : NAN;
    const double radius = fisheye_radius(k, t, &slope), scale = r > ON_AXIS ? radius / r : ahead;
    out->d[0] = p[0] * scale;
    out->d[1] = p[1] * scale;
    if (!slopes)
        return;
    const int off = t > NEAR_AXIS;
    const double u[2] = {off ? p[0] / r : 0, off ? p[1] / r : 0};
    const double across = off ? (out->d[0] * u[0] + out->d[1] * u[1]) / r : 1 / (fabs(z) > 1e-300 ? fabs(z) : 1e-300),
                 along = off ? slope * z / square : across;
    for (int a = 0; a < 2; a++) {
        double power = t * t * t;
        for (int b = 0; b < 2; b++)
            out->by_point[a][b] = across * ((a == b) - u[a] * u[b]) + along * u[a] * u[b];
        out->by_point[a][2] = u[a] * (-slope * r / square);
        for (int i = 0; i < 4; i++, power *= t * t)
            out->by_lens[a][i] = u[a] * power;
    }
}

/* d ÷ (1 + k·|d|²) = (x, y) ÷ z: of its two roots the one that is 0 on the axis. */
INLINE void division_point(const double *k, const double *p, Distorted *out) {
    const double z = p[2], scale = 2 / (z + sqrt(z * z - 4 * k[0] * (p[0] * p[0] + p[1] * p[1])));
    const int seen = scale > 0 && scale < INFINITY && (z > 0 || k[0] < 0);
    out->d[0] = p[0] * (seen ? scale : NAN);
    out->d[1] = p[1] * (seen ? scale : NAN);
}

INLINE void distort(index_t model, const double *k, const double *p, const int slopes, Distorted *out) {
    if (model == CENTRAL)
        central_point(k, p, slopes, out);
    else if (model == FISHEYE)
        fisheye_point(k, p, slopes, out);
    else
        division_point(k, p, out);
}

/* Pixel xy (2) of a distorted point by the camera matrix K (3, 3). */
INLINE void to_pixel(const double *K, const double *d, double *xy) {
    xy[0] = K[0] * d[0] + K[1] * d[1] + K[2];
    xy[1] = K[4] * d[1] + K[5];
}

/* Pixels xy (count, 2) of camera points (count, 3). k (COEFFICIENTS): those of the lens; shift (count, 2): of the
 * distorted points, focal lengths; or (0, 2). */
KERNEL(rcdn_lens_pixels, (INT, model, CENTRAL, DIVISION), (IN, double, k, COEFFICIENTS), (IN, double, K, 3, 3),
       (SIZE, count, points, 0), (IN, double, points, count, 3), (SIZE, shifted, shift, 0),
       (IN, double, shift, shifted, 2), (WHERE, shifted == 0 || shifted == count), (OUT, double, xy, count, 2)) {
    for (index_t n = 0; n < count; n++) {
        Distorted point;
        distort(model, k, points + 3 * n, 0, &point);
        for (int a = 0; a < 2; a++)
            point.d[a] += shifted ? shift[2 * n + a] : 0;
        to_pixel(K, point.d, xy + 2 * n);
    }
    return 0;
}

/* The same, with derivatives by_point (count, 2, 3), and by_core (count, 2, CORE + used) by fx fy cx cy and the first
 * `used` coefficients, for a camera matrix without skew. by_shift (shifted, 2, 3): derivatives of `shift` by the point.
 * Not for the model DIVISION. */
KERNEL(rcdn_lens_slopes, (INT, model, CENTRAL, FISHEYE), (IN, double, k, COEFFICIENTS), (IN, double, K, 3, 3),
       (SIZE, count, points, 0), (IN, double, points, count, 3), (SIZE, shifted, shift, 0),
       (IN, double, shift, shifted, 2), (IN, double, by_shift, shifted, 2, 3),
       (WHERE, shifted == 0 || shifted == count), (OUT, double, xy, count, 2), (OUT, double, by_point, count, 2, 3),
       (SIZE, width, by_core, 2), (WHERE, CORE <= width && width <= CORE + COEFFICIENTS),
       (OUT, double, by_core, count, 2, width)) {
    for (index_t n = 0; n < count; n++) {
        Distorted point = {{0}}; /* coefficients that a model hasn't have no effect */
        distort(model, k, points + 3 * n, 1, &point);
        for (int a = 0; a < 2; a++) {
            const double f = K[4 * a];
            double *core = by_core + (2 * n + a) * width;
            point.d[a] += shifted ? shift[2 * n + a] : 0;
            for (int b = 0; b < 3; b++)
                by_point[(2 * n + a) * 3 + b] =
                    (point.by_point[a][b] + (shifted ? by_shift[(2 * n + a) * 3 + b] : 0)) * f;
            core[a] = point.d[a];
            core[1 - a] = core[3 - a] = 0;
            core[2 + a] = 1;
            for (index_t i = CORE; i < width; i++)
                core[i] = point.by_lens[a][i - CORE] * f;
        }
        to_pixel(K, point.d, xy + 2 * n);
    }
    return 0;
}

/* Normalised point n (2) that a central lens maps to d (2), by Newton's method from n; whether it is one, within the
 * radius `limit`. */
INLINE int newton_central(const double *k, const double *d, double limit, double *n) {
    double e[2], at[2], s[3];
    for (int step = 0; step < NEWTON; step++) {
        distort_central(k, n, at, s);
        double det = s[0] * s[2] - s[1] * s[1];
        det = fabs(det) > 1e-6 ? det : 1e-6;
        e[0] = at[0] - d[0];
        e[1] = at[1] - d[1];
        const double x = n[0] - (s[2] * e[0] - s[1] * e[1]) / det, y = n[1] - (s[0] * e[1] - s[1] * e[0]) / det;
        n[0] = x < -FARTHEST ? -FARTHEST : x > FARTHEST ? FARTHEST : x;
        n[1] = y < -FARTHEST ? -FARTHEST : y > FARTHEST ? FARTHEST : y;
        if (fabs(e[0]) < EXACT && fabs(e[1]) < EXACT)
            break;
    }
    distort_central(k, n, at, s); /* beyond the fold the inverse isn't unique */
    return fabs(at[0] - d[0]) <= GOOD && fabs(at[1] - d[1]) <= GOOD && n[0] * n[0] + n[1] * n[1] < limit * limit;
}

/* Radius (central) or angle (fisheye) within 0..high, where it increases, that is mapped to `value`: by bisection to the
 * last bit, slow, but always convergent. */
INLINE double bisected(index_t model, const double *k, double value, double high) {
    double low = 0, slope;
    for (int step = 0; step < BISECTIONS; step++) {
        const double middle = (low + high) / 2;
        const double radius =
            model == CENTRAL ? middle * radial_factor(k, middle * middle, &slope) : fisheye_radius(k, middle, &slope);
        if (radius > value)
            high = middle;
        else
            low = middle;
    }
    return low;
}

/* Newton's method starts at the distorted point and, where that fails, at the inverse of the radial map. */
INLINE void ray_central(const double *k, const double *d, double limit, double *ray) {
    double n[2] = {d[0], d[1]};
    int found = newton_central(k, d, limit, n);
    const double r = length_of(d[0], d[1]);
    if (!found && r < INFINITY) {
        const double end = limit * (1 - 1e-12), high = end < FARTHEST ? end : FARTHEST; /* a pole has no value */
        const double share = bisected(CENTRAL, k, r, high) / (r > ON_AXIS ? r : ON_AXIS);
        n[0] = d[0] * share;
        n[1] = d[1] * share;
        found = newton_central(k, d, limit, n);
    }
    ray[0] = found ? n[0] : NAN;
    ray[1] = found ? n[1] : NAN;
    ray[2] = 1;
}

INLINE void ray_fisheye(const double *k, const double *d, double limit, double *ray) {
    const double r = length_of(d[0], d[1]);
    double slope, t = r < PI ? r : PI, cosine, sine;
    for (int step = 0; step < NEWTON; step++) {
        const double before = t, e = fisheye_radius(k, t, &slope) - r;
        t -= e / (fabs(slope) > 1e-3 ? slope : 1e-3);
        t = t < 0 ? 0 : t > PI ? PI : t;
        if (t == before)
            break;
    }
    if (!(fabs(fisheye_radius(k, t, &slope) - r) < GOOD * (1 + r) && t <= limit))
        t = r <= fisheye_radius(k, limit, &slope) ? bisected(FISHEYE, k, r, limit) : NAN;
    cosine_sine(t, &cosine, &sine);
    const double scale = r > ON_AXIS ? sine / r : 1;
    ray[0] = d[0] * scale;
    ray[1] = d[1] * scale;
    ray[2] = cosine;
}

/* NaN beyond the fold at k·|d|² = 1 (k > 0). */
INLINE void ray_division(const double *k, const double *d, double *ray) {
    const double square = k[0] * (d[0] * d[0] + d[1] * d[1]), z = 1 + square;
    const double length = square <= 1 ? sqrt(d[0] * d[0] + d[1] * d[1] + z * z) : NAN;
    ray[0] = d[0] / length;
    ray[1] = d[1] / length;
    ray[2] = z / length;
}

/* Rays (count, 3) that a lens maps to the distorted points d (count, 2): of unit z if it is CENTRAL, else of unit
 * length; NaN where there is none before the fold, at the radius or angle `limit`. */
KERNEL(rcdn_lens_rays, (INT, model, CENTRAL, DIVISION), (IN, double, k, COEFFICIENTS), (REAL, limit),
       (SIZE, count, d, 0), (IN, double, d, count, 2), (OUT, double, rays, count, 3)) {
    for (index_t n = 0; n < count; n++)
        if (model == CENTRAL)
            ray_central(k, d + 2 * n, limit, rays + 3 * n);
        else if (model == FISHEYE)
            ray_fisheye(k, d + 2 * n, limit, rays + 3 * n);
        else
            ray_division(k, d + 2 * n, rays + 3 * n);
    return 0;
}
