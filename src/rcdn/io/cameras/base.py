"""Common parts of the camera formats: the description of a format, and checks that all of them need."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.errors import FormatError
from rcdn.geometry import lens_trouble
from rcdn.geometry.fit_lens import nearest_camera
from rcdn.io.cameras.rig import StereoCameras
from rcdn.io.fields import located, take
from rcdn.types import Array, Camera, CameraModel
from rcdn.types.arrays import Real
from rcdn.types.camera import model_of, prism_trouble
from rcdn.types.ranges import coefficient_trouble, whole_size


@dataclass(frozen=True, eq=False)
class LensFit:
    """The approximation of a camera with a `correction` in a format that can't represent it: `held`, the nearest camera
    of a lens model of the format (mrcal: the nearest spline), `model` its name, and the difference over the frame, RMS
    and `largest`, px. `solved`: `held` was calibrated from the same pictures instead, and the difference is after the
    best rotation."""

    held: Any
    model: str
    rms: float
    largest: float
    solved: bool = False

    @property
    def text(self) -> str:
        """The difference in words."""
        fit = f"best fit of {self.model} to a lens with a smooth correction"
        solved = f"{self.model}, solved from the same pictures without the smooth correction"
        return (
            f"{solved if self.solved else fit}: differs by {self.rms:.4f} px RMS, {self.largest:.4f} px at most, over "
            "the frame"
        )


class UnheldLensError(FormatError):
    """A format can't hold a camera with this lens `model`: `reason`; its message advises json, which holds any."""

    def __init__(self, reason: str, model: CameraModel) -> None:
        super().__init__(f"{reason} write json")
        self.reason, self.model = reason, model

    def naming(self, formats: Sequence[str]) -> FormatError:
        """The error that advises these `formats` instead."""
        return FormatError(f"{self.reason} write {one_of(formats)}")


def one_of(formats: Sequence[str]) -> str:
    """`a, b or c`."""
    *others, last = formats
    return f"{', '.join(others)} or {last}" if others else last


@dataclass(frozen=True)
class Format:
    """One format of camera files.

    `load(path, text)` returns the file's data; `cameras(data, path)` the cameras in it by name; `text(camera)` the text
    of a file; `stereo_texts(pair)` the text of the single file of a pair, or of the left and the right one;
    `stereo([(data, path), …])` the pair in one or two files. The last two are None for formats without stereo.
    `fit(camera)`: the approximation of a camera with a correction, whose `held` is passed to `text` and `stereo_texts`;
    None for a format that represents the correction. `head`: the text after which comments, `# …`, may be inserted.

    Files are named by one of the `endings`, and, where other formats have those, by `mark` in the rest of the name.
    `recognised(first, text)`: whether a text is of this format, by its `first` line that is no comment; in YAML, by the
    data: `recognised_yaml(data)`. `lenses`: the models of which it holds any camera. `pair_files`: the files of a pair,
    one or two. `rectified`: they hold the rectification. `parts(data)`: for a format with any number of cameras in a
    file, the data of a file with one of them, by its name.
    """

    title: str
    load: Callable[[str, str], Any]
    cameras: Callable[[Any, str], dict[str, Camera]]
    text: Callable[[Camera], str]
    endings: tuple[str, ...]
    lenses: tuple[CameraModel, ...]
    stereo_texts: Callable[[StereoCameras], tuple[str, ...]] | None = None
    stereo: Callable[[Sequence[tuple[Any, str]]], StereoCameras] | None = None
    fit: Callable[[Camera], LensFit] | None = None
    head: str = ""
    mark: str = ""
    recognised: Callable[[str, str], bool] | None = None
    recognised_yaml: Callable[[Any], bool] | None = None
    pair_files: int = 1
    rectified: bool = False
    parts: Callable[[Any], dict[str, Any]] | None = None


def coefficients(*models: tuple[CameraModel, int]) -> Callable[[Camera], LensFit]:
    """`Format.fit` for a format with these lens models: (model, number of coefficients), the simplest first."""

    def fit(camera: Camera) -> LensFit:
        held, rms, largest = nearest_camera(camera, models)
        return LensFit(held, held.model, rms, largest)

    return fit


def make_camera(where: str, K: Array, distortion: Any, size: tuple[int, int], model: CameraModel) -> Camera:
    """A camera from the numbers in a file. Raises FormatError if they aren't those of a calibrated camera."""
    lower = np.array([K[1, 0], K[2, 0], K[2, 1], K[2, 2] - 1])
    if not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0 or lower.any():
        raise FormatError(
            f"{where}: not the matrix of a calibrated camera (fx 0 cx, 0 fy cy, 0 0 1); calibrate it first"
        )
    if not np.isfinite(distortion).all():
        raise FormatError(f"{where}: the distortion must hold finite numbers")
    if trouble := coefficient_trouble(np.asarray(distortion, float)):
        raise FormatError(f"{where}: distortion: {trouble}; calibrate it again")
    with located(where):
        whole = whole_size(size, "the image size")
        return usable(Camera(K, np.asarray(distortion, float), whole, model), where)


def usable(camera: Camera, where: str) -> Camera:
    """`camera` itself, if its lens model is usable. Raises FormatError otherwise."""
    if trouble := lens_trouble(camera):
        raise FormatError(f"{where}: {trouble}; calibrate it again")
    return camera


def matrix(fx: float, fy: float, cx: float, cy: float) -> Real[Array, "3 3"]:
    """The camera matrix K (3, 3)."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)


def opencv_camera(
    where: str, K: Array, values: Sequence[float] | Array, size: tuple[int, int], fisheye: bool = False
) -> Camera:
    """A camera from the numbers in a file, with the distortion `values` of OpenCV's camera model, or of its `fisheye`
    model. Raises FormatError if they aren't those of a calibrated camera."""
    if fisheye:
        return make_camera(where, K, values, size, "fisheye")
    model, distortion = _lens(where, values)
    return make_camera(where, K, distortion, size, model)


def _lens(where: str, values: Sequence[float] | Array) -> tuple[CameraModel, Array]:
    """Lens model and distortion from OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [τx τy]]]]; a pinhole if there are
    none or all are zero."""
    d = np.asarray(values, float).ravel()
    if len(d) not in (0, 4, 5, 8, 12, 14):
        raise FormatError(f"{where}: the distortion must hold 0, 4, 5, 8, 12 or 14 numbers, not {len(d)}")
    if not d.any():
        return "pinhole", d[:0]
    if trouble := prism_trouble(d):
        raise FormatError(f"{where}: {trouble}")
    return model_of(len(d)), d[:8]


def pinhole_numbers(camera: Camera, title: str) -> Real[Array, " 4"]:
    """(4,) fx, fy, cx, cy for a format without skew. Raises FormatError for skew, and for numbers that aren't
    finite."""
    if camera.K[0, 1] != 0:
        raise FormatError(
            f"{title} has no place for skew (K[0, 1] = {camera.K[0, 1]:g}); write json, or calibrate without it"
        )
    if not np.isfinite(camera.distortion).all():
        raise FormatError(
            f"{title}: Camera.distortion must be finite, not {camera.distortion.tolist()}; calibrate again"
        )
    return camera.parameters[:4]


def unheld(camera: Camera, title: str) -> UnheldLensError:
    """The error for a lens model that the format doesn't have."""
    return UnheldLensError(f"{title} has no lens model for {camera.model!r} cameras;", camera.model)


def pair_of(cameras: dict[str, Camera], path: str) -> tuple[Camera, Camera]:
    """The two cameras of a file, in its order. Raises FormatError if there aren't two."""
    if len(cameras) != 2:
        raise FormatError(f"{path}: holds {len(cameras)} cameras, not a pair; give a file with two")
    left, right = cameras.values()
    return left, right


def size_of(data: Any, width: str, height: str, where: str) -> tuple[int, int]:
    """(width, height) from two fields. Raises FormatError if they are missing."""
    if isinstance(data, dict) and (width not in data or height not in data):
        raise FormatError(f"{where}: has no {width!r} and {height!r}; add the size of the pictures, px")
    return take(data, width, int, where), take(data, height, int, where)
