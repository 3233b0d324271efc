"""Weak peaks of a response map, which are refined only where a growing board needs them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.config import Refine
from rcdn.corners.orientation import Orientation, axes
from rcdn.corners.refine import refine
from rcdn.geometry.near import nearest
from rcdn.types import Array
from rcdn.types.arrays import Bool, Real, Shaped

DEFAULT_PITCH = 20.0
"""pitch of the only corner in its picture, px"""
RING_SHARE, RING = 0.35, (3.0, 16.0)
"""radius of the rings on which edge directions are measured, share of the pitch, and its limits, px; blurred corners
need large rings"""
INNER = 0.12
"""radius of the rings beside large markers, share of the pitch: on the diagonal, markers of .85 squares begin at .11"""
SHOWN = 0.5
"""least fit with which rings show an X-corner"""
SAME = 3.0
"""px; refined corners closer than this are one corner (the network does not resolve squares under 5 px)"""


@dataclass(frozen=True, eq=False)
class Peaks:
    """Peaks `xy` (M, 2) px, integers, with responses `score` (M,), too weak to be corners by themselves.

    `strong` (S, 2): the other, strong peaks of the picture; `grey`, `response` (H, W); `rule`: the method of
    refinement.
    """

    xy: Array
    score: Array
    strong: Array
    grey: Array
    response: Array
    rule: Refine

    def evaluate(self, index: Array) -> tuple[Array, Array, Orientation]:
        """Refined positions (K, 2), their status (K,), and the edge directions of the peaks at `index` (K,)."""
        xy = self.xy[index]
        pitch = nearest_other(self.strong, xy)
        careful = np.zeros(len(xy), bool)
        fine, status = refine(self.grey, self.response, xy, self.rule, pitch, careful)
        return fine, status, axes_of(self.grey, fine, pitch, careful)


def axes_of(
    grey: Array, xy: Real[Array, "n 2"], pitch: Real[Array, " n"], careful: Bool[Array, " n"] | None = None
) -> Orientation:
    """`axes` of corners at `xy` (N, 2) px whose nearest neighbour is `pitch` (N,) px away: on smaller rings where only
    these show an X-corner, as beside the large markers of ChArUco boards."""
    seen = axes(grey, xy, ring(pitch), careful)
    poor = np.flatnonzero((seen.fit < SHOWN) & (INNER * pitch >= RING[0]))
    if not len(poor):
        return seen
    inner = axes(grey, xy[poor], INNER * pitch[poor], None if careful is None else careful[poor])
    better = inner.fit >= SHOWN
    poor = poor[better]
    for name in ("axes", "contrast", "polarity", "fit"):
        getattr(seen, name)[poor] = getattr(inner, name)[better]
    return seen


def ring(pitch: Real[Array, " n"]) -> Real[Array, " n"]:
    """Radius (N,) px of the rings around corners whose nearest neighbour is `pitch` (N,) px away."""
    return np.asarray(np.clip(RING_SHARE * pitch, *RING))


def nearest_other(points: Shaped[Array, "m 2"], xy: Real[Array, "n 2"]) -> Real[Array, " n"]:
    """Distance (N,) px from each of `xy` (N, 2) to the nearest of `points` (M, 2) that is another corner."""
    if len(points) < 2 or not len(xy):
        return np.full(len(xy), DEFAULT_PITCH)
    distance = nearest(points, xy, 4)[0]
    distance = np.where(distance > SAME, distance, np.inf).min(axis=1)
    return np.where(np.isfinite(distance), distance, DEFAULT_PITCH)
