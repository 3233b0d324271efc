/* Pixel tests of the board recovery: see boards/edges.py. */
#include "sampling.h"

/* Grey levels (n,) at `xy` (n, 2); the border is replicated. */
FAST_KERNEL(rcdn_sample, (PICTURE, p), (SIZE, n, xy, 0), (IN, double, xy, n, 2), (OUT, double, out, n)) {
    const index_t height = p.height, width = p.width;
    const index_t right = width > 1, down = height > 1 ? width : 0;
    for (index_t k = 0; k < n; k++) {
        const double x = limited(xy[2 * k], 0, (double)(width - 1)),
                     y = limited(xy[2 * k + 1], 0, (double)(height - 1));
        const index_t i = (index_t)limited(x, 0, (double)(width - 1 - right)),
                      j = (index_t)limited(y, 0, (double)(height - 1 - (down > 0)));
        const double fx = x - (double)i, fy = y - (double)j;
        const index_t at = j * width + i;
        const double a = pixel(&p, at), b = pixel(&p, at + right), c = pixel(&p, at + down),
                     d = pixel(&p, at + down + right);
        const double top = a + fx * (b - a), low = c + fx * (d - c);
        out[k] = top + fy * (low - top);
    }
    return 0;
}

/* Contrast `out` (n, 3) of links `start` → `end` (n, 2), or `close` to them. */
FAST_KERNEL(rcdn_edge_contrast, (PICTURE, p), (SIZE, n, start, 0), (IN, double, start, n, 2), (IN, double, end, n, 2),
            (INT, close, 0, 1), (OUT, double, out, n, 3)) {
    Places w;
    for (index_t k = 0; k < n; k++)
        sides_differ(&p, start + 2 * k, end + 2 * k, (int)close, &w, out + 3 * k);
    return 0;
}

/* Steps (n, 2) of the grey level across links `start` → `end` (n, 2), within 0.1 and 0.3 of their length on either
 * side. */
FAST_KERNEL(rcdn_edge_steps, (PICTURE, p), (SIZE, n, start, 0), (IN, double, start, n, 2), (IN, double, end, n, 2),
            (OUT, double, out, n, 2)) {
    static const double away[2] = {0.1, 0.3};
    Places w;
    float value[4 * ALONG];
    for (index_t link = 0; link < n; link++) {
        const double *from = start + 2 * link, dx = end[2 * link] - from[0], dy = end[2 * link + 1] - from[1];
        const Spot s = spot_at(&p, from[0], from[1]);
        for (index_t r = 0, k = 0; r < 2; r++)
            for (index_t a = 0; a < ALONG; a++, k += 2) {
                const double t = 0.25 + 0.5 / (ALONG - 1) * (double)a, x = from[0] - s.x + t * dx,
                             y = from[1] - s.y + t * dy;
                w.x[k] = (float)(x - away[r] * dy), w.y[k] = (float)(y + away[r] * dx);
                w.x[k + 1] = (float)(x + away[r] * dy), w.y[k + 1] = (float)(y - away[r] * dx);
            }
        grey_levels(&s, &w, 4 * ALONG, value);
        for (index_t r = 0; r < 2; r++) {
            float sum = 0;
            for (index_t k = 2 * ALONG * r; k < 2 * ALONG * (r + 1); k += 2)
                sum += value[k] - value[k + 1];
            out[2 * link + r] = (double)sum / ALONG;
        }
    }
    return 0;
}

/* Profiles across an edge: their number on each side of a crossing, their samples (padded to whole vectors: WIDE), and
 * the samples to either side that enter a smoothed derivative. */
enum { ROWS = 8, STEPS = 35, WIDE = 48, TAPS = 15, PADDED = WIDE + 2 * TAPS };
CONSTANTS(edges, ROWS, STEPS, TAPS)

/* ln x for x > 0, error below 1e-7: mantissa within √½..√2, and the series of the inverse hyperbolic tangent. Undefined
 * for other x. */
INLINE float logarithm(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int32_t exponent = (int32_t)(bits - 0x3f3504f3) >> 23;
    bits -= (uint32_t)exponent << 23;
    float m;
    memcpy(&m, &bits, sizeof m);
    const float s = (m - 1) / (m + 1), q = s * s;
    const float series = 2 * s * (1 + q * (1.0f / 3 + q * (1.0f / 5 + q * (1.0f / 7 + q * (1.0f / 9)))));
    return series + (float)exponent * 0.69314718f;
}

#define ORDER(A, B)                       \
    do {                                  \
        const float low_ = A < B ? A : B; \
        B = A < B ? B : A;                \
        A = low_;                         \
    } while (0)

/* Medians `out` (WIDE,) over 8 rows of `value`: the two halves are sorted, then the largest of the lower four and the
 * smallest of the upper four are averaged. */
INLINE void medians(float value[ROWS][WIDE], float *out) {
    for (int k = 0; k < WIDE; k++) {
        float a = value[0][k], b = value[1][k], c = value[2][k], d = value[3][k];
        float e = value[4][k], f = value[5][k], g = value[6][k], h = value[7][k];
        ORDER(a, b);
        ORDER(c, d);
        ORDER(a, c);
        ORDER(b, d);
        ORDER(b, c);
        ORDER(e, f);
        ORDER(g, h);
        ORDER(e, g);
        ORDER(f, h);
        ORDER(f, g);
        ORDER(a, h);
        ORDER(b, g);
        ORDER(c, f);
        ORDER(d, e);
        ORDER(a, b);
        ORDER(c, d);
        ORDER(b, d);
        ORDER(h, g);
        ORDER(f, e);
        ORDER(h, f);
        out[k] = 0.5f * (d + h);
    }
}

/* Smoothed derivatives `out` (ROWS, WIDE) of the logarithm of profiles on one side of a spot: `along` is the step
 * towards the rows, `across` that along them. */
INLINE void slopes(const Spot *s, const double *xy, const double *along, const double *across, const float *rows,
                   const float *t, float dark, const float *taps, Places *w, float out[ROWS][WIDE]) {
    float value[ROWS * STEPS], padded[ROWS][PADDED];
    const float ax = (float)across[0], ay = (float)across[1];
    for (int r = 0; r < ROWS; r++) {
        const float x = (float)(xy[0] - s->x + (double)rows[r] * along[0]),
                    y = (float)(xy[1] - s->y + (double)rows[r] * along[1]);
        for (int k = 0; k < STEPS; k++)
            w->x[r * STEPS + k] = x + t[k] * ax, w->y[r * STEPS + k] = y + t[k] * ay;
    }
    grey_levels(s, w, ROWS * STEPS, value);
    memset(padded, 0, sizeof padded); /* zeros beyond a profile reduce the derivatives at its ends */
    for (int r = 0; r < ROWS; r++)
        for (int k = 0; k < STEPS; k++) {
            const float level = value[r * STEPS + k]; /* enlarged images in floating point fall below 0 beside edges */
            padded[r][TAPS + k] = logarithm((level > 0 ? level : 0) + dark);
        }
    for (int r = 0; r < ROWS; r++)
        for (int k = 0; k < WIDE; k++) {
            float sum = 0;
            for (int n = 1; n <= TAPS; n++)
                sum += taps[n - 1] * (padded[r][TAPS + k + n] - padded[r][TAPS + k - n]);
            out[r][k] = sum;
        }
}

/* Offset along `across`, and strength, of the edge through `xy` in the direction `along` with colours `colour`. */
INLINE void edge_offset(const Picture *p, const double *xy, const double *across, const double *along, double colour,
                        const float *rows, const float *t, float dark, const float *taps, Places *w, double *offset,
                        double *strength) {
    float slope[ROWS][WIDE], half[2][WIDE], both[STEPS];
    const Spot s = spot_at(p, xy[0], xy[1]);
    const double back[2] = {-along[0], -along[1]};
    slopes(&s, xy, along, across, rows, t, dark, taps, w, slope);
    medians(slope, half[0]);
    slopes(&s, xy, back, across, rows, t, dark, taps, w, slope);
    medians(slope, half[1]);
    for (int k = 0; k < STEPS; k++) {
        const float one = (float)colour * half[0][k], other = -(float)colour * half[1][k];
        both[k] = one < other ? one : other;
    }
    int best = 1;
    for (int k = 2; k < STEPS - 1; k++)
        if (both[k] > both[best])
            best = k;
    const double before = both[best - 1], peak = both[best], after = both[best + 1], bend = before - 2 * peak + after;
    const double shift = bend < 0 ? limited(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
    *offset = (double)t[best] + shift * (double)(t[1] - t[0]);
    *strength = peak;
}

/* `offset`, `strength` (n, 2) at spots `xy`, `du`, `dv` (n, 2), `colour` (n,): see boards/edges.py, `crossings`. `rows`
 * (ROWS,) and `t` (STEPS,): squares along and across an edge; `dark`: grey levels; `taps` (TAPS,) of the smoothed
 * derivative: weights of the samples after one, less those before it. */
FAST_KERNEL(rcdn_crossings, (PICTURE, p), (SIZE, n, xy, 0), (IN, double, xy, n, 2), (IN, double, du, n, 2),
            (IN, double, dv, n, 2), (IN, double, colour, n), (IN, float, rows, ROWS), (IN, float, t, STEPS),
            (REAL, dark), (IN, float, taps, TAPS), (OUT, double, offset, n, 2), (OUT, double, strength, n, 2)) {
    Places w;
    for (index_t k = 0; k < n; k++) {
        const double *at = xy + 2 * k, *u = du + 2 * k, *v = dv + 2 * k;
        edge_offset(&p, at, u, v, colour[k], rows, t, (float)dark, taps, &w, offset + 2 * k, strength + 2 * k);
        edge_offset(&p, at, v, u, colour[k], rows, t, (float)dark, taps, &w, offset + 2 * k + 1, strength + 2 * k + 1);
    }
    return 0;
}
