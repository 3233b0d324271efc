/* Local maps of a board: a homography and, around each corner, a quadratic. See rcdn.precision.lattice. */
#include "lattice.h"
#include "solvers.h"

enum { NEAR = 32, FURTHEST_NEAR = 2 };
CONSTANTS(lattice, TERMS)
/* Spread of positions across a line, share of that along it, both squared, below which they are on it: rounding. */
#define STRAIGHT 1e-9

/* Squares (2) at the pixel x, y by the homography `flat` (3, 3). */
INLINE void rectify(const double *flat, double x, double y, double *out) {
    const double depth = 1 / (flat[6] * x + flat[7] * y + flat[8]);
    out[0] = (flat[0] * x + flat[1] * y + flat[2]) * depth;
    out[1] = (flat[3] * x + flat[4] * y + flat[5]) * depth;
}

/* Whether the labels ij (count, 2) are all within (rows, columns). */
static int all_inside(const int64_t *ij, index_t count, index_t rows, index_t columns) {
    for (index_t k = 0; k < count; k++)
        if (ij[2 * k] >= rows || ij[2 * k + 1] >= columns)
            return 0;
    return 1;
}

/* near (count, (2 reach + 1)²): indices of the corners within `reach` squares of each, -1 for none. ij (count, 2):
 * labels from 0 on; grid (rows, columns): buffer for all of them and a margin of `reach` on every side. */
FAST_KERNEL(rcdn_lattice_neighbours, (SIZE, count, ij, 0), (SIZE, rows, grid, 0), (SIZE, columns, grid, 1),
            (WITHIN, int64_t, ij, 0, FURTHEST, count, 2), (INT, reach, 0, FURTHEST_NEAR),
            (OUT, int32_t, grid, rows, columns), (OUT, int32_t, near, count, (2 * reach + 1) * (2 * reach + 1)),
            (WHERE, all_inside(ij, count, rows - 2 * reach, columns - 2 * reach))) {
    for (index_t k = 0; k < rows * columns; k++)
        grid[k] = -1;
    for (index_t k = 0; k < count; k++)
        grid[(ij[2 * k] + reach) * columns + ij[2 * k + 1] + reach] = (int32_t)k;
    const index_t side = 2 * reach + 1;
    for (index_t k = 0; k < count; k++)
        for (index_t i = 0; i < side; i++)
            memcpy(near + (k * side + i) * side, grid + (ij[2 * k] + i) * columns + ij[2 * k + 1],
                   side * sizeof(int32_t));
    return 0;
}

/* Upper triangle of the normal matrix, and right-hand sides pull (TERMS, 2), of weighted quadratics in s and t for i
 * and j. */
INLINE void moments(const double *weight, const double *s, const double *t, const double *i, const double *j,
                    double normal[TERMS][TERMS], double *pull) {
    double w = 0, ws = 0, wt = 0, ss = 0, st = 0, tt = 0, sss = 0, sst = 0, stt = 0, ttt = 0, s4 = 0, s3t = 0, sstt = 0,
           st3 = 0, t4 = 0;
    double i0 = 0, is = 0, it = 0, iss = 0, ist = 0, itt = 0, j0 = 0, js = 0, jt = 0, jss = 0, jst = 0, jtt = 0;
    for (index_t n = 0; n < NEAR; n++) {
        const double a = weight[n], as = a * s[n], at = a * t[n], ass = as * s[n], ast = as * t[n], att = at * t[n];
        const double s2 = s[n] * s[n], p = s[n] * t[n], t2 = t[n] * t[n];
        w += a, ws += as, wt += at, ss += ass, st += ast, tt += att;
        sss += ass * s[n], sst += ass * t[n], stt += att * s[n], ttt += att * t[n];
        s4 += ass * s2, s3t += ass * p, sstt += ass * t2, st3 += ast * t2, t4 += att * t2;
        i0 += a * i[n], is += as * i[n], it += at * i[n], iss += ass * i[n], ist += ast * i[n], itt += att * i[n];
        j0 += a * j[n], js += as * j[n], jt += at * j[n], jss += ass * j[n], jst += ast * j[n], jtt += att * j[n];
    }
    const double all[TERMS][TERMS] = {
        {w, ws, wt, ss, st, tt},       {ws, ss, st, sss, sst, stt},    {wt, st, tt, sst, stt, ttt},
        {ss, sss, sst, s4, s3t, sstt}, {st, sst, stt, s3t, sstt, st3}, {tt, stt, ttt, sstt, st3, t4},
    };
    const double right[2 * TERMS] = {i0, j0, is, js, it, jt, iss, jss, ist, jst, itt, jtt};
    memcpy(normal, all, sizeof all);
    memcpy(pull, right, sizeof right);
}

/* Whether the entry n of a table (side, side) of neighbours is two labels from its centre. */
INLINE int is_far(index_t n, index_t side) {
    const index_t i = n / side - side / 2, j = n % side - side / 2;
    return i > 1 || i < -1 || j > 1 || j < -1;
}

/* Whether the positions (i, j) with a weight lie on one line. */
INLINE int on_a_line(const double *weight, const double *i, const double *j) {
    double w = 0, i1 = 0, j1 = 0, ii = 0, ij = 0, jj = 0;
    for (index_t n = 0; n < NEAR; n++) {
        const double a = weight[n] * i[n], b = weight[n] * j[n];
        w += weight[n], i1 += a, j1 += b, ii += a * i[n], ij += a * j[n], jj += b * j[n];
    }
    if (w <= 0)
        return 1;
    ii -= i1 * i1 / w, ij -= i1 * j1 / w, jj -= j1 * j1 / w;
    return ii * jj - ij * ij <= STRAIGHT * (ii + jj) * (ii + jj);
}

/* terms (TERMS, 2) of the similarity that takes (s, t) to (i, j), by weighted least squares; a shift if there is but
 * one point, the identity if there is none. */
INLINE void similarity(const double *weight, const double *s, const double *t, const double *i, const double *j,
                       double *terms) {
    double w = 0, mean[4] = {0}, along = 0, across = 0, square = 0;
    for (index_t n = 0; n < NEAR; n++) {
        const double point[4] = {s[n], t[n], i[n], j[n]};
        w += weight[n];
        for (int k = 0; k < 4; k++)
            mean[k] += weight[n] * point[k];
    }
    for (int k = 0; k < 4; k++)
        mean[k] /= w > 0 ? w : 1;
    for (index_t n = 0; n < NEAR; n++) {
        const double x = s[n] - mean[0], y = t[n] - mean[1], u = i[n] - mean[2], v = j[n] - mean[3];
        along += weight[n] * (x * u + y * v), across += weight[n] * (x * v - y * u);
        square += weight[n] * (x * x + y * y);
    }
    const double a = square > 0 ? along / square : 1, b = square > 0 ? across / square : 0;
    const double out[2 * TERMS] = {
        mean[2] - a * mean[0] + b * mean[1], mean[3] - b * mean[0] - a * mean[1], a, b, -b, a};
    memcpy(terms, out, sizeof out);
}

/* origin (count, 2): xy (count, 2) mapped to squares by `flat`; terms (count, TERMS, 2): quadratics for the positions
 * on the board, `plane` (count, 2), around each corner, by least squares over `near` (count, side²), up to `reach`
 * squares away; similarities where these are on one line. own, far: weights of the corner itself and of those two
 * squares away; stiff (TERMS): weight of a prior at 0. */
FAST_KERNEL(rcdn_lattice, (SIZE, count, xy, 0), (IN, double, plane, count, 2), (IN, double, xy, count, 2),
            (IN, double, flat, 3, 3), (INT, reach, 0, FURTHEST_NEAR), (LET, side, 2 * reach + 1),
            (WITHIN, int32_t, near, -1, count - 1, count, side *side), (REAL, own), (REAL, far),
            (IN, double, stiff, TERMS), (OUT, double, origin, count, 2), (OUT, double, terms, count, TERMS, 2)) {
    for (index_t k = 0; k < count; k++)
        rectify(flat, xy[2 * k], xy[2 * k + 1], origin + 2 * k);
    for (index_t k = 0; k < count; k++) {
        double weight[NEAR] = {0}, s[NEAR] = {0}, t[NEAR] = {0}, i[NEAR] = {0}, j[NEAR] = {0}, normal[TERMS][TERMS];
        for (index_t n = 0; n < side * side; n++) {
            const index_t at = near[k * side * side + n];
            if (at < 0)
                continue;
            i[n] = plane[2 * at] - plane[2 * k];
            j[n] = plane[2 * at + 1] - plane[2 * k + 1];
            s[n] = origin[2 * at] - origin[2 * k];
            t[n] = origin[2 * at + 1] - origin[2 * k + 1];
            weight[n] = at == k ? own : is_far(n, side) ? far : 1;
        }
        if (on_a_line(weight, i, j)) {
            similarity(weight, s, t, i, j, terms + 2 * TERMS * k);
            continue;
        }
        moments(weight, s, t, i, j, normal, terms + 2 * TERMS * k);
        for (index_t a = 0; a < TERMS; a++)
            normal[a][a] += stiff[a];
        solve_definite(TERMS, normal[0], terms + 2 * TERMS * k);
    }
    return 0;
}

/* Gradients (count, 4) along u and v, per square, of planes fitted to the neighbours' levels (count, 2) at their
 * positions `plane` (count, 2), for the two kinds of levels one after the other; the second kind changes its sign from
 * one corner to the next. near (count, 9): as from rcdn_lattice_neighbours. */
FAST_KERNEL(rcdn_lattice_slopes, (SIZE, count, levels, 0), (IN, double, plane, count, 2),
            (WITHIN, int32_t, near, -1, count - 1, count, 9), (IN, double, levels, count, 2),
            (OUT, double, out, count, 4)) {
    for (index_t k = 0; k < count; k++) {
        double n = 1e-6, i1 = 0, j1 = 0, ii = 1e-6, ij = 0, jj = 1e-6, sums[3][2] = {{0}};
        for (index_t place = 0; place < 9; place++) {
            const index_t at = near[9 * k + place];
            if (at < 0)
                continue;
            const double i = plane[2 * at] - plane[2 * k], j = plane[2 * at + 1] - plane[2 * k + 1],
                         sign = place % 2 ? -1 : 1;
            const double value[2] = {levels[2 * at], sign * levels[2 * at + 1]};
            n += 1, i1 += i, j1 += j, ii += i * i, ij += i * j, jj += j * j;
            for (index_t a = 0; a < 2; a++) {
                sums[0][a] += value[a];
                sums[1][a] += i * value[a];
                sums[2][a] += j * value[a];
            }
        }
        ii -= i1 * i1 / n, ij -= i1 * j1 / n, jj -= j1 * j1 / n;
        for (index_t a = 0; a < 2; a++) {
            const double u = sums[1][a] - i1 * sums[0][a] / n, v = sums[2][a] - j1 * sums[0][a] / n;
            solve_two(ii, ij, ij, jj, u, v, out + 4 * k + 2 * a);
        }
    }
    return 0;
}

/* Board coordinates uv (count, each, 2) of pixels xy (count, each, 2) and their Jacobians (count, each, 2, 2), by the
 * maps `which` (count,). */
FAST_KERNEL(rcdn_lattice_map, (SIZE, count, xy, 0), (SIZE, each, xy, 1), (GROUP, Maps, maps),
            (WITHIN, int64_t, which, 0, maps.corners - 1, count), (IN, double, xy, count, each, 2),
            (OUT, double, uv, count, each, 2), (OUT, double, slopes, count, each, 2, 2)) {
    for (index_t k = 0; k < count; k++) {
        const Map m = map_of(&maps, which[k]);
        for (index_t n = k * each; n < (k + 1) * each; n++)
            map_pixel(&m, xy[2 * n], xy[2 * n + 1], uv + 2 * n, slopes + 4 * n);
    }
    return 0;
}

/* Move pixels xy (count, 2) to where the maps `which` (count,) give uv (count, 2), by Newton steps. Returns 0 if a map
 * is singular there. */
FAST_KERNEL(rcdn_lattice_pixels, (SIZE, count, uv, 0), (GROUP, Maps, maps),
            (WITHIN, int64_t, which, 0, maps.corners - 1, count), (IN, double, uv, count, 2), (INT, repeats, 0, 100),
            (OUT, double, xy, count, 2)) {
    for (index_t k = 0; k < count; k++) {
        const Map m = map_of(&maps, which[k]);
        for (index_t n = 0; n < repeats; n++) {
            double at[2], s[4], step[2];
            map_pixel(&m, xy[2 * k], xy[2 * k + 1], at, s);
            if (solve_two(s[0], s[1], s[2], s[3], uv[2 * k] - at[0], uv[2 * k + 1] - at[1], step) == 0)
                return 0;
            xy[2 * k] += step[0];
            xy[2 * k + 1] += step[1];
        }
    }
    return 1;
}
