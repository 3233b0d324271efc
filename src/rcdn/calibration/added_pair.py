"""Information of one additional pair of pictures on two cameras, and the resulting uncertainty of three projections:
into either picture, and from the left picture into the right one.

As `added_view`, with the parameters of both lenses and of the relative pose together: the board's pose, common to both
pictures, is marginalised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.added_view import BATCH, Information, Prior, level_of, variances
from rcdn.calibration.bundle import motion_jacobian
from rcdn.calibration.candidates import frame_grid, in_frame
from rcdn.calibration.sight import out_of_sight
from rcdn.geometry import cross_matrix, project, project_with_jacobian, unproject
from rcdn.types import Array, Camera
from rcdn.types.arrays import Real


@dataclass(frozen=True, eq=False)
class PairCovariance:
    """Two `cameras`, the relative pose `T` (4, 4), which takes left coordinates to right ones, and the covariance `cov`
    (P + 6, P + 6) of all P parameters (left lens, right lens, relative pose) and of the boards' mean motion in the left
    camera, over `views` moments. `weight` (2,) 1 / px: that of a corner in each picture, as independent information."""

    cameras: tuple[Camera, Camera]
    T: Array
    cov: Array
    views: int
    weight: tuple[float, float]

    @property
    def counts(self) -> tuple[int, int]:
        """The numbers of parameters of the lenses."""
        return len(self.cameras[0].parameters), len(self.cameras[1].parameters)

    def in_right(self, points: Array) -> Array:
        """`points` (…, 3) of the left camera in coordinates of the right one."""
        return np.asarray(points @ self.T[:3, :3].T + self.T[:3, 3])


@dataclass(frozen=True, eq=False)
class Projections:
    """G projections that are to be known: pixels `xy` (G, 2), of the left picture in the parts `left` and `between`;
    their derivatives `by_shared` (G, 2, P) and `by_motion` (G, 2, 6) with respect to the parameters and to the boards'
    mean motion; `part` (G,): 0 left, 1 right, 2 from left to right; `distance` (G,) m of the points."""

    xy: Array
    by_shared: Array
    by_motion: Array
    part: Array
    distance: Array

    def deviations(self, cov: Array) -> Real[Array, " g"]:
        """(G,) px: standard deviations, root mean square of both axes, under the covariance `cov` (P + 6, P + 6)."""
        rows = np.concatenate([self.by_shared, self.by_motion], axis=2)
        return np.asarray(np.sqrt(np.einsum("gia,ab,gib->g", rows, cov, rows, optimize=True) / 2))


def pair_projections(pair: PairCovariance, distance: float) -> Projections:
    """The projections over both frames.

    `left`, `right`: of distant points fixed with respect to the boards, as in `projection_uncertainty`. `between`: of
    the points that the left camera sees at its pixels, `distance` m away and infinitely far, into the right picture,
    where they lie in it; these are relative, so that no motion of the boards matters.
    """
    left, right, T = *pair.cameras, pair.T
    a, b = pair.counts
    every = []
    for part, camera in enumerate((left, right)):
        xy, rays = _seen(camera)
        _, by_point, by_camera = project_with_jacobian(camera, rays)
        turn = np.concatenate([-by_point @ cross_matrix(rays), 0 * by_point], axis=2)
        shared = np.zeros((len(xy), 2, a + b + 6))
        if part == 0:
            shared[:, :, :a], motion = by_camera, turn
        else:
            shared[:, :, a : a + b], shared[:, :, a + b :] = by_camera, turn
            motion = np.concatenate([turn[:, :, :3] @ T[:3, :3], 0 * by_point], axis=2)
        every.append(Projections(xy, shared, motion, np.full(len(xy), part), np.full(len(xy), np.inf)))
    every += [_between(pair, far) for far in (distance, np.inf)]
    return Projections(
        *(np.concatenate([getattr(p, n) for p in every]) for n in ("xy", "by_shared", "by_motion", "part", "distance"))
    )


def _seen(camera: Camera) -> tuple[Array, Array]:
    """Pixels (G, 2) over the visible part of the frame, and their unit rays (G, 3)."""
    xy = frame_grid(camera.image_size)
    xy = xy[~np.logical_or(*out_of_sight(camera, xy))]
    rays = unproject(camera, xy)
    return xy, rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _between(pair: PairCovariance, distance: float) -> Projections:
    """The projections from the left picture into the right one of points `distance` m away."""
    (left, right), (a, b) = pair.cameras, pair.counts
    R, t = pair.T[:3, :3], pair.T[:3, 3]
    xy, rays = _seen(left)
    there = rays @ R.T + t / distance  # in units of the distance, so that it may be infinite
    out = project(right, there)
    size = np.array(right.image_size) - 1
    inside = (there[:, 2] > 0) & (out >= 0).all(axis=1) & (out <= size).all(axis=1)
    xy, rays, there = xy[inside], rays[inside], there[inside]
    _, by_ray, by_left = project_with_jacobian(left, rays)
    ray_by_left = -np.linalg.pinv(by_ray) @ by_left  # the pixel is fixed: the lens moves the ray
    _, by_point, by_right = project_with_jacobian(right, there)
    shared = np.zeros((len(xy), 2, a + b + 6))
    shared[:, :, :a] = by_point @ R @ ray_by_left
    shared[:, :, a : a + b] = by_right
    shared[:, :, a + b :] = np.concatenate([-by_point @ cross_matrix(there), by_point / distance], axis=2)
    return Projections(xy, shared, np.zeros((len(xy), 2, 6)), np.full(len(xy), 2), np.full(len(xy), distance))


@dataclass(frozen=True, eq=False)
class PairForecast:
    """Prediction of the uncertainties of the `projections` with one more pair of pictures; `before`, the present worst
    one, px, and `level`, their mean of high power (`added_view.NORM`), px."""

    pair: PairCovariance
    prior: Prior
    projections: Projections
    before: float
    level: float

    @classmethod
    def of(cls, pair: PairCovariance, distance: float) -> PairForecast:
        """For points infinitely far, and those `distance` m away."""
        projections = pair_projections(pair, distance)
        now = projections.deviations(pair.cov)
        prior = Prior.split(pair.cov, len(pair.cov) - 6, pair.views)
        return cls(pair, prior, projections, float(now.max()), float(level_of(now[None] ** 2)[0]))

    def after(self, points: Real[Array, "c n 3"], seen: Real[Array, "c 2 n"]) -> tuple[Array, Array]:
        """(C,) px, the worst uncertainty, and (C,) px, the mean: with each of C pairs of pictures of `points`
        (C, N, 3), m, coordinates of the left camera; `seen` (C, 2, N): number of corners that each stands for in each
        picture, 0 where it is not visible."""
        every = []
        for k in range(0, len(points), BATCH):
            more = self._information(points[k : k + BATCH], seen[k : k + BATCH])
            every.append(variances(self.prior, more, self.projections.by_shared, self.projections.by_motion))
        found = np.concatenate(every)
        return np.sqrt(found.max(axis=1)), level_of(found)

    def gain(self, level: Real[Array, " c"]) -> Real[Array, " c"]:
        """(C,) decrease of the logarithm of the mean to `level` (C,) px."""
        return np.asarray(np.log(self.level / np.maximum(level, 1e-12)))

    def _information(self, points: Array, seen: Array) -> Information:
        a, b = self.pair.counts
        shape, flat = points.shape[:2], points.reshape(-1, 3)
        J: list[Array] = []
        B: list[Array] = []
        for c, camera in enumerate(self.pair.cameras):
            here = self.pair.in_right(flat) if c else flat
            _, by_point, by_camera = project_with_jacobian(camera, here)
            in_left = by_point @ self.pair.T[:3, :3] if c else by_point
            shared = np.zeros((len(flat), 2, a + b + 6))
            shared[:, :, a if c else 0 : a + b if c else a] = by_camera
            if c:
                shared[:, :, a + b :] = by_point @ motion_jacobian(here)
            weight = (self.pair.weight[c] * np.sqrt(seen[:, c])).reshape(-1, 1, 1)
            for rows, found in ((J, shared), (B, in_left @ motion_jacobian(flat))):
                rows.append((np.where(weight > 0, found, 0.0) * weight).reshape(shape[0], -1, found.shape[2]))
        return Information.marginalised(np.concatenate(J, axis=1), np.concatenate(B, axis=1))


@dataclass(frozen=True, eq=False)
class SideForecast:
    """The forecast for boards that one camera (`side`: 0 left, 1 right) has seen, in its own coordinates: the other one
    sees them too if `both` and if they are whole in its frame."""

    forecast: PairForecast
    side: int
    both: bool

    def after(self, points: Real[Array, "c n 3"], seen: Real[Array, "c n"]) -> tuple[Array, Array]:
        """As `Forecast.after`."""
        pair = self.forecast.pair
        if self.side:
            back = np.linalg.inv(pair.T)
            left = other = points @ back[:3, :3].T + back[:3, 3]
        else:
            left, other = points, pair.in_right(points)
        whole = in_frame(pair.cameras[1 - self.side], other).all(axis=1, keepdims=True) & self.both
        also = np.where(whole, seen, 0.0)
        return self.forecast.after(left, np.stack([also, seen] if self.side else [seen, also], axis=1))

    def gain(self, level: Real[Array, " c"]) -> Real[Array, " c"]:
        """As `Forecast.gain`."""
        return self.forecast.gain(level)
