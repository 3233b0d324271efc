/* A board's corners as one Gaussian process: normal matrices, marginal likelihoods and posteriors. See
 * rcdn.precision.smooth.
 *
 * Coefficients: FREE of a homography, which move x and y, then `terms` polynomials that move x, and as many that move
 * y, D in all. `terms` is a multiple of PANEL and at most TERMS; it is padded with zeros. Matrices are symmetric,
 * (D + 1, D + PANEL), with the data in row and column D and zeros behind; only the upper triangle is used. */
#include "kernel.h"
#include "solvers.h"

enum { FREE = 8, TERMS = 64, CHUNK = 128 };
CONSTANTS(smooth, FREE, PANEL, TERMS, CHUNK)

static int are_terms(index_t terms) {
    return terms > 0 && terms <= TERMS && terms % PANEL == 0;
}

/* The first complete cache line of a workspace, which needs PANEL additional doubles. */
INLINE double *aligned(double *work) {
    return (double *)(((uintptr_t)work + sizeof(double[PANEL]) - 1) & ~(uintptr_t)(sizeof(double[PANEL]) - 1));
}

/* Inverse (xx, xy, yy) of the covariance cov (2, 2) plus `rough`² on the diagonal; returns the determinant of that sum.
 * */
INLINE double weights(const double *cov, double rough, double *out) {
    const double a = cov[0] + rough * rough, b = cov[1], c = cov[3] + rough * rough, det = a * c - b * b;
    out[0] = c / det;
    out[1] = -b / det;
    out[2] = a / det;
    return det;
}

/* base (count, 2): labels ij (count, 2) mapped by the homography H (3, 3); tangent (count, 2, FREE): derivatives of
 * base by its parameters, as orthonormal columns × √count. */
FAST_KERNEL(rcdn_smooth_tangent, (SIZE, count, ij, 0), (IN, double, ij, count, 2), (IN, double, H, 3, 3),
            (OUT, double, base, count, 2), (OUT, double, tangent, count, 2, FREE)) {
    for (index_t k = 0; k < count; k++) {
        const double i = ij[2 * k], j = ij[2 * k + 1], depth = 1 / (H[6] * i + H[7] * j + H[8]);
        const double x = (H[0] * i + H[1] * j + H[2]) * depth, y = (H[3] * i + H[4] * j + H[5]) * depth;
        const double p = i * depth, q = j * depth;
        const double rows[2 * FREE] = {p, q, depth, 0, 0, 0, -x * p, -x * q, 0, 0, 0, p, q, depth, -y * p, -y * q};
        base[2 * k] = x;
        base[2 * k + 1] = y;
        memcpy(tangent + 2 * FREE * k, rows, sizeof rows);
    }
    for (index_t c = 0; c < FREE; c++) { /* Gram–Schmidt, every column twice */
        for (index_t again = 0; again < 2; again++) {
            double dot[FREE] = {0}, length = 0;
            for (index_t r = 0; r < 2 * count; r++)
                for (index_t l = 0; l < FREE; l++)
                    dot[l] += tangent[r * FREE + l] * tangent[r * FREE + c];
            for (index_t l = c; l < FREE; l++)
                dot[l] = 0;
            for (index_t r = 0; r < 2 * count; r++) {
                double sum = 0;
                for (index_t l = 0; l < FREE; l++)
                    sum += dot[l] * tangent[r * FREE + l];
                tangent[r * FREE + c] -= sum;
                length += tangent[r * FREE + c] * tangent[r * FREE + c];
            }
            const double scale = length > 0 ? 1 / sqrt(length) : 0;
            for (index_t r = 0; r < 2 * count; r++)
                tangent[r * FREE + c] *= scale;
        }
    }
    for (index_t r = 0; r < 2 * count * FREE; r++)
        tangent[r] *= sqrt((double)count);
    return 0;
}

/* PANEL points from `p` on; those beyond `count` have weight zero. */
typedef struct {
    double bent[PANEL * TERMS], w[3][PANEL], x[FREE + 1][PANEL], y[FREE + 1][PANEL], log_det;
} Points;

INLINE void take(Points *out, index_t p, index_t count, index_t terms, const double *tangent, const double *bent,
                 const double *off, const double *cov, double rough) {
    memset(out, 0, sizeof *out);
    for (index_t k = 0; k < PANEL && p + k < count; k++) {
        const index_t at = p + k;
        double w[3];
        out->log_det += natural_log(weights(cov + 4 * at, rough, w));
        for (index_t i = 0; i < 3; i++)
            out->w[i][k] = w[i];
        for (index_t i = 0; i < FREE; i++) {
            out->x[i][k] = tangent[at * 2 * FREE + i];
            out->y[i][k] = tangent[at * 2 * FREE + FREE + i];
        }
        out->x[FREE][k] = off[2 * at];
        out->y[FREE][k] = off[2 * at + 1];
        memcpy(out->bent + k * TERMS, bent + at * terms, terms * sizeof(double));
    }
}

/* Eliminate the homography from `gram`: `rest` as in rcdn_smooth_normal. Returns the log of the determinant. */
INLINE double less_homography(const double *gram, index_t terms, double free, double *rest) {
    const index_t size = 2 * terms, wide = size + PANEL, stride = FREE + wide;
    double head[FREE * (FREE + 2 * TERMS + PANEL)];
    for (index_t i = 0; i < FREE; i++) {
        for (index_t j = 0; j < stride; j++)
            head[i * stride + j] = gram[i * stride + j] * free * (j < FREE ? free : 1);
        head[i * stride + i] += 1;
    }
    const double log_det = eliminate_blocks(head, 0, FREE, FREE, stride);
    for (index_t i = 0; i <= size; i++)
        memcpy(rest + i * wide, gram + (FREE + i) * stride + FREE, wide * sizeof(double));
    memset(rest + (size + 1) * wide, 0, wide * sizeof(double));
    for (index_t i = 0; i <= size; i += 2) {
        double ca[PANEL], cb[PANEL];
        for (index_t k = 0; k < FREE; k++) {
            ca[k] = -head[k * stride + FREE + i];
            cb[k] = -head[k * stride + FREE + i + 1];
        }
        add_rows(rest + i * wide, rest + (i + 1) * wide, head + FREE, stride, ca, cb, i & ~(index_t)(PANEL - 1), wide);
    }
    return log_det;
}

/* Normal matrix `gram` of the coefficients with the data as right-hand side; `rest` (2 terms + 2, 2 terms + PANEL): its
 * Schur complement after elimination of the homography, whose parameters have the standard deviation `free` (the last
 * row is scratch space); fixed (1,): −½ log of the determinants of all errors and of that elimination.
 *
 * tangent (count, 2, FREE), bent (count, terms): derivatives by the coefficients; off (count, 2): the data; cov
 * (count, 2, 2) of their errors, to which `rough`² is added along both axes. */
FAST_KERNEL(rcdn_smooth_normal, (SIZE, count, bent, 0), (SIZE, terms, bent, 1), (WHERE, are_terms(terms)),
            (IN, double, tangent, count, 2, FREE), (IN, double, bent, count, terms), (IN, double, off, count, 2),
            (IN, double, cov, count, 2, 2), (REAL, rough), (REAL, free),
            (OUT, double, gram, FREE + 2 * terms + 1, FREE + 2 * terms + PANEL),
            (OUT, double, rest, 2 * terms + 2, 2 * terms + PANEL), (OUT, double, fixed, 1)) {
    const index_t data = FREE + 2 * terms, stride = data + PANEL;
    double log_det = 0;
    Points at;
    memset(gram, 0, (data + 1) * stride * sizeof(double));
    for (index_t p = 0; p < count; p += PANEL) {
        take(&at, p, count, terms, tangent, bent, off, cov, rough);
        log_det += at.log_det;
        for (index_t i = 0; i <= FREE; i++) {
            double *row = gram + (i < FREE ? i : data) * stride, x[PANEL], y[PANEL];
            for (index_t k = 0; k < PANEL; k++) {
                x[k] = at.w[0][k] * at.x[i][k] + at.w[1][k] * at.y[i][k];
                y[k] = at.w[1][k] * at.x[i][k] + at.w[2][k] * at.y[i][k];
            }
            add_rows(row + FREE, row + FREE + terms, at.bent, TERMS, x, y, 0, terms);
            for (index_t l = i; l <= FREE; l++) {
                double sum = 0;
                for (index_t k = 0; k < PANEL; k++)
                    sum += x[k] * at.x[l][k] + y[k] * at.y[l][k];
                row[l < FREE ? l : data] += sum;
            }
        }
        for (index_t t = 0; t < terms; t += 2) {
            double c[2][3][PANEL];
            for (index_t s = 0; s < 2; s++)
                for (index_t i = 0; i < 3; i++)
                    for (index_t k = 0; k < PANEL; k++)
                        c[s][i][k] = at.w[i][k] * at.bent[k * TERMS + t + s];
            double *xx = gram + (FREE + t) * stride + FREE, *yy = xx + terms * (stride + 1);
            const index_t from = t & ~(index_t)(PANEL - 1);
            add_rows(xx, xx + stride, at.bent, TERMS, c[0][0], c[1][0], from, terms);
            add_rows(xx + terms, xx + terms + stride, at.bent, TERMS, c[0][1], c[1][1], from, terms);
            add_rows(yy, yy + stride, at.bent, TERMS, c[0][2], c[1][2], from, terms);
        }
    }
    for (index_t s = 0; s < terms; s++)
        for (index_t t = 0; t < s; t++)
            gram[(FREE + s) * stride + FREE + terms + t] = gram[(FREE + t) * stride + FREE + terms + s];
    for (index_t i = FREE; i < data; i++)
        gram[i * stride + data] = gram[data * stride + i];
    fixed[0] = -0.5 * (log_det + less_homography(gram, terms, free, rest));
    return 0;
}

/* The first `rows` rows of m (…, wide) = gram (size + 1, size + PANEL) × root of its row and column, + 1 on the
 * diagonal except the data's. */
INLINE void scaled(const double *gram, const double *root, index_t rows, index_t size, double *m, index_t wide) {
    const index_t stride = size + PANEL;
    for (index_t i = 0; i < rows; i++) {
        const double *restrict from = gram + i * stride, c = i < size ? root[i] : 1;
        double *restrict to = m + i * wide;
        for (index_t j = i & ~(index_t)(PANEL - 1); j < size; j++)
            to[j] = c * root[j] * from[j];
        for (index_t j = size; j < stride; j++)
            to[j] = c * from[j];
        if (i < size)
            to[i] += 1;
    }
}

/* Log marginal likelihoods (many,), up to a constant, of the data under polynomials whose coefficients have standard
 * deviations root (many, 2 used), from the normal matrix `rest` of rcdn_smooth_normal. Only the first `used` of `terms`
 * polynomials, a multiple of PANEL, are included. work: 2 (2 used + 2) (2 used + PANEL) + PANEL. */
FAST_KERNEL(rcdn_smooth_evidence, (SIZE, rows, rest, 0), (SIZE, many, root, 0), (SIZE, columns, root, 1),
            (LET, terms, rows / 2 - 1), (LET, used, columns / 2),
            (WHERE, are_terms(terms) && are_terms(used) && used <= terms),
            (IN, double, rest, 2 * terms + 2, 2 * terms + PANEL), (IN, double, root, many, 2 * used),
            (ROOM, double, work, 2 * (2 * used + 2) * (2 * used + PANEL) + PANEL), (OUT, double, out, many)) {
    const index_t size = 2 * used, stride = size + PANEL, left = terms - used, wide = 2 * terms + PANEL;
    double *m = aligned(work), *part = m + (size + 2) * stride;
    for (index_t i = 0; i <= size; i++) {
        const double *from = rest + (i + (i < used ? 0 : i < size ? left : 2 * left)) * wide;
        memcpy(part + i * stride, from, used * sizeof(double));
        memcpy(part + i * stride + used, from + terms, used * sizeof(double));
        memcpy(part + i * stride + size, from + 2 * terms, PANEL * sizeof(double));
    }
    memset(m + (size + 1) * stride, 0, stride * sizeof(double));
    for (index_t k = 0; k < many; k++) {
        scaled(part, root + k * size, size + 1, size, m, stride);
        const double log_det = eliminate_blocks(m, 0, size, size + 2, stride);
        out[k] = -0.5 * (m[size * stride + size] + log_det);
    }
    return 0;
}

/* Columns of m (size, wide) from size + PANEL on: root × derivatives by the coefficients of x of `count` points from p
 * on, `span` columns; then of y. */
INLINE void moves(index_t p, index_t count, index_t span, index_t terms, const double *tangent, const double *bent,
                  const double *root, double *m, index_t wide) {
    const index_t size = FREE + 2 * terms;
    for (index_t i = 0; i < size; i++)
        memset(m + i * wide + size + PANEL, 0, 2 * span * sizeof(double));
    for (index_t k = 0; k < count; k++) {
        double *x = m + size + PANEL + k, *y = x + span;
        const double *own = tangent + (p + k) * 2 * FREE, *b = bent + (p + k) * terms;
        for (index_t i = 0; i < FREE; i++) {
            x[i * wide] = root[i] * own[i];
            y[i * wide] = root[i] * own[FREE + i];
        }
        for (index_t t = 0; t < terms; t++) {
            x[(FREE + t) * wide] = root[FREE + t] * b[t];
            y[(FREE + terms + t) * wide] = root[FREE + terms + t] * b[t];
        }
    }
}

/* Combine one point's own datum with the smooth board: off (2) is its residual from the board, known (2, 2) on input
 * the board's covariance there, on output the covariance of the point. Adds the shift relative to the smooth board to
 * xy (2); returns the squared length of off in standard deviations. */
INLINE double settle(const double *cov, double rough, const double *off, double *xy, double *known) {
    double w[3];
    weights(cov, rough, w);
    const double r2 = rough * rough, stay[4] = {r2 * w[0], r2 * w[1], r2 * w[1], r2 * w[2]};
    const double go[4] = {1 - stay[0], -stay[1], -stay[2], 1 - stay[3]},
                 board[4] = {known[0], known[1], known[2], known[3]};
    for (index_t a = 0; a < 2; a++) {
        xy[a] += stay[2 * a] * off[0] + stay[2 * a + 1] * off[1];
        for (index_t b = 0; b < 2; b++) {
            double sum = stay[2 * a] * cov[b] + stay[2 * a + 1] * cov[2 + b];
            for (index_t k = 0; k < 2; k++)
                for (index_t l = 0; l < 2; l++)
                    sum += go[2 * a + k] * board[2 * k + l] * go[2 * b + l];
            known[2 * a + b] = sum;
        }
    }
    return w[0] * off[0] * off[0] + 2 * w[1] * off[0] * off[1] + w[2] * off[1] * off[1];
}

/* Posterior of the points under coefficients of standard deviations root (size,) and unevenness `rough`, from their
 * normal matrix.
 *
 * moved (count, 2): their shifts from their positions without coefficients; known (count, 2, 2): their covariances;
 * off (count, 2): residuals of the data from the smooth board, and beyond (count,): their squared lengths, in standard
 * deviations. work: size (size + PANEL + 2 CHUNK) + PANEL. */
FAST_KERNEL(rcdn_smooth_posterior, (SIZE, count, bent, 0), (SIZE, terms, bent, 1), (WHERE, are_terms(terms)),
            (LET, size, FREE + 2 * terms), (IN, double, tangent, count, 2, FREE), (IN, double, bent, count, terms),
            (IN, double, data, count, 2), (IN, double, cov, count, 2, 2), (REAL, rough),
            (IN, double, gram, size + 1, size + PANEL), (IN, double, root, size),
            (ROOM, double, work, size *(size + PANEL + 2 * CHUNK) + PANEL), (OUT, double, moved, count, 2),
            (OUT, double, known, count, 2, 2), (OUT, double, off, count, 2), (OUT, double, beyond, count)) {
    const index_t all = (count + PANEL - 1) & ~(index_t)(PANEL - 1), span = all < CHUNK ? all : CHUNK;
    const index_t wide = size + PANEL + 2 * span;
    work = aligned(work);
    for (index_t p = 0; p < count; p += span) {
        const index_t n = count - p < span ? count - p : span;
        double flat[2][CHUNK] = {{0}}, spread[3][CHUNK] = {{0}};
        scaled(gram, root, size, size, work, wide);
        moves(p, n, span, terms, tangent, bent, root, work, wide);
        eliminate_blocks(work, 0, size, size, wide);
        for (index_t i = 0; i < size; i++) {
            const double *x = work + i * wide + size + PANEL, *y = x + span, c = work[i * wide + size];
            for (index_t k = 0; k < span; k++) {
                flat[0][k] += c * x[k];
                flat[1][k] += c * y[k];
                spread[0][k] += x[k] * x[k];
                spread[1][k] += x[k] * y[k];
                spread[2][k] += y[k] * y[k];
            }
        }
        for (index_t k = 0; k < n; k++) {
            const index_t at = p + k;
            for (index_t a = 0; a < 2; a++) {
                moved[2 * at + a] = flat[a][k];
                off[2 * at + a] = data[2 * at + a] - flat[a][k];
            }
            for (index_t i = 0; i < 4; i++)
                known[4 * at + i] = spread[(i + 1) / 2][k];
            beyond[at] = settle(cov + 4 * at, rough, off + 2 * at, moved + 2 * at, known + 4 * at);
        }
    }
    return 0;
}
