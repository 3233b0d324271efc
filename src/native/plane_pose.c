/* Poses of flat boards from the viewing rays of their corners. See rcdn.calibration.start. */
#include "kernel.h"
#include "solvers.h"

enum { UNKNOWNS = 9, LEAST = 4, STEPS = 200 };

/* Change of a unit vector below which the power method ends */
#define SETTLED 1e-13
/* Determinant of the covariance of corners that lie on one line, × the square of its trace, at most */
#define LINE 1e-12

/* Normal matrix of ray × (H X) = 0 in the entries of H (3, 3), for X = (x, y, 1) of board points (count, 2) and rays
 * (count, 3) of unit length: each adds P ⊗ X Xᵀ with P = I − ray · rayᵀ, since PᵀP = P. */
INLINE void normal_matrix(index_t count, const double *rays, const double *board, const double *weight,
                          double out[UNKNOWNS][UNKNOWNS]) {
    double sums[6][6] = {{0}};
    for (index_t k = 0; k < count; k++) {
        const double *r = rays + 3 * k, x = board[2 * k], y = board[2 * k + 1], w = weight[k];
        const double P[6] = {w * (1 - r[0] * r[0]), -w * r[0] * r[1], -w * r[0] * r[2],
                             w * (1 - r[1] * r[1]), -w * r[1] * r[2], w * (1 - r[2] * r[2])};
        const double X[6] = {x * x, x * y, x, y * y, y, 1};
        for (int a = 0; a < 6; a++)
            for (int b = 0; b < 6; b++)
                sums[a][b] += P[a] * X[b];
    }
    static const int entry[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}}; /* of a symmetric matrix's upper triangle */
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                for (int l = 0; l < 3; l++)
                    out[3 * i + k][3 * j + l] = sums[entry[i][j]][entry[k][l]];
}

/* Eigenvector of the smallest eigenvalue of a positive semidefinite matrix, which is replaced by its inverse, by the
 * power method. */
INLINE void least_eigenvector(double m[UNKNOWNS][UNKNOWNS], double *out) {
    int first = 0;
    invert_definite(UNKNOWNS, UNKNOWNS, m[0]);
    for (int k = 1; k < UNKNOWNS; k++)
        if (m[k][k] > m[first][first])
            first = k;
    memcpy(out, m[first], UNKNOWNS * sizeof *out);
    double change = INFINITY;
    for (int step = 0; step < STEPS && change > SETTLED * SETTLED; step++) {
        double next[UNKNOWNS], square = 0;
        for (int k = 0; k < UNKNOWNS; k++) {
            next[k] = 0;
            for (int l = 0; l < UNKNOWNS; l++)
                next[k] += m[k][l] * out[l];
            square += next[k] * next[k];
        }
        change = 0;
        for (int k = 0; k < UNKNOWNS; k++) {
            const double unit = next[k] / sqrt(square);
            change += (unit - out[k]) * (unit - out[k]);
            out[k] = unit;
        }
    }
}

/* Whether points (count, 2) with a weight do not all lie on one line. */
INLINE int span_a_plane(index_t count, const double *points, const double *weight) {
    double sum = 0, mean[2] = {0, 0}, xx = 0, xy = 0, yy = 0;
    for (index_t k = 0; k < count; k++) {
        sum += weight[k];
        mean[0] += weight[k] * points[2 * k];
        mean[1] += weight[k] * points[2 * k + 1];
    }
    for (index_t k = 0; k < count; k++) {
        const double x = points[2 * k] - mean[0] / sum, y = points[2 * k + 1] - mean[1] / sum;
        xx += weight[k] * x * x;
        xy += weight[k] * x * y;
        yy += weight[k] * y * y;
    }
    return xx * yy - xy * xy > LINE * (xx + yy) * (xx + yy);
}

/* Pose T (4, 4) whose first two axes and origin are nearest to the columns of H (3, 3), up to a factor: the polar factor
 * A (AᵀA)^−½ of the first two columns A, and the third ÷ the mean of their singular values. */
INLINE void nearest_pose(const double *H, double *T) {
    double pp = 0, pq = 0, qq = 0, axes[3][3];
    for (int i = 0; i < 3; i++) {
        pp += H[3 * i] * H[3 * i];
        pq += H[3 * i] * H[3 * i + 1];
        qq += H[3 * i + 1] * H[3 * i + 1];
    }
    const double root = sqrt(pp * qq - pq * pq), both = sqrt(pp + qq + 2 * root);
    for (int i = 0; i < 3; i++) {
        axes[0][i] = (H[3 * i] * (qq + root) - H[3 * i + 1] * pq) / (root * both);
        axes[1][i] = (H[3 * i + 1] * (pp + root) - H[3 * i] * pq) / (root * both);
    }
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double row[4] = {axes[0][i], axes[1][i], axes[0][j] * axes[1][k] - axes[0][k] * axes[1][j],
                               2 * H[3 * i + 2] / both};
        memcpy(T + 4 * i, row, sizeof row);
    }
    const double last[4] = {0, 0, 0, 1};
    memcpy(T + 12, last, sizeof last);
}

/* H (3, 3) with H (x, y, 1) along the rays of board points (x, y), by minimal algebraic error; of its two signs, the one
 * that places the board in their direction. */
INLINE void ray_homography(index_t count, const double *rays, const double *board, const double *weight, double *H) {
    double m[UNKNOWNS][UNKNOWNS], along = 0;
    normal_matrix(count, rays, board, weight, m);
    least_eigenvector(m, H);
    for (index_t k = 0; k < count; k++)
        for (int i = 0; i < 3; i++)
            along += weight[k] * rays[3 * k + i] *
                     (H[3 * i] * board[2 * k] + H[3 * i + 1] * board[2 * k + 1] + H[3 * i + 2]);
    for (int k = 0; k < UNKNOWNS && along < 0; k++)
        H[k] = -H[k];
}

/* Poses T (views, 4, 4) of flat boards with corners board (views, many, 2) from their viewing rays (views, many, 3) of
 * any length. Corners without a finite ray, and those not `there` (1; else 0), do not count; NaN if fewer than four are
 * left, or if they lie on one line of the board. */
KERNEL(rcdn_plane_poses, (SIZE, views, rays, 0), (SIZE, many, rays, 1), (IN, double, rays, views, many, 3),
       (IN, double, board, views, many, 2), (IN, double, there, views, many), (ROOM, double, room, 4 * many),
       (OUT, double, T, views, 4, 4)) {
    double *unit = room, *weight = room + 3 * many;
    for (index_t v = 0; v < views; v++) {
        const double *own = rays + 3 * many * v, *points = board + 2 * many * v;
        double count = 0, H[UNKNOWNS];
        for (index_t k = 0; k < many; k++) {
            const double *r = own + 3 * k, square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2];
            const int seen = square > 0 && square < INFINITY;
            weight[k] = seen ? there[many * v + k] : 0;
            count += weight[k];
            for (int i = 0; i < 3; i++)
                unit[3 * k + i] = seen ? r[i] / sqrt(square) : 0;
        }
        if (count < LEAST || !span_a_plane(many, points, weight)) {
            for (int k = 0; k < 16; k++)
                T[16 * v + k] = NAN;
            continue;
        }
        ray_homography(many, unit, points, weight, H);
        nearest_pose(H, T + 16 * v);
    }
    return 0;
}
