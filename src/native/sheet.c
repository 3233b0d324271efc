/* The print of a board of squares, averaged over small parts of it. See rcdn/synthetic/pattern.py. */
#include "kernel.h"

/* Squares from a square's side to its marker, and the marker's side */
#define RIM 0.15f
#define MARKER 0.7f
/* Squares: what is farther away has markers like there */
#define FARTHEST 1e9f
/* Factors of a hash of where a module of a marker lies */
static const uint64_t factors[] = {73856093, 19349663, 83492791, 49979693, 2654435761};

/* Reflectances of black, white and the margin; the share of a period of two squares that is printed dark; columns and
 * rows of inner corners; margin, squares; whether colours are exchanged; modules on a side of the markers, 0 if there
 * are none. */
ARGUMENT_GROUP(Sheet, (REAL, black), (REAL, white), (REAL, beyond), (REAL, duty), (REAL, columns), (REAL, rows),
               (REAL, margin), (INT, swap, 0, 1), (INT, coded, 0, 100))

INLINE float between(float x, float low, float high) {
    x = x > low ? x : low;
    return x < high ? x : high;
}

/* The length that pulses [2n + start, 2n + start + duty], n any integer, have up to x, but for a constant. */
INLINE float pulses_to(float x, float start, float duty) {
    x -= start;
    const float n = floorf(x * 0.5f);
    return n * duty + between(x - 2 * n, 0, duty);
}

/* Share of [u − width/2, u + width/2] inside the pulses, which lie around odd coordinates. */
INLINE float pulsed(float u, float width, float start, float duty) {
    return (pulses_to(u + width * 0.5f, start, duty) - pulses_to(u - width * 0.5f, start, duty)) / width;
}

/* Share of [u − width/2, u + width/2] inside [low, high]. */
INLINE float inside(float u, float width, float low, float high) {
    const float a = u - width * 0.5f, b = u + width * 0.5f, length = (b < high ? b : high) - (a > low ? a : low);
    return (length > 0 ? length : 0) / width;
}

/* Whether there is ink of a marker at (u, v) of a white square: a random code within a black border. */
INLINE int has_ink(float u, float v, index_t coded) {
    const index_t n = coded + 2;
    const float column = floorf(u), row = floorf(v);
    const float across = floorf((u - column - RIM) / MARKER * (float)n);
    const float down = floorf((v - row - RIM) / MARKER * (float)n);
    if (!(across >= 0 && across < (float)n && down >= 0 && down < (float)n))
        return 0;
    if (across == 0 || across == (float)(n - 1) || down == 0 || down == (float)(n - 1))
        return 1;
    const float at[] = {column, row, across, down};
    uint64_t key = 0;
    for (int k = 0; k < 4; k++)
        key ^= (uint64_t)(int64_t)between(at[k], -FARTHEST, FARTHEST) * factors[k];
    return (key * factors[4] >> 13 & 1) == 0;
}

/* Reflectance `value` and coverage `cover` (count) of the sheet at board coordinates u, v (count), averaged over
 * footprints of widths wu, wv (count), all in squares. `painted` (cells, 3): corner at the far end of a square that is
 * painted over, and its reflectance. */
FAST_KERNEL(rcdn_sheet, (GROUP, Sheet, sheet), (SIZE, cells, painted, 0), (IN, double, painted, cells, 3),
            (SIZE, count, u, 0), (IN, float, u, count), (IN, float, v, count), (IN, float, wu, count),
            (IN, float, wv, count), (OUT, float, value, count), (OUT, float, cover, count)) {
    const float duty = (float)sheet.duty, start = (float)((1 - sheet.duty) / 2), white = (float)sheet.white,
                ink = (float)(sheet.black - sheet.white), black = (float)sheet.black, beyond = (float)sheet.beyond;
    const float columns = (float)sheet.columns, rows = (float)sheet.rows, first = (float)(-1 - sheet.margin),
                right = (float)(sheet.columns + sheet.margin), low = (float)(sheet.rows + sheet.margin);
    for (index_t n = 0; n < count; n++) {
        const float odd_u = pulsed(u[n], wu[n], start, duty), even_u = pulsed(u[n] + 1, wu[n], start, duty);
        const float odd_v = pulsed(v[n], wv[n], start, duty), even_v = pulsed(v[n] + 1, wv[n], start, duty);
        const float dark = sheet.swap ? odd_u * even_v + even_u * odd_v : odd_u * odd_v + even_u * even_v;
        value[n] = between(dark, 0, 1);
        cover[n] = inside(u[n], wu[n], first, right) * inside(v[n], wv[n], first, low);
    }
    for (index_t n = 0; n < count; n++) {
        const float dark = value[n];
        value[n] = white + ink * dark;
        if (sheet.coded && dark < 0.5f && has_ink(u[n], v[n], sheet.coded))
            value[n] = black;
    }
    for (index_t k = 0; k < cells; k++)
        for (index_t n = 0; n < count; n++) {
            const double i = painted[3 * k], j = painted[3 * k + 1];
            const float share =
                inside(u[n], wu[n], (float)(i - 1), (float)i) * inside(v[n], wv[n], (float)(j - 1), (float)j);
            value[n] = value[n] * (1 - share) + (float)painted[3 * k + 2] * share;
        }
    for (index_t n = 0; n < count; n++) {
        const float printed = inside(u[n], wu[n], -1, columns) * inside(v[n], wv[n], -1, rows);
        value[n] = value[n] * printed + beyond * (1 - printed);
    }
    return 0;
}
