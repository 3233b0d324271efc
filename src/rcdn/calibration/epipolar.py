"""Distances of matching corners of two cameras from their epipolar planes."""

from __future__ import annotations

import numpy as np

from rcdn.geometry import cross_matrix, unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, BoardView, Camera


def epipolar_gaps(first: Camera, second: Camera, T: Array, xy: Array, other: Array) -> Array:
    """(2 N,) signed distances of corners from their epipolar planes, angle × focal length, px: in the second image,
    then in the first.

    `T` (4, 4) takes the first camera's coordinates to the second's; `xy`, `other` (N, 2) px are the same corners in
    both. NaN where a lens has no ray. Distances from planes, not lines, are valid for any lens; they do not depend on
    boards or their shapes.
    """
    E = cross_matrix(T[:3, 3] / np.linalg.norm(T[:3, 3])) @ T[:3, :3]
    x, y = (unit(unproject(camera, pixels)) for camera, pixels in ((first, xy), (second, other)))
    sides = ((y, x @ E.T, second), (x, y @ E, first))
    angles = [((ray * n).sum(axis=1) / np.linalg.norm(n, axis=1), camera.K[0, 0]) for ray, n, camera in sides]
    return np.concatenate([angle * focal for angle, focal in angles])


def both_used(a: BoardView, b: BoardView) -> tuple[Array, Array]:
    """Rows of the used corners with the same label in both views."""
    places = {tuple(ij): k for k, ij in enumerate(b.ij.tolist()) if b.used[k]}
    both = [(k, places[tuple(ij)]) for k, ij in enumerate(a.ij.tolist()) if a.used[k] and tuple(ij) in places]
    rows = np.array(both, int).reshape(-1, 2)
    return rows[:, 0], rows[:, 1]
