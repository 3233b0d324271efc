"""Two unknown poses on both sides of known ones: T_b_t = T_b_a · T_a_s · T_s_t for many moments (AX = YB)."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.relative_pose import Hypotheses
from rcdn.geometry.rigid import motion, nearest_rotation
from rcdn.types import Array
from rcdn.types.arrays import Real

FEWEST = 5
"""fewest moments that must agree: four determine both poses with some redundancy"""
DRAWS, DRAWN = 100, 4
"""number of random draws of moments, and of moments in a draw"""
TURNED = 0.1
"""rad; least turn (RMS) of the boards about the axis about which they turn least: turns about one axis leave the shift
along it open"""


def hand_eye(
    A: Real[Array, "m 4 4"], B: Real[Array, "m 4 4"], reach: Real[Array, " m"]
) -> tuple[Array, Array, int] | None:
    """Y and X (4, 4) with B = Y A X for most of the moments, and the number of these; None if fewer than half of them,
    or than FEWEST, agree, or if all were turned alike.

    The solution with the most support among those of random draws, then that of all moments that support it. `reach`
    (M,) m: distances at which the boards were seen, as in `Hypotheses`.
    """
    if len(A) < FEWEST or not _turned(A):
        return None
    rng, best, most = np.random.default_rng(0), np.zeros(len(A), bool), 0
    for _ in range(DRAWS):
        some = rng.choice(len(A), DRAWN, replace=False)
        good = _agreeing(A, B, reach, _solved(A[some], B[some]))
        if good.sum() > most:
            best, most = good, int(good.sum())
    if most < DRAWN or not _turned(A[best]):
        return None
    found = _solved(A[best], B[best])
    votes = int(_agreeing(A, B, reach, found).sum())
    return (*found, votes) if votes >= max(FEWEST, len(A) / 2) else None


def _turned(A: Real[Array, "m 4 4"]) -> bool:
    """Whether the rotations differ about two axes."""
    R = A[:, :3, :3]
    spread = np.linalg.svd((R - R.mean(axis=0)).reshape(-1, 3), compute_uv=False)
    return bool(spread[-1] > TURNED * np.sqrt(len(A)))


def _agreeing(A: Array, B: Array, reach: Array, found: tuple[Array, Array]) -> Array:
    """(M,) whether each moment agrees with Y and X."""
    Y, X = found
    gap = np.linalg.inv(Y @ A @ X) @ B
    return np.asarray(Hypotheses(gap[:, None], (0,), reach).gaps(np.eye(4))[:, 0] <= 1)


def _solved(A: Real[Array, "m 4 4"], B: Real[Array, "m 4 4"]) -> tuple[Array, Array]:
    """Y and X (4, 4) by least squares: rotations first, as the null vector of R_A R_X − R_Yᵀ R_B, then translations."""
    eye = np.eye(3)
    rows = [np.hstack([np.kron(a, eye), -np.kron(eye, b.T)]) for a, b in zip(A[:, :3, :3], B[:, :3, :3], strict=True)]
    null = np.linalg.svd(np.concatenate(rows))[2][-1].reshape(2, 3, 3)
    null = null * np.sign(np.linalg.det(null[0]) or 1.0)
    R_X, R_Y = nearest_rotation(null[0]), nearest_rotation(null[1]).T
    left = np.concatenate([np.hstack([R_Y @ a, eye]) for a in A[:, :3, :3]])
    right = np.concatenate([b - R_Y @ a for a, b in zip(A[:, :3, 3], B[:, :3, 3], strict=True)])
    t = np.linalg.lstsq(left, right, rcond=None)[0]
    return motion(R_Y, t[3:]), motion(R_X, t[:3])
