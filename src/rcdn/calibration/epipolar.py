"""Distances of matching corners of two cameras from their epipolar planes."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from rcdn.calibration.bundle import Corners3
from rcdn.geometry import cross_matrix, unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, BoardView, Camera

Matches = Mapping[tuple[int, int], tuple[Array, Array]]
"""for two cameras of the joint problem, the rows of the corners that both saw at the same moment: of the first, of the
second"""


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


def matches(corners: Corners3, ij: Array, used: Array) -> Matches:
    """The used corners with the same label on the same board that two cameras saw at the same moment."""
    part = np.zeros(len(corners), int) if corners.part is None else corners.part
    place = np.unique(np.column_stack([corners.frame, part, ij]), axis=0, return_inverse=True)[1].ravel()
    cameras = np.unique(corners.camera).tolist()
    row = np.full((len(cameras), int(place.max(initial=-1)) + 1), -1)
    for k, c in enumerate(cameras):
        mine = np.flatnonzero((corners.camera == c) & used)
        row[k, place[mine]] = mine
    found = {}
    for (k, a), (m, b) in combinations(enumerate(cameras), 2):
        both = (row[k] >= 0) & (row[m] >= 0)
        if both.any():
            found[a, b] = row[k, both], row[m, both]
    return found


def both_used(a: BoardView, b: BoardView) -> tuple[Array, Array]:
    """Rows of the used corners with the same label in both views."""
    places = {tuple(ij): k for k, ij in enumerate(b.ij.tolist()) if b.used[k]}
    both = [(k, places[tuple(ij)]) for k, ij in enumerate(a.ij.tolist()) if a.used[k] and tuple(ij) in places]
    rows = np.array(both, int).reshape(-1, 2)
    return rows[:, 0], rows[:, 1]
