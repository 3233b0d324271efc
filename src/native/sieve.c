/* Preselection of the cells that may contain X-corners: saddles of the grey levels, at half resolution, that exceed a
 * share of the local contrast. */
#include "kernel.h"

#define BLOCK 4  /* side of a block, px of half resolution, over which contrast is summed; a window is 3×3 blocks */
#define TAPS 3   /* reach of the longest filter */
#define STEP 64  /* number of columns that are tested together */
#define PAD 8    /* columns of padding on either side of a row */
#define LEVELS 3 /* of the strength of saddles */
#define SADDLE 1 /* marks of a cell: one bit for each level */
#define REACH 5  /* px around a saddle in which the response may peak, half a px less on either side */

typedef struct {
    index_t height, width; /* of the half-resolution image */
    index_t stride;        /* of its rows, with PAD columns on either side */
    float *grey;           /* (height, stride) */
    float *limit[LEVELS];  /* (blocks down, blocks across): least −det of the Hessian of a saddle of each level */
    float *rows[3];        /* −det of three rows */
    float *down[3];        /* a row filtered along y: smoothed, first and second derivative */
} Half;

/* Means of 2×2 px; an odd last row or column is left out. */
INLINE void halved(const Picture *p, Half *h) {
    for (index_t y = 0; y < h->height; y++) {
        float *row = h->grey + y * h->stride + PAD;
        if (p->real) {
            const float *a = (const float *)p->data + 2 * y * p->width, *b = a + p->width;
            for (index_t x = 0; x < h->width; x++)
                row[x] = 0.25f * (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
        } else {
            const uint8_t *a = (const uint8_t *)p->data + 2 * y * p->width, *b = a + p->width;
            for (index_t x = 0; x < h->width; x++)
                row[x] = 0.25f * (float)(a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
        }
        for (index_t k = 1; k <= PAD; k++) {
            row[-k] = row[mirrored(-k, h->width)];
            row[h->width - 1 + k] = row[mirrored(h->width - 1 + k, h->width)];
        }
    }
}

/* Least strength of a saddle: share × (standard deviation around it + floor). */
typedef struct {
    float share, floor_;
} Steepness;

/* The limits of all blocks, squared, from standard deviations over 3×3 blocks. `sums` (3, blocks down, blocks across)
 * is a buffer. */
INLINE void limits(Half *h, const Steepness least[LEVELS], double *sums) {
    const index_t down = (h->height + BLOCK - 1) / BLOCK, across = (h->width + BLOCK - 1) / BLOCK;
    double *one = sums, *square = sums + down * across, *count = square + down * across;
    float *restrict column = h->down[0], *restrict columns = h->down[1]; /* sums over a block's rows */
    for (index_t j = 0; j < down; j++) {
        const index_t end = (j + 1) * BLOCK < h->height ? (j + 1) * BLOCK : h->height;
        for (index_t y = j * BLOCK; y < end; y++) {
            const float *row = h->grey + y * h->stride + PAD;
            for (index_t x = 0; x < h->width; x++) {
                column[x] = (y > j * BLOCK ? column[x] : 0) + row[x];
                columns[x] = (y > j * BLOCK ? columns[x] : 0) + row[x] * row[x];
            }
        }
        for (index_t x = h->width; x < across * BLOCK; x++)
            column[x] = columns[x] = 0;
        for (index_t i = 0; i < across; i++) {
            one[j * across + i] = column[4 * i] + column[4 * i + 1] + column[4 * i + 2] + column[4 * i + 3];
            square[j * across + i] = columns[4 * i] + columns[4 * i + 1] + columns[4 * i + 2] + columns[4 * i + 3];
            count[j * across + i] = (double)((end - j * BLOCK) * (i + 1 < across ? BLOCK : h->width - i * BLOCK));
        }
    }
    for (index_t j = 0; j < down; j++)
        for (index_t i = 0; i < across; i++) {
            double s = 0, q = 0, n = 0;
            for (index_t y = j > 0 ? j - 1 : 0; y <= j + 1 && y < down; y++)
                for (index_t x = i > 0 ? i - 1 : 0; x <= i + 1 && x < across; x++) {
                    s += one[y * across + x];
                    q += square[y * across + x];
                    n += count[y * across + x];
                }
            const double variance = q / n - s / n * (s / n);
            for (int k = 0; k < LEVELS; k++) {
                const float limit = least[k].share * ((float)sqrt(variance > 0 ? variance : 0) + least[k].floor_);
                h->limit[k][j * across + i] = limit * limit;
            }
        }
}

/* Filter seven rows along y. */
INLINE void down_row(const float *restrict a, const float *restrict b, const float *restrict c, const float *restrict d,
                     const float *restrict e, const float *restrict f, const float *restrict g, index_t count,
                     float *restrict smooth, float *restrict slope, float *restrict bend) {
    for (index_t x = 0; x < count; x++) {
        smooth[x] = (b[x] + f[x] + 4 * (c[x] + e[x]) + 6 * d[x]) * (1 / 16.f);
        slope[x] = (f[x] - b[x] + 2 * (e[x] - c[x])) * (1 / 8.f);
        bend[x] = (a[x] + g[x] + 2 * (b[x] + f[x]) - c[x] - e[x] - 4 * d[x]) * (1 / 16.f);
    }
}

/* Filter their results along x, and combine them to −det. */
INLINE void along_row(const float *restrict smooth, const float *restrict slope, const float *restrict bend,
                      index_t count, float *restrict out) {
    for (index_t x = 0; x < count; x++) {
        const float yy = (bend[x - 2] + bend[x + 2] + 4 * (bend[x - 1] + bend[x + 1]) + 6 * bend[x]) * (1 / 16.f);
        const float xy = (slope[x + 2] - slope[x - 2] + 2 * (slope[x + 1] - slope[x - 1])) * (1 / 8.f);
        const float xx = (smooth[x - 3] + smooth[x + 3] + 2 * (smooth[x - 2] + smooth[x + 2]) - smooth[x - 1] -
                          smooth[x + 1] - 4 * smooth[x]) *
                         (1 / 16.f);
        out[x] = xy * xy - xx * yy;
    }
}

/* −det of the Hessian along one row, after binomial smoothing. */
INLINE void saddle_row(Half *h, index_t y, float *out) {
    const float *r[2 * TAPS + 1];
    for (int k = -TAPS; k <= TAPS; k++)
        r[k + TAPS] = h->grey + mirrored(y + k, h->height) * h->stride;
    down_row(r[0], r[1], r[2], r[3], r[4], r[5], r[6], h->stride, h->down[0], h->down[1], h->down[2]);
    along_row(h->down[0] + PAD, h->down[1] + PAD, h->down[2] + PAD, h->width, out);
}

/* Add `kind` to the cells around a saddle. */
static void mark(uint8_t *cells, index_t down, index_t across, index_t x, index_t y, uint8_t kind) {
    const index_t left = 2 * x - REACH + 1, top = 2 * y - REACH + 1, right = 2 * x + REACH, low = 2 * y + REACH;
    const index_t i1 = right / CELL < across - 1 ? right / CELL : across - 1,
                  j1 = low / CELL < down - 1 ? low / CELL : down - 1;
    for (index_t j = top > 0 ? top / CELL : 0; j <= j1; j++)
        for (index_t i = left > 0 ? left / CELL : 0; i <= i1; i++)
            cells[j * across + i] |= kind;
}

/* Mark the cells around the peaks in the middle row, `y`, of three rows that exceed the limits (rows) of its pixels.
 * Returns the number of peaks. */
INLINE index_t marked(const Half *h, index_t y, float *const limits[LEVELS], uint8_t *cells, index_t down,
                      index_t across) {
    const float *limit = limits[0];
    const float *a = h->rows[0], *b = h->rows[1], *c = h->rows[2];
    index_t count = 0;
    for (index_t i = 0; i < h->width; i += STEP) { /* most of a row is far below the limit */
        const index_t stop = i + STEP < h->width ? i + STEP : h->width;
        int any = 0;
        for (index_t x = i; x < stop; x++)
            any |= b[x] > limit[x];
        if (!any)
            continue;
        for (index_t x = i; x < stop; x++) {
            if (!(b[x] > limit[x]))
                continue;
            const index_t w = x > 0 ? x - 1 : x, e = x + 1 < h->width ? x + 1 : x;
            if (b[x] >= b[w] && b[x] >= b[e] && b[x] >= a[w] && b[x] >= a[x] && b[x] >= a[e] && b[x] >= c[w] &&
                b[x] >= c[x] && b[x] >= c[e]) {
                uint8_t kind = SADDLE;
                for (int k = 1; k < LEVELS; k++)
                    kind |= (uint8_t)((b[x] > limits[k][x]) << k);
                mark(cells, down, across, x, y, kind);
                count++;
            }
        }
    }
    return count;
}

/* Mark in `cells` (down, across), initially 0, those in which an X-corner's response may peak by 1, and in addition by
 * 2 and 4 where a saddle also exceeds `blunt` and `steep` × (the contrast + `steep_floor`). Returns the number of
 * saddles. */
FAST_KERNEL(rcdn_sieve, (PICTURE, p), (LET, down, (p.height + CELL - 1) / CELL),
            (LET, across, (p.width + CELL - 1) / CELL), (REAL, share), (REAL, floor_), (REAL, blunt), (REAL, steep),
            (REAL, steep_floor), (OUT, uint8_t, cells, down, across)) {
    Half h = {p.height / 2, p.width / 2, 0, NULL, {NULL, NULL, NULL}, {NULL, NULL, NULL}, {NULL, NULL, NULL}};
    if (h.height < 1 || h.width < 1)
        return 0;
    h.stride = h.width + 2 * PAD;
    const index_t across_blocks = (h.width + BLOCK - 1) / BLOCK,
                  blocks = (h.height + BLOCK - 1) / BLOCK * across_blocks;
    float *room = malloc(((size_t)((h.height + 6 + LEVELS) * h.stride) + LEVELS * (size_t)blocks) * sizeof *room);
    double *sums = malloc(3 * (size_t)blocks * sizeof *sums);
    if (!room || !sums) {
        free(room);
        free(sums);
        return NO_MEMORY;
    }
    h.grey = room;
    for (int k = 0; k < 3; k++) {
        h.rows[k] = room + (h.height + k) * h.stride;
        h.down[k] = room + (h.height + 3 + k) * h.stride;
    }
    const Steepness least[LEVELS] = {
        {(float)share, (float)floor_}, {(float)blunt, (float)steep_floor}, {(float)steep, (float)steep_floor}};
    float *limit[LEVELS];
    for (int k = 0; k < LEVELS; k++) {
        h.limit[k] = room + (h.height + 6 + LEVELS) * h.stride + k * blocks;
        limit[k] = room + (h.height + 6 + k) * h.stride;
    }
    halved(&p, &h);
    limits(&h, least, sums);
    index_t count = 0;
    saddle_row(&h, 0, h.rows[1]);
    memcpy(h.rows[0], h.rows[1], (size_t)h.stride * sizeof(float));
    for (index_t y = 0; y < h.height; y++) {
        if (y + 1 < h.height)
            saddle_row(&h, y + 1, h.rows[2]);
        else
            memcpy(h.rows[2], h.rows[1], (size_t)h.stride * sizeof(float));
        if (y % BLOCK == 0)
            for (int k = 0; k < LEVELS; k++)
                for (index_t x = 0; x < h.width; x++)
                    limit[k][x] = h.limit[k][y / BLOCK * across_blocks + x / BLOCK];
        count += marked(&h, y, limit, cells, down, across);
        float *first = h.rows[0];
        h.rows[0] = h.rows[1];
        h.rows[1] = h.rows[2];
        h.rows[2] = first;
    }
    free(room);
    free(sums);
    return count;
}
