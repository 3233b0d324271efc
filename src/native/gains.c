/* An upper bound of the evidence for markers with consecutive numbers in the squares of a board. See
 * rcdn/targets/gains.py. */
#include "kernel.h"

/* Roles of a square: it is the first of its row in the list; it may lie beyond the board's sides; its row may lie
 * beyond the board; it is in the last row, which squares without a marker may belong to. */
enum { FIRST = 1, BESIDE = 2, LOOSE = 4, LAST = 8, ROLES = 15 };

/* markers that are processed together, in so many vectors; columns of the widest board of which a part may be visible,
 * and of any board */
enum { BLOCK = 64, VECTORS = BLOCK / FLOATS, COLUMNS = 64, WIDEST = 1 << 16 };
CONSTANTS(gains, FIRST, BESIDE, LOOSE, LAST, BLOCK, COLUMNS)

/* evidence at positions that no layout allows */
#define NEVER -1e6f

typedef float vec __attribute__((vector_size(4 * FLOATS)));

typedef int32_t whole_vec __attribute__((vector_size(4 * FLOATS)));

INLINE vec load(const float *p) {
    vec v;
    memcpy(&v, p, sizeof v);
    return v;
}

/* Squares of a board, row by row, in `turns` images of it. For each square: the log-likelihood ratios of white to black
 * of its bits, `own`, log2; the evidence of its frame, with all bits `black`; logarithms of the probabilities that it
 * does not show its marker (`covered`) and that it does (`free`); its `role`. */
ARGUMENT_GROUP(Turned, (SIZE, turns, own, 0), (SIZE, count, own, 1), (SIZE, many, own, 2),
               (IN, float, own, turns, count, many), (IN, float, black, turns, count),
               (IN, float, covered, turns, count), (IN, float, free, turns, count),
               (WITHIN, int32_t, role, 0, ROLES, turns, count))

/* The squares `first` .. `first + length` of a row, and its evidence for n markers: `sum` (n + 2 length), indexed by
 * the marker of its first square from -length on; `outside` that range. */
typedef struct {
    index_t first, length;
    float *sum, outside;
} Row;

/* An upper bound of log2(covered + (1 - covered) 2^shown) from its two logarithms: log2(1 + 2^-x), x >= 0, lies below
 * its chords. */
INLINE float gain_at_most(float shown, float covered, float free) {
    const float x = shown + free - covered, t = fabsf(x), near = 1.0001f - 0.339f * t, far = 0.5071f - 0.0925f * t;
    const float chord = near > far ? near : far;
    return covered + (x > 0 ? x : 0) + (chord > 0.0445f ? chord : 0.0445f);
}

/* Upper bound of the evidence of square k for each of the markers, `gain` (blocks * BLOCK). */
INLINE void most_gains(const Turned *turned, index_t k, const float *bits, index_t blocks, float *gain) {
    const float *own = turned->own + k * turned->many;
    for (index_t block = 0; block < blocks; block++) {
        vec sum[VECTORS];
        for (int j = 0; j < VECTORS; j++)
            sum[j] = (vec){0} + turned->black[k];
        for (index_t b = 0; b < turned->many; b++, bits += BLOCK)
            for (int j = 0; j < VECTORS; j++)
                sum[j] += load(bits + j * FLOATS) * own[b];
        memcpy(gain + block * BLOCK, sum, sizeof sum);
    }
    for (index_t n = 0; n < blocks * BLOCK; n++)
        gain[n] = gain_at_most(gain[n], turned->covered[k], turned->free[k]);
}

/* Add the evidence of a square in `role`, number j of its row, for n markers. */
INLINE void add_square(Row *row, const float *restrict gain, index_t n, index_t j, int role) {
    const float least = role & BESIDE ? 0 : NEVER, none = role & (BESIDE | LAST) ? 0 : NEVER;
    const index_t from = row->length - j;
    float *restrict sum = row->sum;
    for (index_t k = 0; k < from; k++)
        sum[k] += none;
    for (index_t k = 0; k < n; k++)
        sum[from + k] += gain[k] > least ? gain[k] : least;
    for (index_t k = from + n; k < n + 2 * row->length; k++)
        sum[k] += none;
    row->outside += none;
}

/* The rows of an image, their number, and their sums of the evidence for n markers; `room` is the buffer for these. */
INLINE index_t sums_of_rows(const Turned *turned, index_t t, const float *bits, index_t blocks, index_t n, float *gain,
                            float *room, Row *rows) {
    const int32_t *role = turned->role + t * turned->count;
    index_t count = 0;
    for (index_t first = 0, length; first < turned->count; first += length) {
        for (length = 1; first + length < turned->count && !(role[first + length] & FIRST);)
            length++;
        Row *row = rows + count++;
        *row = (Row){first, length, room, 0};
        room += n + 2 * length;
        memset(row->sum, 0, (size_t)(n + 2 * length) * sizeof(float));
        for (index_t j = 0; j < length; j++) {
            most_gains(turned, t * turned->count + first + j, bits, blocks, gain);
            add_square(row, gain, n, j, role[first + j]);
        }
        if (role[first] & LOOSE) {
            for (index_t k = 0; k < n + 2 * length; k++)
                row->sum[k] = row->sum[k] > 0 ? row->sum[k] : 0;
            row->outside = row->outside > 0 ? row->outside : 0;
        }
    }
    return count;
}

/* Upper bound of the evidence of the rows, each taken separately. */
INLINE double most_apart(const Row *rows, index_t count, index_t n) {
    double most = 0;
    for (const Row *row = rows; row < rows + count; row++) {
        float best = row->outside;
        for (index_t k = 0; k < n + 2 * row->length; k++)
            best = row->sum[k] > best ? row->sum[k] : best;
        most += best;
    }
    return most;
}

/* Add every second row from `first` on, of a board with so many columns, to `sum` (size), indexed by the marker of the
 * first square of row `first`, from -`before` on. */
INLINE void add_rows(const Row *rows, index_t count, index_t first, index_t columns, index_t n, index_t before,
                     index_t size, float *restrict sum) {
    for (index_t r = first; r < count; r += 2) {
        const index_t from = before - rows[r].length - r / 2 * columns, to = from + n + 2 * rows[r].length;
        const float *restrict row = rows[r].sum;
        for (index_t k = 0; k < from; k++)
            sum[k] += rows[r].outside;
        for (index_t k = from; k < to; k++)
            sum[k] += row[k - from];
        for (index_t k = to; k < size; k++)
            sum[k] += rows[r].outside;
    }
}

/* The largest of `most` and of the sums of both arrays (size). */
INLINE float most_together(const float *even, const float *odd, index_t size, float most) {
    vec best = (vec){0} + most;
    index_t k = 0;
    for (; k + FLOATS <= size; k += FLOATS) {
        const vec sum = load(even + k) + load(odd + k);
        const whole_vec more = sum > best;
        best = (vec)((more & (whole_vec)sum) | (~more & (whole_vec)best));
    }
    for (int j = 0; j < FLOATS; j++)
        most = best[j] > most ? best[j] : most;
    for (; k < size; k++)
        most = even[k] + odd[k] > most ? even[k] + odd[k] : most;
    return most;
}

/* Upper bound of the evidence of all rows together for a board with so many columns. `right`: the first square of the
 * second row lies to the right of the first row's. */
INLINE float most_of_board(const Row *rows, index_t count, index_t columns, int right, index_t n, index_t margin,
                           float *even, float *odd, float most) {
    const index_t size = n + 2 * margin;
    memset(even, 0, (size_t)size * sizeof(float));
    memset(odd, 0, (size_t)size * sizeof(float));
    add_rows(rows, count, 0, columns, n, margin, size, even);
    add_rows(rows, count, 1, columns, n, margin, size, odd);
    /* Two rows have as many markers as there are columns, half of them each, rounded down or up; and the second row may
     * begin one square to the side. */
    for (index_t step = columns / 2 - !right; step <= (columns + 1) / 2 + right; step++)
        most = most_together(even, odd + step, size - step, most);
    return most;
}

/* Number of rows of an image. */
INLINE index_t rows_of(const Turned *turned, index_t t) {
    index_t rows = 1;
    for (index_t k = 1; k < turned->count; k++)
        rows += (turned->role[t * turned->count + k] & FIRST) != 0;
    return rows;
}

/* Buffer sizes over all images: the largest number of rows; and how many markers before the first one, or after the
 * last, the first square of a first or second row may have while some square of the image shows a marker. */
typedef struct {
    index_t rows, margin;
} Extent;

/* Possible numbers of columns of a board: those that are visible, of which the outermost may lie beyond it, or more. */
INLINE index_t narrowest_of(index_t width) {
    return width > 4 ? width - 2 : 2;
}

INLINE index_t widest_of(index_t width) {
    return width > COLUMNS ? width : COLUMNS;
}

INLINE Extent extent_of(const Turned *turned, const int32_t *width) {
    Extent out = {0, 0};
    for (index_t t = 0; t < turned->turns; t++) {
        const index_t rows = rows_of(turned, t), margin = (rows / 2 + 2) * widest_of(width[t]) + turned->count;
        out.rows = rows > out.rows ? rows : out.rows;
        out.margin = margin > out.margin ? margin : out.margin;
    }
    return out;
}

/* `most` (turns): an upper bound, up to rounding, of the evidence of all layouts of boards, of which the images show
 * `width` (turns) squares per row, and whose n markers are in every second square, numbered row by row. `bits` (blocks,
 * many, BLOCK) of the markers, 0 or 1. If the bound from the separate rows is below `least`, that bound is returned
 * instead. */
FAST_KERNEL(rcdn_most_evidence, (GROUP, Turned, turned), (SIZE, blocks, bits, 0),
            (IN, float, bits, blocks, turned.many, BLOCK), (WHERE, turned.count > 0), (INT, n, 0, blocks *BLOCK),
            (WITHIN, int32_t, width, 1, WIDEST, turned.turns), (REAL, least), (OUT, double, most, turned.turns)) {
    const Extent extent = extent_of(&turned, width);
    const index_t margin = extent.margin, size = n + 2 * margin, sums = extent.rows * n + 2 * turned.count;
    Row *rows = malloc((size_t)extent.rows * sizeof(Row) + (size_t)(blocks * BLOCK + 2 * size + sums) * sizeof(float));
    if (!rows)
        return NO_MEMORY;
    float *gain = (float *)(rows + extent.rows), *even = gain + blocks * BLOCK, *odd = even + size;
    for (index_t t = 0; t < turned.turns; t++) {
        const index_t count = sums_of_rows(&turned, t, bits, blocks, n, gain, odd + size, rows);
        const int right = (turned.role[t * turned.count] & BESIDE) != 0;
        float best = 3 * NEVER;
        most[t] = most_apart(rows, count, n);
        for (index_t columns = narrowest_of(width[t]); columns <= widest_of(width[t]) && most[t] >= least; columns++)
            best = most_of_board(rows, count, columns, right, n, margin, even, odd, best);
        most[t] = most[t] >= least && best < most[t] ? best : most[t];
    }
    free(rows);
    return 0;
}
