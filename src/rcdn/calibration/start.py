"""Initial guesses for the least squares: an approximate camera from all boards at once, and poses from viewing rays.

The homography of a plane to rays instead of pixels (Zhang 2000, for any lens whose pixels have rays) is also valid
beside and behind the camera. Focal length and distortion are found by a grid search with a division model (Fitzgibbon
2001), which approximates every kind of lens.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.geometry import project, unproject
from rcdn.geometry.median import median
from rcdn.native import bind
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real

_plane_poses = bind("rcdn_plane_poses")

FOCAL = 0.3 * 1.28 ** np.arange(17)
"""focal lengths of the grid search, in half diagonals of the picture: 0.3 to 16"""
BEND = (0.0, 0.1, -0.08, -0.2, -0.4, -0.7, -1.0, -1.4)
"""distortions of the grid search: λ·r² of the division model at the half diagonal"""
MOST_BOARDS, MOST_CORNERS = 16, 40
"""most boards that the grid search uses, and most corners of each"""


@dataclass(frozen=True, eq=False)
class Seen:
    """One board in one picture: `board` (M, 2) positions on the board, m, and `xy` (M, 2) px."""

    board: Array
    xy: Array


def first_camera(views: list[Seen], image_size: tuple[int, int]) -> Camera:
    """An approximate camera of the model `division`: focal length and distortion with the least median reprojection
    error of planar boards."""
    some = [views[k] for k in np.linspace(0, len(views) - 1, min(len(views), MOST_BOARDS)).astype(int)]
    batch = _Batch.of([_thinned(view) for view in some])
    half = float(np.hypot(*image_size)) / 2
    tries = [division_camera(f * half, bend, half, image_size) for f in FOCAL for bend in BEND]
    return min(tries, key=batch.misfit)


def _thinned(view: Seen) -> Seen:
    """At most MOST_CORNERS of its corners, in no order: evenly spaced ones can be those of one column."""
    mine = np.random.default_rng(0).permutation(len(view.xy))[:MOST_CORNERS]
    return Seen(view.board[mine], view.xy[mine])


def division_camera(focal: float, bend: float, half: float, image_size: tuple[int, int]) -> Camera:
    """A division camera whose principal point is the picture's centre; `bend`: λ·r² at `half` px from there."""
    width, height = image_size
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    return Camera(K, np.array([bend * (focal / half) ** 2]), image_size, "division")


def poses(camera: Camera, views: list[Seen]) -> Real[Array, "v 4 4"]:
    """(V, 4, 4) initial guess of T_cam_board of each view under `camera`; NaN where the lens has rays for fewer than
    four corners, or for those of one line only."""
    return _Batch.of(views).poses(camera)


@dataclass(frozen=True, eq=False)
class _Batch:
    """Views as arrays: `board` (V, M, 2), centred and scaled to a mean radius of √2 by `centre` (V, 2) and `scale`
    (V,), `xy` (V, M, 2), `there` (V, M): 1, or 0 for the padding of shorter views."""

    board: Array
    xy: Array
    there: Array
    centre: Array
    scale: Array

    @classmethod
    def of(cls, views: list[Seen]) -> _Batch:
        many = max(len(v.xy) for v in views)
        board, xy = np.zeros((len(views), many, 2)), np.zeros((len(views), many, 2))
        there = np.zeros((len(views), many))
        centre, scale = np.zeros((len(views), 2)), np.ones(len(views))
        for k, view in enumerate(views):
            n = len(view.xy)
            centre[k] = view.board.mean(axis=0)
            scale[k] = np.sqrt(2) / np.linalg.norm(view.board - centre[k], axis=1).mean()
            board[k, :n], xy[k, :n], there[k, :n] = (view.board - centre[k]) * scale[k], view.xy, 1.0
            xy[k, n:] = view.xy[0]
        return cls(board, xy, there, centre, scale)

    def misfit(self, camera: Camera) -> float:
        """Median over the boards of the median reprojection error of their corners, px, under poses of planar
        boards."""
        T = self._scaled_poses(camera)
        points = self.board @ T[:, :3, :2].transpose(0, 2, 1) + T[:, None, :3, 3]
        gap = np.linalg.norm(project(camera, points) - self.xy, axis=2)
        gap = np.where(self.there == 0, np.inf, np.where(np.isfinite(gap), gap, 1e6))
        order, many, view = np.sort(gap, axis=1), np.count_nonzero(self.there, axis=1), np.arange(len(gap))
        return median((order[view, (many - 1) // 2] + order[view, many // 2]) / 2)

    def poses(self, camera: Camera) -> Real[Array, "v 4 4"]:
        """(V, 4, 4), in the unit of the views."""
        T = self._scaled_poses(camera)
        T[:, :3, 3] /= self.scale[:, None]
        T[:, :3, 3] -= (T[:, :3, :2] @ self.centre[:, :, None])[..., 0]
        return T

    def _scaled_poses(self, camera: Camera) -> Array:
        T = np.empty((len(self.xy), 4, 4))
        _plane_poses(unproject(camera, self.xy), self.board, self.there, np.empty(4 * self.xy.shape[1]), T)
        return T
