"""Rigidly connected cameras: their poses and the uncertainty of these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rcdn.errors import RcdnError, many
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze
from rcdn.types.camera import Camera
from rcdn.types.pose import Pose, pose_std
from rcdn.types.shown import table


@dataclass(frozen=True, eq=False)
class Rig(Value):
    """`names` of the n cameras, `cameras` and `poses`: those of the rig's frame, which is that of the first camera, in
    each camera's frame; `T_cam_rig` has them as matrices, m.

    `covariance` (6n, 6n) of small motions applied after the poses (left increments: rotation vector, rad, then
    translation, m, in each camera's axes); zero rows for the first camera; None if unknown. Raises RcdnError if the
    numbers of entries differ.
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]
    poses: tuple[Pose, ...]
    covariance: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        if not n or len(set(self.names)) != n or len(self.cameras) != n or len(self.poses) != n:
            raise RcdnError("Rig.names must be different, and cameras and poses must have one entry a name")
        if not all(isinstance(pose, Pose) for pose in self.poses):
            raise RcdnError("Rig.poses must be Poses; make them of T_cam_rig (n, 4, 4): tuple(map(Pose, T))")
        if self.covariance is not None:
            freeze(self, "covariance", self.covariance, np.float64, (6 * n,))
            if self.covariance.shape != (6 * n, 6 * n):
                raise RcdnError(f"Rig.covariance must have shape ({6 * n}, {6 * n}), not {self.covariance.shape}")

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"<Rig: {many(len(self), 'camera')}, {', '.join(self.names)}>"

    def _repr_html_(self) -> str:
        return table(("camera", "lens", "px", "centre, m"), self._rows())

    def _rows(self) -> list[tuple[str, ...]]:
        """Of each camera its name, lens, size, and the place of its centre in the rig's frame, as texts."""
        rows: list[tuple[str, ...]] = []
        for name, camera, pose in zip(self.names, self.cameras, self.poses, strict=True):
            centre = ", ".join(f"{value:.5g}" for value in (-pose.R.T @ pose.t + 0.0).tolist())
            rows.append((name, camera.model, f"{camera.image_size[0]}×{camera.image_size[1]}", centre))
        return rows

    @property
    def T_cam_rig(self) -> Real[Array, "n 4 4"]:
        """(n, 4, 4) of the cameras, in the order of their names, read-only."""
        T = np.stack([pose.T_cam_board for pose in self.poses])
        T.setflags(write=False)
        return T

    def index(self, name: str) -> int:
        """The index of the camera called `name`. Raises RcdnError if there is none."""
        if name not in self.names:
            raise RcdnError(f"the rig has no camera {name!r}; it has {', '.join(self.names)}")
        return self.names.index(name)

    def relative(self, a: str, b: str) -> tuple[Array, Array | None]:
        """T_b_a (4, 4), which takes the frame of camera `a` to that of camera `b`, and the covariance (6, 6) of its
        left increment, None if unknown."""
        k, m = self.index(a), self.index(b)
        T = self.T_cam_rig[m] @ np.linalg.inv(self.T_cam_rig[k])
        if self.covariance is None:
            return T, None
        J = np.zeros((6, 6 * len(self)))
        J[:, 6 * m : 6 * m + 6] += np.eye(6)
        J[:, 6 * k : 6 * k + 6] -= _adjoint(T)
        return T, np.asarray(J @ self.covariance @ J.T)

    def centre(self, name: str) -> Array:
        """(3,) m: where the camera called `name` stands in the rig's frame."""
        pose = self.poses[self.index(name)]
        return np.asarray(-pose.R.T @ pose.t)

    def centre_covariance(self, name: str) -> Array | None:
        """(3, 3) m²: of `centre`; None if it isn't known."""
        k = self.index(name)
        if self.covariance is None:
            return None
        J = np.hstack(
            [np.zeros((3, 3)), -self.poses[k].R.T]
        )  # a left turn moves t and R together: the centre keeps its place
        return np.asarray(J @ self.covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] @ J.T)

    def motion_to(self, k: int) -> Array:
        """(6, 6) takes a small motion in the rig's frame to the same one in that of camera number `k`."""
        return _adjoint(self.T_cam_rig[k])


@dataclass(frozen=True, eq=False)
class RigPoseEstimate(Value):
    """The pose of a board in a rig's frame, `T_rig_board` (4, 4), with its uncertainty.

    `cov` (6, 6): covariance of a small motion applied after it (rotation vector, rad, in the rig's axes; translation,
    m); `rms` reprojection error over the cameras that were used, px; `residuals` by those cameras' names, (M, 2)
    observed − projected, px; `left_out`: by name, why other cameras that saw a board were not used. `T_rig_target` (4,
    4): for a board whose codes were read, the same pose in the coordinates of its target's own tools; None for a plain
    board.
    """

    T_rig_board: Array
    cov: Array
    rms: float
    residuals: Mapping[str, Array]
    left_out: Mapping[str, str]
    T_rig_target: Array | None = None

    def __post_init__(self) -> None:
        freeze(self, "T_rig_board", self.T_rig_board, np.float64, (4,))
        freeze(self, "cov", self.cov, np.float64, (6,))
        if self.T_rig_target is not None:
            freeze(self, "T_rig_target", self.T_rig_target, np.float64, (4,))

    @property
    def std(self) -> Real[Array, " 6"]:
        """(6,) standard deviations: of a small rotation about the rig's axes, rad; of the translation of T_rig_board,
        m."""
        return pose_std(self.T_rig_board, self.cov)

    def __repr__(self) -> str:
        x, y, z = self.T_rig_board[:3, 3]
        return f"<RigPose: ({x:.4g}, {y:.4g}, {z:.4g}), {', '.join(self.residuals)}, rms {self.rms:.3g} px>"


def _adjoint(T: Array) -> Real[Array, "6 6"]:
    """Adjoint (6, 6) of T: takes a small motion (rotation vector, translation) before T to the same one after it."""
    R, (x, y, z) = T[:3, :3], T[:3, 3]
    out = np.zeros((6, 6))
    out[:3, :3] = out[3:, 3:] = R
    out[3:, :3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ R
    return out
