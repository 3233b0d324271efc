/* The part of contrast.h that depends on the image's type: included once for each, with NUMBER (type of the sums), OF
 * (names), LEVEL (a pixel as an integer) and UNIT (grey levels per integer). */

/* Columns `from` .. `to` of a row of the padded image. */
INLINE void OF(levels)(const Contrast *c, index_t y, index_t from, index_t to, NUMBER *out) {
    const index_t at = mirrored(c->top + y - BEFORE, c->picture.height) * c->picture.width, width = c->picture.width;
    const index_t first = from < BEFORE ? BEFORE : from, last = to - BEFORE < width ? to : width + BEFORE;
    for (index_t x = from; x < first && x < to; x++)
        out[x - from] = LEVEL(at + mirrored(x - BEFORE, width));
    for (index_t x = first; x < last; x++)
        out[x - from] = LEVEL(at + x - BEFORE);
    for (index_t x = last > from ? last : from; x < to; x++)
        out[x - from] = LEVEL(at + mirrored(x - BEFORE, width));
}

INLINE void OF(exchanged)(NUMBER *restrict sum, NUMBER *restrict square, const NUMBER *restrict in,
                          const NUMBER *restrict out, index_t count) {
    for (index_t x = 0; x < count; x++) {
        const NUMBER change = in[x] - out[x];
        sum[x] += change;
        square[x] += change * (in[x] + out[x]);
    }
}

/* Update the sums of a block of columns to row `y`. */
INLINE void OF(slide)(Contrast *c, index_t block, index_t y) {
    const index_t from = block * COLUMNS - HALF,
                  to = from + COLUMNS < c->width + HALF ? from + COLUMNS : c->width + HALF, count = to - from;
    NUMBER *sum = (NUMBER *)c->sum + block * COLUMNS, *square = (NUMBER *)c->square + block * COLUMNS, *in = c->in,
           *out = c->out;
    index_t next = c->summed[block] + 1;
    if (!next || y - next >= SIDE) {
        memset(sum, 0, (size_t)count * sizeof *sum);
        memset(square, 0, (size_t)count * sizeof *square);
        memset(out, 0, (size_t)count * sizeof *out);
        for (index_t k = y - HALF; k <= y + HALF; k++) {
            OF(levels)(c, k, from, to, in);
            OF(exchanged)(sum, square, in, out, count);
        }
        next = y + 1;
    }
    for (; next <= y; next++) {
        OF(levels)(c, next - HALF - 1, from, to, out);
        OF(levels)(c, next + HALF, from, to, in);
        OF(exchanged)(sum, square, in, out, count);
    }
    c->summed[block] = y;
}

/* Sums over SIDE = 16 + 8 + 1 neighbours along a row of `count` + 2 HALF numbers. */
INLINE void OF(along)(const NUMBER *restrict row, index_t count, NUMBER *restrict room, NUMBER *restrict out) {
    for (index_t x = 0; x < count + SIDE - 2; x++)
        room[x] = row[x] + row[x + 1];
    for (index_t x = 0; x < count + SIDE - 4; x++)
        room[x] += room[x + 2];
    for (index_t x = 0; x < count + SIDE - 8; x++)
        room[x] += room[x + 4];
    for (index_t x = 0; x < count; x++)
        out[x] = room[x] + room[x + 8] + room[x + 16] + row[x + 24];
}

INLINE void OF(quotients)(const NUMBER *restrict sum, const NUMBER *restrict square, const NUMBER *restrict grey,
                          index_t count, float *restrict out) {
    const float share = 1.0f / (SIDE * SIDE);
    for (index_t x = 0; x < count; x++) {
        const NUMBER spread = SIDE * SIDE * square[x] - sum[x] * sum[x]; /* in float, off by .03 grey levels if flat */
        const float deviation = sqrtf((float)(spread > 0 ? spread : 0)) * share;
        out[x] = (float)(grey[x] - sum[x] * (NUMBER)share) * UNIT / (deviation * UNIT + FLOOR);
    }
}

INLINE void OF(normalise)(Contrast *c, index_t y, index_t from, index_t to, float *out) {
    const index_t count = to - from;
    for (index_t block = from / COLUMNS; block <= (to + 2 * HALF - 1) / COLUMNS; block++)
        OF(slide)(c, block, y);
    NUMBER *sum = c->out, *square = c->in, *room = c->room;
    OF(along)((NUMBER *)c->sum + from, count, room, sum);
    OF(along)((NUMBER *)c->square + from, count, room, square);
    OF(levels)(c, y, from, to, room);
    OF(quotients)(sum, square, room, count, out);
}

#undef NUMBER
#undef OF
#undef LEVEL
#undef UNIT
