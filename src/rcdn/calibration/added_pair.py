"""Information of one additional pair of pictures on two cameras, and the resulting uncertainty of three projections:
into either picture, and from the left picture into the right one.

As `added_view`, with the parameters of both lenses and of the relative pose together: the board's pose, common to both
pictures, is marginalised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.added_view import Information, Outlook, Prior, frame_rays, level_of
from rcdn.calibration.candidates import in_frame
from rcdn.calibration.motions import by_motion
from rcdn.calibration.uncertainty import pixel_jacobians
from rcdn.geometry import project, project_with_jacobian
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
        xy, rays = frame_rays(camera)
        _, by_camera, turn = pixel_jacobians(camera, rays, np.inf)
        shared = np.zeros((len(xy), 2, a + b + 6))
        if part == 0:
            shared[:, :, :a], motion = by_camera, turn
        else:
            shared[:, :, a : a + b], shared[:, :, a + b :] = by_camera, turn
            motion = np.concatenate([turn[:, :, :3] @ T[:3, :3], turn[:, :, 3:]], axis=2)
        every.append(Projections(xy, shared, motion, np.full(len(xy), part), np.full(len(xy), np.inf)))
    every += [_between(pair, far) for far in (distance, np.inf)]
    return Projections(
        *(np.concatenate([getattr(p, n) for p in every]) for n in ("xy", "by_shared", "by_motion", "part", "distance"))
    )


def _between(pair: PairCovariance, distance: float) -> Projections:
    """The projections from the left picture into the right one of points `distance` m away."""
    (left, right), (a, b) = pair.cameras, pair.counts
    R, t = pair.T[:3, :3], pair.T[:3, 3]
    xy, rays = frame_rays(left)
    there = rays @ R.T + t / distance  # in units of the distance, so that it may be infinite
    out = project(right, there)
    size = np.array(right.image_size) - 1
    inside = (there[:, 2] > 0) & (out >= 0).all(axis=1) & (out <= size).all(axis=1)
    xy, rays, there = xy[inside], rays[inside], there[inside]
    _, by_ray, by_left = project_with_jacobian(left, rays)
    ray_by_left = -np.linalg.pinv(by_ray) @ by_left  # the pixel is fixed: the lens moves the ray
    by_point, by_right, by_motion = pixel_jacobians(right, there, distance)
    shared = np.zeros((len(xy), 2, a + b + 6))
    shared[:, :, :a] = by_point @ R @ ray_by_left
    shared[:, :, a : a + b] = by_right
    shared[:, :, a + b :] = by_motion
    return Projections(xy, shared, np.zeros((len(xy), 2, 6)), np.full(len(xy), 2), np.full(len(xy), distance))


@dataclass(frozen=True, eq=False)
class PairForecast(Outlook):
    """Prediction of the uncertainties of the `projections` of a `pair` of cameras with one more pair of pictures."""

    pair: PairCovariance
    projections: Projections

    @classmethod
    def of(cls, pair: PairCovariance, distance: float) -> PairForecast:
        """For points infinitely far, and those `distance` m away."""
        projections = pair_projections(pair, distance)
        now = projections.deviations(pair.cov)
        prior = Prior.split(pair.cov, len(pair.cov) - 6, pair.views)
        before, level = float(now.max()), float(level_of(now[None] ** 2)[0])
        return cls(prior, projections.by_shared, projections.by_motion, before, level, pair, projections)

    def after(self, points: Real[Array, "c n 3"], seen: Real[Array, "c 2 n"]) -> tuple[Array, Array]:
        """(C,) px, the worst uncertainty, and (C,) px, the mean: with each of C pairs of pictures of `points`
        (C, N, 3), m, coordinates of the left camera; `seen` (C, 2, N): number of corners that each stands for in each
        picture, 0 where it is not visible."""
        return self.with_each(len(points), lambda part: self._information(points[part], seen[part]))

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
                shared[:, :, a + b :] = by_motion(by_point, here)
            weight = (self.pair.weight[c] * np.sqrt(seen[:, c])).reshape(-1, 1, 1)
            for rows, found in ((J, shared), (B, by_motion(in_left, flat))):
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
