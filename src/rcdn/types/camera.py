"""Cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from rcdn.errors import RcdnError, shown
from rcdn.provided import camera_work
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze, row_of
from rcdn.types.correction import LensCorrection
from rcdn.types.pose import Pose
from rcdn.types.ranges import coefficient_trouble, focal_trouble, two_integers, whole_size
from rcdn.types.shown import deviations, paragraph

CameraModel = Literal["pinhole", "brown", "rational", "fisheye", "division"]

LENS = {
    "pinhole": (),
    "brown": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "division": ("lambda",),
}
"""names of the distortion coefficients, in OpenCV's order"""
_WITH_PRISM = (12, 14)
"""numbers of OpenCV's coefficients if those of thin prisms, and of tilted sensors, follow the eight of `rational`"""


def model_of(count: int) -> CameraModel:
    """The lens model of `count` coefficients in OpenCV's order."""
    return "brown" if count < len(LENS["rational"]) else "rational"


def prism_trouble(distortion: Array) -> str:
    """The reason why the coefficients `distortion` (N,) in OpenCV's order are those of no model here; "" if those of
    thin prisms and tilted sensors are 0, or there are none."""
    if not distortion[len(LENS["rational"]) :].any():
        return ""
    return "thin prisms and tilted sensors (s1…s4, τ) are unknown to rcdn; calibrate without them"


@dataclass(frozen=True, eq=False)
class Camera(Value):
    """Intrinsics of one camera.

    `K` (3, 3) px; `distortion` (N,), or as OpenCV has it (1, N), (N, 1), or None for zeros: empty for `pinhole`;
    OpenCV's k1 k2 p1 p2 [k3] for `brown`, with k4 k5 k6 of a denominator for `rational` (of 12 or 14 numbers those of
    thin prisms and tilted sensors, which follow, must be 0); Kannala–Brandt k1..k4 for `fisheye` (OpenCV's); one number
    λ for `division`: undistorted = distorted ÷ (1 + λ·r²), r of the distorted point in focal lengths, so that λ < 0 is
    a barrel distortion (Fitzgibbon 2001). `image_size` (width, height) px. Pixel centres at integers. `correction`:
    deviation of the lens from the parametric model, added to the distorted point, in focal lengths; not for `division`.
    Default of `model`: `rational` for eight coefficients or more, else `brown`.
    """

    K: Array
    distortion: Array
    image_size: tuple[int, int]
    model: CameraModel = None  # type: ignore[assignment]  # until the coefficients are counted
    correction: LensCorrection | None = None

    if TYPE_CHECKING:  # what the dataclass's own constructor takes is more than what the fields are then

        def __init__(
            self,
            K: ArrayLike,
            distortion: ArrayLike | None,
            image_size: Sequence[int],
            model: CameraModel | None = None,
            correction: LensCorrection | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        self._settle()
        if trouble := focal_trouble(self.K):
            raise RcdnError(f"Camera.K: {trouble}")
        if trouble := coefficient_trouble(self.distortion):
            raise RcdnError(f"Camera.distortion: {trouble}")

    def _settle(self) -> None:
        """Freeze the arrays, and raise RcdnError for what can be no camera, except for the ranges of its focal lengths
        and coefficients."""
        freeze(self, "K", self.K, np.float64, (3,))
        if self.model is not None and (not isinstance(self.model, str) or self.model not in LENS):
            raise RcdnError(f"Camera.model must be one of {', '.join(LENS)}, not {shown(self.model)}")
        none = np.zeros(len(LENS[self.model or "brown"]))
        freeze(self, "distortion", none if self.distortion is None else _in_a_row(self.distortion), np.float64, ())
        if len(self.distortion) in _WITH_PRISM and self.model in (None, "rational"):
            if trouble := prism_trouble(self.distortion):
                raise RcdnError(f"Camera.distortion: {trouble}")
            freeze(self, "distortion", self.distortion[: len(LENS["rational"])], np.float64, ())
        object.__setattr__(self, "model", self.model or model_of(len(self.distortion)))
        object.__setattr__(self, "image_size", whole_size(self.image_size, "Camera.image_size"))
        if self.K.shape != (3, 3) or not np.isfinite(self.K).all():
            raise RcdnError(f"Camera.K must be a finite (3, 3) matrix, not {self.K.tolist()}")
        if self.K[[1, 2, 2], [0, 0, 1]].any() or self.K[2, 2] != 1:
            raise RcdnError(f"Camera.K must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], px, not {self.K.tolist()}")
        allowed = (4, 5) if self.model == "brown" else (len(LENS[self.model]),)
        if len(self.distortion) not in allowed:
            fits = [name for name, names in LENS.items() if len(names) == len(self.distortion)]
            fits += ["rational"] * (len(self.distortion) in _WITH_PRISM)
            other = f"; model {fits[0]!r} takes {len(self.distortion)}" if fits else ""
            counts = " or ".join(map(str, allowed))
            raise RcdnError(
                f"Camera.distortion of model {self.model!r} takes {counts} numbers, not {len(self.distortion)}{other}"
            )
        if not isinstance(self.correction, LensCorrection | None):
            raise RcdnError(f"Camera.correction must be a LensCorrection or None, not {shown(self.correction)}")
        if self.correction is not None and self.model == "division":
            raise RcdnError("Camera.correction is not for model 'division'; use pinhole, brown, rational or fisheye")

    def __repr__(self) -> str:
        few = zip(self.parameter_names[: self.coefficients], self.parameters.tolist(), strict=False)
        more = "" if self.correction is None else ", and a smooth correction"
        return f"<Camera {self._kind}: {', '.join(f'{name} {value:.5g}' for name, value in few)}{more}>"

    def _repr_html_(self) -> str:
        many = self.coefficients
        return paragraph(f"Camera, {self._kind}") + deviations(self.parameter_names[:many], self.parameters[:many])

    @property
    def _kind(self) -> str:
        return f"{self.model} {self.image_size[0]}×{self.image_size[1]} px"

    @property
    def parameters(self) -> Array:
        """(`coefficients` [+ 2·rows·columns],) fx, fy, cx, cy, px, the distortion, then the correction's control
        points, flat."""
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

    def project(self, points: ArrayLike, pose: Pose | None = None) -> Real[Array, "... 2"]:
        """Pixels (..., 2) of points (..., 3) in camera coordinates, or in those of a board at `pose`; NaN for points
        that the camera can't see: behind it, and beyond the angle at which its distortion folds back. Points outside
        of the picture have pixels.

        Raises RcdnError for points of another shape, or another `pose`.
        """
        if pose is not None and not isinstance(pose, Pose):
            raise RcdnError(f"pose must be a Pose, not {type(pose).__name__}; make one of T_cam_board (4, 4): Pose(T)")
        return _work().project(self, _rows_of(points, 3, "points"), pose)

    def unproject(self, xy: ArrayLike) -> Real[Array, "... 3"]:
        """Viewing rays (..., 3) of pixels (..., 2), in camera coordinates, of unit z (`fisheye` and `division`: unit
        length); NaN where the lens model can't be inverted. Raises RcdnError for pixels of another shape."""
        return _work().unproject(self, _rows_of(xy, 2, "xy"))

    def undistorted(self, balance: float = 0.0) -> Camera:
        """The pinhole camera, of the same size, of the pictures that `undistort` returns. `balance` 0: it has no empty
        pixels; 1: it shows all that this camera saw; both up to 55° from its optical axis. Raises RcdnError for a
        `balance` outside of 0..1."""
        return _work().undistorted(self, balance)

    def undistort(self, image: Any, balance: float = 0.0) -> Array:
        """`image`, an array (H, W) or (H, W, channels) of 8 or 16 bits or floats or a PIL image, resampled to the
        camera `undistorted(balance)`; pixels that this camera didn't see are 0. Its maps are kept for the next
        picture, and those of the cameras and balances before it, up to 256 MB in all.

        Raises ImageError for anything that isn't such a picture, RcdnError for a size other than the camera's
        `image_size`.
        """
        return _work().undistort(self, image, balance)

    def undistortion_maps(self, balance: float = 0.0) -> tuple[Array, Array]:
        """Source position of each pixel of `undistorted(balance)`: map_x, map_y (H, W) float32, px, as `cv2.remap`
        takes them."""
        return _work().undistortion_maps(self, balance)

    def resized(self, size: Sequence[int]) -> Camera:
        """The camera of the same picture resized to `size` (width, height) px, as by `cv2.resize` or by a sensor that
        bins its pixels: the picture's borders stay where they are, not the centre of its first pixel. Raises RcdnError
        for another `size`."""
        size = whole_size(size, "size")
        sx, sy = size[0] / self.image_size[0], size[1] / self.image_size[1]
        K = np.array([[sx, 0, 0.5 * sx - 0.5], [0, sy, 0.5 * sy - 0.5], [0, 0, 1]]) @ self.K
        return replace(self, K=K, image_size=size)

    def cropped(self, x: int, y: int, width: int, height: int) -> Camera:
        """The camera of the part of its picture, such as a sensor's region of interest, whose first pixel is (x, y) and
        which has `width` × `height` px. Raises RcdnError for a part that isn't within the picture."""
        corner, size = two_integers((x, y)), whole_size((width, height), "width and height")
        if corner is None or min(corner) < 0 or np.any(np.add(corner, size) > self.image_size):
            raise RcdnError(
                f"the part must lie within the picture of {self.image_size[0]}×{self.image_size[1]} px, whole numbers "
                f"x, y, width, height, not {shown((x, y, width, height))}"
            )
        K = self.K.copy()
        K[:2, 2] -= corner
        return replace(self, K=K, image_size=size)

    def save(self, path: str | Path, format: str | None = None) -> str | None:
        """Write a file for other programs in the `format` `opencv`, `ros`, `kalibr`, `colmap`, `mrcal` or `json`; by
        default the format follows from the ending of the name (docs/formats.md).

        Returns a note of what the file represents only approximately, for a camera with a `correction`, else None.
        Raises FormatError for a name that doesn't determine a format, and if the format can't represent the lens;
        OutputError if the file can't be written.
        """
        return _work().save(self, path, format) or None

    @staticmethod
    def load(path: str | Path, name: str | None = None, format: str | None = None) -> Camera:
        """Read a camera from a file in any format of `save`, recognised by its content, or from a calibration saved as
        JSON.

        `name`: the camera's name in a file with several. Raises FormatError, which names the file, the field and the
        fix.
        """
        return _work().load(path, name, format)

    def with_parameters(self, parameters: ArrayLike) -> Camera:
        """A camera with these `parameters`, and the same model, size, skew and grid of the correction. Its focal
        lengths and coefficients may be out of range, as on the way of a solver. Raises RcdnError as Camera does for all
        else."""
        parameters = row_of(parameters, "parameters")
        if len(parameters) < 4:
            raise RcdnError(f"parameters must hold {len(self.parameters)} numbers, not {len(parameters)}")
        fx, fy, cx, cy = (float(v) for v in parameters[:4])
        end = len(parameters) if self.correction is None else self.coefficients
        new: dict[str, Any] = {
            "K": np.array([[fx, self.K[0, 1], cx], [0, fy, cy], [0, 0, 1]]),
            "distortion": np.array(parameters[4:end], float),
            "image_size": self.image_size,
            "model": self.model,
            "correction": None if self.correction is None else self.correction.with_control(parameters[end:]),
        }
        out = object.__new__(Camera)
        for name, value in new.items():
            object.__setattr__(out, name, value)
        if len(out.distortion) == len(self.distortion) and np.isfinite(out.K).all():
            out.K.setflags(write=False)
            out.distortion.setflags(write=False)
        else:
            out._settle()
        return out


class CameraWork(Protocol):
    """Interface of the implementation of the methods of `Camera`, which lives in higher packages."""

    def project(self, camera: Camera, points: Array, pose: Pose | None) -> Array: ...
    def unproject(self, camera: Camera, xy: Array) -> Array: ...
    def undistorted(self, camera: Camera, balance: float) -> Camera: ...
    def undistort(self, camera: Camera, image: Any, balance: float) -> Array: ...
    def undistortion_maps(self, camera: Camera, balance: float) -> tuple[Array, Array]: ...
    def save(self, camera: Camera, path: str | Path, format: str | None) -> str: ...
    def load(self, path: str | Path, name: str | None, format: str | None) -> Camera: ...


def _work() -> CameraWork:
    work: CameraWork = camera_work()
    return work


def _in_a_row(distortion: Any) -> Any:
    """OpenCV's one row (1, N) or one column (N, 1) of coefficients as (N,); anything else as it is."""
    if isinstance(distortion, np.ndarray) and distortion.ndim == 2 and 1 in distortion.shape:
        return distortion.ravel()
    return distortion


def _rows_of(value: ArrayLike, length: int, called: str) -> Array:
    """`value` as an array (..., length) of floats."""
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError) as error:
        raise RcdnError(f"{called} must hold numbers in rows of equal length: {error}") from error
    if array.shape[-1:] != (length,):
        raise RcdnError(f"{called} must have shape (..., {length}), not {array.shape}")
    return array
