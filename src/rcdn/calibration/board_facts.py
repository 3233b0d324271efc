"""Whether the board is what it was taken for: how far residuals ask for squares that aren't square, and for a board that is bent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.board_points import board_points
from rcdn.geometry import cross_matrix, project_with_slopes
from rcdn.types import Array, BoardView, Calibration

FEWEST = 6
"""views whose place on the board is settled, below which nothing is said"""
SAME = 1e-3
"""px by which projections may differ from those that the residuals were taken from"""
SIGMAS = 3.0
"""standard deviations beyond which a figure is told from zero"""


@dataclass(frozen=True)
class BoardFacts:
    """What all views ask of the board beyond a flat one of squares, with standard deviations: `stretch`, by how much its columns are wider
    apart than its rows (a share), and `bend`, how far its middle stands out along columns and along rows, as a share of its longer side.
    NaN where it can't be told."""

    stretch: float
    stretch_std: float
    bend: tuple[float, float]
    bend_std: tuple[float, float]

    @property
    def stretched(self) -> float:
        """The stretch beyond SIGMAS deviations; NaN where it can't be told."""
        return max(abs(self.stretch) - SIGMAS * self.stretch_std, 0.0)

    @property
    def bent(self) -> float:
        """The larger bend beyond SIGMAS deviations; NaN where it can't be told."""
        beyond = [max(abs(b) - SIGMAS * s, 0.0) for b, s in zip(self.bend, self.bend_std, strict=True)]
        return float(np.max(beyond))


UNKNOWN = BoardFacts(float("nan"), float("nan"), (float("nan"),) * 2, (float("nan"),) * 2)


def measure_board(calibration: Calibration) -> BoardFacts:
    """One Gauss–Newton step of lens and board together, poses eliminated view by view, from the solution of a flat board of squares.

    Its covariance is clustered by views (a sandwich: the views' gradients vary by more than the noise of their corners says). Nothing is
    said of boards whose columns can't be told from their rows, of triangles, or of fewer than FEWEST settled views. Where the board's shape
    was solved for, its stretch counts, too; its bend doesn't, for the camera makes up for nothing of it.
    """
    c = calibration
    views = [v for v in c.used_views if v.settled and v.pose is not None]
    if c.size is None or c.orientation == "ambiguous_90" or len(views) < FEWEST:
        return UNKNOWN
    systems = [_reduced(c, v) for v in views]
    if any(s is None for s in systems):
        return UNKNOWN
    gradients = np.array([J.T @ e for J, e in (s for s in systems if s is not None)])
    normal = np.sum([J.T @ J for J, _ in (s for s in systems if s is not None)], axis=0)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-12) / np.outer(scale, scale)
    step = inverse @ gradients.sum(axis=0)
    left = gradients - np.array([J.T @ (J @ step) for J, _ in (s for s in systems if s is not None)])
    few = len(views) / (len(views) - 1)
    std = np.sqrt(np.maximum(np.diag(inverse @ (left.T @ left) @ inverse) * few, 0.0))[-3:]
    side = (max(c.size) - 1) * c.spacing
    stretch, *bent = (step[-3:] / [1, side, side]).tolist()
    stretch_std, *bent_std = (std / [1, side, side]).tolist()
    stretch += _stretch_of(c)
    return BoardFacts(stretch, stretch_std, (bent[0], bent[1]), (bent_std[0], bent_std[1]))


def _reduced(calibration: Calibration, view: BoardView) -> tuple[Array, Array] | None:
    """Jacobian (2M, P + 3) of the view's corners by camera parameters, stretch and two bends, and residuals (2M,), both without what the
    pose can take up; None if the projections aren't those that the residuals were taken from."""
    assert view.pose is not None
    mine = view.used & np.isfinite(view.residuals).all(axis=1)
    ij, residuals = view.ij[mine], view.residuals[mine]
    board = board_points(calibration, view, "checker")[mine]
    turned = board @ view.pose.R.T
    xy, by_point, by_camera = project_with_slopes(calibration.camera, turned + view.pose.t)
    if not len(ij) or not np.abs(xy + residuals - view.xy[mine]).max() < SAME:
        return None
    by_pose = np.concatenate([-by_point @ cross_matrix(turned), by_point], axis=2)
    by_board = by_point @ view.pose.R
    raised = _raised(ij, calibration.size or (1, 1))
    shape = np.stack([by_board[:, :, 0] * board[:, :1], *(by_board[:, :, 2] * raised[:, [a]] for a in (0, 1))], axis=2)
    J = np.concatenate([by_camera, shape], axis=2).reshape(2 * len(ij), -1)
    Q, _ = np.linalg.qr(by_pose.reshape(2 * len(ij), 6))
    e = residuals.reshape(-1)
    return J - Q @ (Q.T @ J), e - Q @ (Q.T @ e)


def _raised(ij: Array, size: tuple[int, int]) -> Array:
    """(N, 2) how far a corner stands out of a board whose middle stands out by 1 along its columns, and along its rows."""
    half = (np.array(size) - 1) / 2
    return np.asarray(1 - ((ij - half) / np.maximum(half, 0.5)) ** 2)


def _stretch_of(calibration: Calibration) -> float:
    """By how much the columns of the board's shape are wider apart than its rows, a share; 0 of a perfect board."""
    if calibration.shape is None:
        return 0.0
    offsets = calibration.shape.offsets
    slopes = [
        float(np.polyfit(np.arange(offsets.shape[1 - a]) * calibration.spacing, offsets[:, :, a].mean(axis=a), 1)[0])
        for a in (0, 1)
    ]
    return slopes[0] - slopes[1]
