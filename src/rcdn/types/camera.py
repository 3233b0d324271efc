"""Cameras and poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcdn.errors import RcdnError, shown
from rcdn.types.base import Array, freeze
from rcdn.types.correction import LensCorrection
from rcdn.types.ranges import whole_size

CameraModel = Literal["pinhole", "brown", "rational", "fisheye", "division"]

LENS = {
    "pinhole": (),
    "brown": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "division": ("lambda",),
}
"""names of the distortion's numbers, in OpenCV's order"""


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics of one camera.

    `K` (3, 3) px; `distortion`: empty for `pinhole`; OpenCV's k1 k2 p1 p2 [k3] for `brown`, with k4 k5 k6 of a
    denominator for `rational`; Kannala–Brandt k1..k4 for `fisheye` (OpenCV's fisheye); one number λ for `division`:
    undistorted = distorted ÷ (1 + λ·r²), r of the distorted point in focal lengths, so that λ < 0 is a barrel
    (Fitzgibbon 2001). `image_size` (width, height) px. Pixel centres at integers. `correction`: what the lens does beyond the model,
    added to the distorted point, in focal lengths; not for `division`.
    """

    K: Array
    distortion: Array
    image_size: tuple[int, int]
    model: CameraModel = "brown"
    correction: LensCorrection | None = None

    def __post_init__(self) -> None:
        freeze(self, "K", self.K, np.float64, (3,))
        freeze(self, "distortion", self.distortion, np.float64, ())
        if not isinstance(self.model, str) or self.model not in LENS:
            raise RcdnError(f"Camera.model must be one of {', '.join(LENS)}, not {shown(self.model)}")
        object.__setattr__(self, "image_size", whole_size(self.image_size, "Camera.image_size"))
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all():
            raise RcdnError(f"Camera.K must be a finite (3, 3) matrix, not {self.K.tolist()}")
        allowed = (4, 5) if self.model == "brown" else (len(LENS[self.model]),)
        if len(self.distortion) not in allowed:
            raise RcdnError(
                f"Camera.distortion of model {self.model!r} takes {allowed} numbers, not {len(self.distortion)}"
            )
        if self.correction is not None and self.model == "division":
            raise RcdnError("Camera.correction is not for model 'division'; use pinhole, brown, rational or fisheye")

    @property
    def parameters(self) -> Array:
        """(`coefficients` [+ 2·rows·columns],) fx, fy, cx, cy, px, the distortion, then the correction's control points, flat."""
        K = self.K
        core = np.concatenate([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]], self.distortion])
        return core if self.correction is None else np.concatenate([core, self.correction.control.ravel()])

    @property
    def coefficients(self) -> int:
        """Number of `parameters` before the correction's."""
        return 4 + len(self.distortion)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `parameters`."""
        core = ("fx", "fy", "cx", "cy", *LENS[self.model][: len(self.distortion)])
        return core if self.correction is None else core + self.correction.names

    def with_parameters(self, parameters: Array) -> Camera:
        """A camera of the same model, size, skew and grid of the correction whose `parameters` are these."""
        fx, fy, cx, cy = (float(v) for v in parameters[:4])
        K = np.array([[fx, self.K[0, 1], cx], [0, fy, cy], [0, 0, 1]])
        if self.correction is None:
            return Camera(K, np.asarray(parameters[4:], float), self.image_size, self.model)
        end = self.coefficients
        correction = self.correction.with_control(parameters[end:])
        return Camera(K, np.asarray(parameters[4:end], float), self.image_size, self.model, correction)


@dataclass(frozen=True, eq=False)
class Pose:
    """`T_cam_board` (4, 4): takes homogeneous board coordinates (in squares or metres) to camera coordinates."""

    T_cam_board: Array

    def __post_init__(self) -> None:
        freeze(self, "T_cam_board", self.T_cam_board, np.float64, (4,))
        if self.T_cam_board.shape != (4, 4):
            raise RcdnError(f"Pose.T_cam_board must have shape (4, 4), not {self.T_cam_board.shape}")

    @property
    def R(self) -> Array:
        """(3, 3) rotation."""
        return self.T_cam_board[:3, :3]

    @property
    def t(self) -> Array:
        """(3,) translation, in the board's unit."""
        return self.T_cam_board[:3, 3]


@dataclass(frozen=True, eq=False)
class PoseEstimate(Pose):
    """A pose with how far to trust it.

    `cov` (6, 6) of a small motion after the pose, (rotation vector, rad, in camera axes; translation, board's unit);
    `rms` reprojection error, px; `residuals` (M, 2) observed − projected, px, NaN where the camera can't see. `other`: the second
    pose that a flat board allows, or None; `ambiguous`: the picture doesn't tell which of the two is right.
    """

    cov: Array
    rms: float
    residuals: Array
    other: Pose | None = None
    ambiguous: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        freeze(self, "cov", self.cov, np.float64, (6,))
        freeze(self, "residuals", self.residuals, np.float64, (2,))

    @property
    def std(self) -> Array:
        """(6,) standard deviations: rotation, rad; translation, board's unit."""
        return np.sqrt(np.diag(self.cov))
