/* Start of the fit of corners: the pixels used for each, and their appearance with straight edges. See
 * rcdn/precision/window.py. */
#include "fit_model.h"

/* Half extent of a window, squares: windows of neighbours touch but share no pixel, so that their errors are
 * independent. */
#define HALF 0.5
/* px along an edge: further out, the uncertainty of its course outweighs the information of its pixels. */
#define LONGEST 30.0
/* Pixels further from both edges than (blurs, + px) carry no information. */
#define BAND_BLURS 4.0
#define BAND_MORE 3.0
/* Distance, blurs, of a window from anything beyond the board's outermost squares, and least half extent, squares, to
 * which it is cut. */
#define RIM 2.2
#define LEAST 0.25

/* The window of a corner at `xy`, in its affine frame, with its number of pixels in place of THIN; 0 if the map is
 * singular there. `rim` (2): whether no corner follows on one side along u, v. */
INLINE int frame_of(const Map *map, const double *xy, const uint8_t *rim, double blur, double *out) {
    double uv[2], step[4], *slope = out + SLOPE, *reach = out + REACH, *band = out + BAND, box[2];
    map_pixel(map, xy[0], xy[1], uv, slope);
    const double area = 1 / (slope[0] * slope[3] - slope[1] * slope[2]);
    step[0] = slope[3] * area;
    step[1] = -slope[1] * area;
    step[2] = -slope[2] * area;
    step[3] = slope[0] * area;
    if (!isfinite(step[0]) || !isfinite(step[1]) || !isfinite(step[2]) || !isfinite(step[3]) ||
        !isfinite(xy[0] + xy[1]))
        return 0;
    double inner = 1, outer = 1;
    for (int k = 0; k < 2; k++) {
        const double length = length_of(step[k], step[2 + k]), width = fabs(area) / length_of(step[1 - k], step[3 - k]);
        const double far = LONGEST / length < HALF ? LONGEST / length : HALF, free = 1 - RIM * blur / width;
        const double cut = free > LEAST ? free : LEAST;
        const double near = (BAND_BLURS * blur + BAND_MORE) * length_of(slope[2 * k], slope[2 * k + 1]);
        reach[k] = rim[k] && cut < far ? cut : far;
        band[k] = near < reach[k] ? near : reach[k];
        outer *= reach[k];
        inner *= reach[k] - band[k];
    }
    for (int k = 0; k < 2; k++) {
        const double at = rint(xy[k]);
        box[k] = ceil(fabs(step[2 * k]) * reach[0] + fabs(step[2 * k + 1]) * reach[1]);
        out[BOX + k] = box[k] < ROW / 2 - 1 ? box[k] : ROW / 2 - 1;
        out[CENTRE + k] = at < -AWAY ? -AWAY : at > AWAY ? AWAY : at;
    }
    out[THIN] = 4 * (outer - inner) * fabs(area);
    out[MIDDLE] = out[MIDDLE + 1] = 0;
    return 1;
}

/* `frames` (n, FRAME) of corners at `xy` (n, 2) with `rim` (n, 2), as in `frame_of`. Returns 1 if a map is singular at
 * a corner. */
KERNEL(rcdn_fit_frames, (GROUP, Maps, maps), (LET, n, maps.corners), (IN, double, xy, n, 2), (IN, uint8_t, rim, n, 2),
       (REAL, blur), (OUT, double, frames, n, FRAME)) {
    for (index_t k = 0; k < n; k++) {
        const Map map = map_of(&maps, k);
        if (!frame_of(&map, xy + 2 * k, rim + 2 * k, blur, frames + FRAME * k))
            return 1;
    }
    return 0;
}

/* Residual variance, grey level and contrast, `out` (3), for straight edges of `blur` px and the surrounding print
 * `printed`, if any: linear regression of the pixels on the model. */
INLINE void line(const Window *w, float blur, const float *printed, float *shape, double *out) {
    const float sharp = 1 / blur, count = w->count > 1 ? (float)w->count : 1;
    float sum = 0, level = 0, across = 0, square = 0, left = 0;
    INDEPENDENT
    for (index_t i = 0; i < w->padded; i++)
        shape[i] = erf_near(sharp * w->u[i] * w->iu[i]) * erf_near(sharp * w->v[i] * w->iv[i]);
    if (printed)
        for (index_t i = 0; i < w->padded; i++)
            shape[i] += printed[i];
    for (index_t i = 0; i < w->padded; i++) {
        sum += w->mask[i] * shape[i];
        level += w->value[i];
    }
    sum /= count;
    level /= count;
    for (index_t i = 0; i < w->padded; i++) {
        const float a = w->mask[i] * (shape[i] - sum);
        across += a * (w->value[i] - level);
        square += a * a;
    }
    const float contrast = across / (square > 1e-9f ? square : 1e-9f);
    for (index_t i = 0; i < w->padded; i++) {
        const float off = w->mask[i] * (w->value[i] - level - contrast * (shape[i] - sum));
        left += off * off;
    }
    out[0] = left / count;
    out[1] = level - contrast * sum;
    out[2] = contrast;
}

/* The pixels of corner k, with their board coordinates. */
INLINE void fill_window(const Picture *picture, const double *frames, const Maps *maps, index_t k, Window *w) {
    const Map map = map_of(maps, k);
    window_pixels(picture, frames + FRAME * k, w);
    window_coordinates(&map, frames + FRAME * k, w);
}

/* `levels` (`many`, n, 3) of `line` for each of `blurs` (many) and each of n corners with the print around them. */
FAST_KERNEL(rcdn_fit_levels, (PICTURE, picture), (GROUP, Maps, maps), (LET, n, maps.corners), (GROUP, Print, print),
            (WHERE, print.n == 0 || print.n == n), (IN, double, frames, n, FRAME), (WHERE, are_frames(frames, n)),
            (SIZE, many, blurs, 0), (IN, double, blurs, many), (OUT, double, levels, many, n, 3)) {
    Window *w = malloc(sizeof(Window) + sizeof(Shade) + PIXELS * sizeof(float));
    if (!w)
        return NO_MEMORY;
    Shade *shade = (Shade *)(w + 1);
    for (index_t k = 0; k < n; k++) {
        fill_window(&picture, frames, &maps, k, w);
        for (index_t b = 0; b < many; b++) {
            const float straight[6] = {0}, sharp = 1 / (float)blurs[b];
            if (print.n)
                print_pixels(&print, k, straight, sharp, sharp, 0, w, shade);
            line(w, (float)blurs[b], print.n ? shade->all[0] : NULL, (float *)(shade + 1), levels + 3 * (b * n + k));
        }
    }
    free(w);
    return 0;
}

/* The pixels of n corners, for inspection: `count` (n), and `out` (8, n, room): x, y from the centre, grey levels, u,
 * v, their gradients' lengths, mask. Pixels beyond `room` are left out. */
KERNEL(rcdn_fit_windows, (PICTURE, picture), (GROUP, Maps, maps), (LET, n, maps.corners),
       (IN, double, frames, n, FRAME), (WHERE, are_frames(frames, n)), (SIZE, room, out, 2), (OUT, int64_t, count, n),
       (OUT, float, out, 8, n, room)) {
    Window *w = malloc(sizeof(Window));
    if (!w)
        return NO_MEMORY;
    for (index_t k = 0; k < n; k++) {
        fill_window(&picture, frames, &maps, k, w);
        const index_t size = w->padded < room ? w->padded : room;
        const float *all[8] = {w->x, w->y, w->value, w->u, w->v, w->gu, w->gv, w->mask};
        for (int j = 0; j < 8; j++)
            memcpy(out + (j * n + k) * room, all[j], (size_t)size * sizeof(float));
        count[k] = w->count;
    }
    free(w);
    return 0;
}
