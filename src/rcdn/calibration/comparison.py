"""Comparison of two cameras: the area of comparison, the difference there, and its significance against both
covariances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from rcdn.calibration.difference import (
    Agreement,
    Difference,
    agreement,
    camera_difference,
    common_grid,
    displacement,
)
from rcdn.errors import ConfigError, RcdnError
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Bool, Real

Where = Literal["seen", "frame"]
FEWEST = 20
"""least number of grid points in the area over which two cameras are compared"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two cameras compared: `found`, the difference over the whole frame, after the rotation fitted `where`; `inside`
    (N,) its points there.

    `where`: `seen`, inside the convex hulls of the used corners of every calibration, or `frame`, wherever both cameras
    have rays. `outlines`: those hulls, (K, 2) px each. `ends` (2, 2, 2) the difference vectors in the frame's corners
    (rows, columns) and `middle` (2,) at its centre, px, NaN without a ray. `agreement`: the difference relative to both
    covariances, if both are calibrations with covariances and not both lenses were given; `shared`: number of views
    with the same corners used by both, which makes their difference smaller than the covariances predict.
    """

    cameras: tuple[Camera, Camera]
    found: Difference
    where: Where
    inside: Array
    outlines: tuple[Array, ...]
    ends: Array
    middle: Array
    agreement: Agreement | None = None
    shared: int = 0

    def __repr__(self) -> str:
        area = "that the boards cover" if self.where == "seen" else "that both see"
        stated = "" if self.agreement is None else f", {self.agreement.rms:.3g} times what both state"
        return f"<Comparison: rms {self.over_area.rms:.3g} px over the area {area}{stated}>"

    @property
    def over_area(self) -> Difference:
        """The difference at the points inside the area."""
        return Difference(self.found.rotation, self.found.vectors[self.inside], self.found.points[self.inside])


def compare(a: Camera | Calibration, b: Camera | Calibration, where: Where | None = None) -> Comparison:
    """Compare two cameras of one frame size over a regular grid.

    `where`: `seen` needs a calibration with used corners, `frame` does not; default: `seen` where possible. Raises
    RcdnError for anything else than cameras, if the frames differ in size, if there is no area to compare, or if `seen`
    is requested for two cameras without corners.
    """
    one, other = (c.camera if isinstance(c, Calibration) else c for c in (a, b))
    for camera, name in ((one, "a"), (other, "b")):
        if not isinstance(camera, Camera):
            raise ConfigError(f"{name} must be a Camera or a Calibration, not {type(camera).__name__}")
    outlines = tuple(h for c in (a, b) if isinstance(c, Calibration) and len(h := _hull(c)))
    if where == "seen" and not outlines:
        raise RcdnError(
            "the area 'seen' needs the corners of a calibration (written by `rcdn calibrate --json`); choose 'frame'"
        )
    place: Where = where or ("seen" if outlines else "frame")
    points = common_grid(one, other) if tuple(one.image_size) == tuple(other.image_size) else np.zeros((1, 2))
    inside = np.ones(len(points), bool)
    if place == "seen":
        for hull in outlines:
            inside &= _within(hull, points)
    if tuple(one.image_size) == tuple(other.image_size) and inside.sum() < FEWEST:
        raise RcdnError(
            f"the cameras have only {int(inside.sum())} of {len(points)} points in common to compare; choose the area "
            "'frame'"
        )
    found = camera_difference(one, other, points, points[inside])
    inside = inside & np.isfinite(found.vectors).all(axis=1)
    stated = _agreement(a, b, found, inside)
    width, height = one.image_size
    x, y = np.meshgrid([0.0, width - 1], [0.0, height - 1])
    spots = np.stack([*np.stack([x, y], axis=-1).reshape(4, 2), [(width - 1) / 2, (height - 1) / 2]])
    there = displacement(one, other, found.rotation, spots)
    return Comparison(
        (one, other), found, place, inside, outlines, there[:4].reshape(2, 2, 2), there[4], stated, _shared(a, b)
    )


def _agreement(a: Camera | Calibration, b: Camera | Calibration, found: Difference, inside: Array) -> Agreement | None:
    """The difference relative to both covariances; None where they state none, as of two lenses that were given."""
    if not (
        isinstance(a, Calibration) and isinstance(b, Calibration) and np.isfinite([a.cov.sum(), b.cov.sum()]).all()
    ):
        return None
    try:
        return agreement(a, b, found, inside)
    except np.linalg.LinAlgError:  # the sum of both is singular
        return None


def _hull(calibration: Calibration) -> Real[Array, "k 2"]:
    """(K, 2) px, the convex hull of the used corners; empty if there are too few."""
    xy = np.concatenate([v.xy[v.used] for v in calibration.used_views] or [np.zeros((0, 2))])
    return cv2.convexHull(xy.astype(np.float32))[:, 0].astype(float) if len(xy) > 2 else np.zeros((0, 2))


def _within(hull: Real[Array, "k 2"], points: Real[Array, "n 2"]) -> Bool[Array, " n"]:
    """(N,) bool: `points` (N, 2) in the convex polygon `hull` (K, 2) or on its boundary."""
    edges = np.roll(hull, -1, axis=0) - hull
    away = points[:, None] - hull
    side = edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0]
    return np.asarray((side >= 0).all(axis=1) | (side <= 0).all(axis=1))


def _shared(a: Camera | Calibration, b: Camera | Calibration) -> int:
    """Number of used views of both that have the same corners."""
    if not (isinstance(a, Calibration) and isinstance(b, Calibration)):
        return 0
    known = {v.xy.tobytes() for v in a.used_views}
    return sum(v.xy.tobytes() in known for v in b.used_views)
