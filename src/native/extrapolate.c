/* Extrapolation of a grid beyond its known positions. See rcdn/targets/rectify.py. */
#include "kernel.h"

INLINE int known(const double *grid, index_t rows, index_t columns, index_t row, index_t column) {
    return row >= 0 && row < rows && column >= 0 && column < columns && isfinite(grid[2 * (row * columns + column)]);
}

/* `out` (rows, columns, 2): each position extrapolated from the three, or two, preceding ones in a line, averaged over
 * the directions (of four) that have them; NaN if none has. */
KERNEL(rcdn_extrapolated, (SIZE, rows, grid, 0), (SIZE, columns, grid, 1), (IN, double, grid, rows, columns, 2),
       (OUT, double, out, rows, columns, 2)) {
    static const index_t before[4][2] = {{-1, 0}, {0, 1}, {1, 0}, {0, -1}}; /* up, after 0 to 3 quarter turns */
    for (index_t row = 0; row < rows; row++)
        for (index_t column = 0; column < columns; column++) {
            double total[2] = {0, 0};
            int count = 0;
            for (int turns = 0; turns < 4; turns++) {
                const index_t down = before[turns][0], right = before[turns][1];
                if (!known(grid, rows, columns, row + down, column + right) ||
                    !known(grid, rows, columns, row + 2 * down, column + 2 * right))
                    continue;
                const int three = known(grid, rows, columns, row + 3 * down, column + 3 * right);
                const double *at = grid + 2 * (row * columns + column);
                const index_t step = 2 * (down * columns + right);
                for (int k = 0; k < 2; k++)
                    total[k] += three ? 3 * at[step + k] - 3 * at[2 * step + k] + at[3 * step + k]
                                      : 2 * at[step + k] - at[2 * step + k];
                count++;
            }
            for (int k = 0; k < 2; k++)
                out[2 * (row * columns + column) + k] = count ? total[k] / count : NAN;
        }
    return 0;
}
