"""Poses of boards and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze
from rcdn.types.named import Named
from rcdn.types.ranges import CHAINED, is_rigid


@dataclass(frozen=True, eq=False)
class Pose(Value):
    """`T_cam_board` (4, 4): takes homogeneous board coordinates (in squares or metres) to camera coordinates. Raises
    RcdnError unless it is a finite rotation and translation, to 10⁻³."""

    T_cam_board: Array

    def __post_init__(self) -> None:
        freeze(self, "T_cam_board", self.T_cam_board, np.float64, (4,))
        if self.T_cam_board.shape != (4, 4):
            raise RcdnError(f"Pose.T_cam_board must have shape (4, 4), not {self.T_cam_board.shape}")
        if not is_rigid(self.T_cam_board, CHAINED):
            raise RcdnError(
                f"Pose.T_cam_board must be a finite rotation and translation, [[R, t], [0, 0, 0, 1]], R neither scaled "
                f"nor mirrored, not {self.T_cam_board.tolist()}"
            )

    def __repr__(self) -> str:
        return f"<Pose: {self._place}>"

    @property
    def _place(self) -> str:
        x, y, z = self.t
        cosine = np.clip(0.5 * (np.trace(self.R) - 1), -1, 1)
        return f"t ({x:.5g}, {y:.5g}, {z:.5g}), turned by {np.degrees(np.arccos(cosine)):.1f}°"

    @property
    def R(self) -> Real[Array, "3 3"]:
        """(3, 3) rotation."""
        return self.T_cam_board[:3, :3]

    @property
    def t(self) -> Real[Array, " 3"]:
        """(3,) translation, in the board's unit."""
        return self.T_cam_board[:3, 3]


@dataclass(frozen=True, eq=False)
class PoseEstimate(Pose):
    """A pose with its uncertainty.

    `cov` (6, 6): covariance of a small motion applied after the pose (rotation vector, rad, in camera axes;
    translation, board's unit); `rms` reprojection error, px; `residuals` (M, 2) observed − projected, px, NaN where the
    camera can't see the point. `other`: the second solution for the pose of a planar board, or None; `ambiguous`: the
    picture doesn't determine which of the two is right. `T_cam_target` (4, 4): for a board whose codes were read, the
    same pose in the coordinates of its target's own tools (docs/conventions.md); None for a plain board.
    """

    cov: Array
    rms: float
    residuals: Array
    other: Pose | None = None
    ambiguous: bool = False
    T_cam_target: Array | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.T_cam_target is not None:
            freeze(self, "T_cam_target", self.T_cam_target, np.float64, (4,))
        freeze(self, "cov", self.cov, np.float64, (6,))
        freeze(self, "residuals", self.residuals, np.float64, (2,))

    def __repr__(self) -> str:
        doubt = ", ambiguous" if self.ambiguous else ""
        return f"<Pose: {self._place}, rms {self.rms:.3g} px{doubt}>"

    @property
    def std(self) -> Named:
        """(6,) standard deviations: of a small rotation about the camera's axes, rad; of `t`, board's unit. Also by
        name: `rx ry rz tx ty tz`."""
        return Named(pose_std(self.T_cam_board, self.cov), ("rx", "ry", "rz", "tx", "ty", "tz"))


def pose_std(T: Array, cov: Array) -> Real[Array, " 6"]:
    """(6,) standard deviations of the pose `T` (4, 4), given the covariance `cov` (6, 6) of a small motion applied
    after it: of the motion's rotation vector, and of T's translation, which that rotation moves, too."""
    return np.sqrt(np.concatenate([np.diag(cov)[:3], np.diag(translation_covariance(T, cov))]))


def translation_covariance(T: Array, cov: Array) -> Real[Array, "3 3"]:
    """(3, 3) covariance of the translation t of the pose `T` (4, 4), given `cov` (6, 6) of a small motion (δr, δt)
    applied after it: t changes by δr × t + δt."""
    x, y, z = T[:3, 3]
    J = np.array([[0, z, -y, 1, 0, 0], [-z, 0, x, 0, 1, 0], [y, -x, 0, 0, 0, 1]], float)
    return np.asarray(J @ cov @ J.T)
