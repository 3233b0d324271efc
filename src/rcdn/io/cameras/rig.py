"""Two cameras and their relative pose, with the data that a camera file contains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.geometry.rectification import rectifying
from rcdn.provided import camera_work
from rcdn.types import Array, Camera, StereoCalibration
from rcdn.types.base import Value


@dataclass(frozen=True, eq=False)
class Rectification(Value):
    """The rectification of two cameras in OpenCV's notation: `R_left`, `R_right` (3, 3), `P_left`, `P_right` (3, 4),
    `Q` (4, 4)."""

    R_left: Array
    R_right: Array
    P_left: Array
    P_right: Array
    Q: Array

    def __post_init__(self) -> None:
        shapes = {"R_left": (3, 3), "R_right": (3, 3), "P_left": (3, 4), "P_right": (3, 4), "Q": (4, 4)}
        _freeze(self, shapes)

    def __repr__(self) -> str:
        return (
            f"<Rectification: f {self.P_left[0, 0]:.5g} px, centre ({self.P_left[0, 2]:.5g}, {self.P_left[1, 2]:.5g})>"
        )

    @classmethod
    def without_q(cls, R_left: Array, R_right: Array, P_left: Array, P_right: Array) -> Rectification:
        """A rectification from a format without Q (4, 4), which maps (x, y, disparity, 1) to a point in the rectified
        left camera; Q is computed from P."""
        f, shift = P_right[0, 0], P_right[:2, 3]
        along = int(abs(shift[1]) > abs(shift[0]))  # cameras above each other have a disparity along y
        baseline = shift[along] / f
        if not np.isfinite(baseline) or baseline == 0:
            raise RcdnError("Rectification.P_right must have a baseline in its fourth column")
        Q = np.array([
            [1, 0, 0, -P_left[0, 2]],
            [0, 1, 0, -P_left[1, 2]],
            [0, 0, 0, f],
            [0, 0, -1 / baseline, (P_left[along, 2] - P_right[along, 2]) / baseline],
        ])  # fmt: skip
        return cls(R_left, R_right, P_left, P_right, Q)


@dataclass(frozen=True, eq=False)
class StereoCameras(Value):
    """Two cameras. `T_right_left` (4, 4) transforms left camera coordinates to right ones, m; `rectification` is None
    if the file has none. Two cameras of a `Rig` are such a pair, too, with `rig.relative("left", "right")[0]`."""

    left: Camera
    right: Camera
    T_right_left: Array
    rectification: Rectification | None = None

    def __post_init__(self) -> None:
        _freeze(self, {"T_right_left": (4, 4)})

    def __repr__(self) -> str:
        lenses = (f"{c.model} {c.image_size[0]}×{c.image_size[1]} px" for c in (self.left, self.right))
        return f"<StereoCameras: {' and '.join(lenses)}, baseline {np.linalg.norm(self.T_right_left[:3, 3]):.5g} m>"

    @property
    def turns(self) -> Rectification:
        """Its `rectification`, or else the one that OpenCV's stereoRectify makes. Raises RcdnError for cameras at one
        place."""
        return self.rectification or Rectification(*rectifying(self.left, self.right, self.T_right_left))

    def rectify(self, left: Any, right: Any) -> tuple[Array, Array]:
        """As `StereoCalibration.rectify`, by its `turns`."""
        pictures: tuple[Array, Array] = camera_work().rectify(self, left, right)
        return pictures

    @classmethod
    def of(cls, found: StereoCalibration | StereoCameras) -> StereoCameras:
        """The cameras of a calibration."""
        if isinstance(found, StereoCameras):
            return found
        turns = Rectification(found.R_left, found.R_right, found.P_left, found.P_right, found.Q)
        return cls(found.left.camera, found.right.camera, found.T_right_left, turns)


def _freeze(owner: object, shapes: Mapping[str, tuple[int, ...]]) -> None:
    for name, shape in shapes.items():
        array = np.array(getattr(owner, name), float)
        if array.shape != shape or not np.isfinite(array).all():
            raise RcdnError(f"{type(owner).__name__}.{name} must be finite, of shape {shape}, not {array.shape}")
        array.setflags(write=False)
        object.__setattr__(owner, name, array)
