"""Camera files of other programs, written and read: OpenCV, ROS, Kalibr, COLMAP, mrcal and our own JSON (docs/formats.md)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

from rcdn.errors import FormatError, RcdnError, shown
from rcdn.io.cameras import colmap, kalibr, mrcal, opencv, ours, ros, yaml_text
from rcdn.io.cameras.base import Format, LensFit
from rcdn.io.cameras.rig import Rectification, StereoCameras
from rcdn.io.fields import is_rigid, read_text
from rcdn.io.files import check_writable, write_text
from rcdn.types import Camera, StereoCalibration

__all__ = [
    "CameraFormat",
    "LensFit",
    "Rectification",
    "StereoCameras",
    "camera_format",
    "check_lens",
    "lens_fit",
    "read_camera",
    "read_cameras",
    "read_stereo",
    "write_camera",
    "write_stereo",
]

CameraFormat = Literal["opencv", "ros", "kalibr", "colmap", "mrcal", "json"]

_FORMATS = {
    "opencv": opencv.FORMAT,
    "ros": ros.FORMAT,
    "kalibr": kalibr.FORMAT,
    "colmap": colmap.FORMAT,
    "mrcal": mrcal.FORMAT,
    "json": ours.FORMAT,
}
_ENDINGS: dict[str, CameraFormat] = {
    ".yaml": "opencv",
    ".yml": "opencv",
    ".txt": "colmap",
    ".cameramodel": "mrcal",
    ".json": "json",
}


def camera_format(path: str | Path, format: CameraFormat | None = None) -> CameraFormat:
    """The format that `path` is written in: `format` if it is given, else what the name says.

    `.cameramodel` is mrcal, `.txt` COLMAP, `.json` ours; `.yaml` and `.yml` are OpenCV, but ROS if the name holds `camera_info` and
    Kalibr if it holds `camchain`. Raises FormatError for any other name.
    """
    if format is not None:
        return _known(format)
    name, ending = Path(path).stem.lower(), Path(path).suffix.lower()
    if ending in (".yaml", ".yml") and "camera_info" in name:
        return "ros"
    if ending in (".yaml", ".yml") and "camchain" in name:
        return "kalibr"
    if ending not in _ENDINGS:
        raise FormatError(
            f"{path}: which format? End the name with {', '.join(_ENDINGS)}, or name one of {', '.join(_FORMATS)}"
        )
    return _ENDINGS[ending]


def write_camera(path: str | Path, camera: Camera, format: CameraFormat | None = None) -> LensFit | None:
    """Write a camera in the format of `camera_format(path, format)`, whole or not at all.

    Every digit is kept. A camera with a `correction` is written as it is to json only, and to the others as `lens_fit` says, which is
    returned and stands in the file as a comment; None if the file holds the camera as it is. Raises FormatError if the format can't
    hold the lens model, naming those that can; OutputError as `write_text`.
    """
    kind, fit = _FORMATS[camera_format(path, format)], lens_fit(path, camera, format)
    write_text(path, noted(kind.head, kind.text(camera if fit is None else fit.held), _texts([fit])))
    return fit


def check_lens(path: str | Path, camera: Camera, format: CameraFormat | None = None, stereo: bool = False) -> None:
    """Raise FormatError if the format of `camera_format(path, format)` can't hold a camera with such a lens, or (`stereo`) no pair."""
    kind = _FORMATS[camera_format(path, format)]
    if stereo and kind.stereo_texts is None:
        raise _no_pair(kind)
    kind.text(camera)


def _no_pair(kind: Format) -> FormatError:
    return FormatError(f"{kind.title} has no place for the pose of a pair; write opencv, ros, kalibr, mrcal or json")


def lens_fit(path: str | Path, camera: Camera, format: CameraFormat | None = None) -> LensFit | None:
    """What a file in the format of `camera_format(path, format)` holds of a camera with a `correction`: the best fit of the format's lens
    models (mrcal: of its splined stereographic one) over the frame, and how far it is off; None if it holds the camera as it is.

    Raises FormatError if no lens of the format can show what the camera sees.
    """
    kind = _FORMATS[camera_format(path, format)]
    if camera.correction is None or kind.fit is None:
        return None
    try:
        return kind.fit(camera)
    except RcdnError as error:
        raise FormatError(f"{kind.title}: {error}; write json") from error


def _texts(fits: Sequence[LensFit | None]) -> list[str]:
    return [fit.text for fit in fits if fit is not None]


def noted(head: str, text: str, notes: Iterable[str | None]) -> str:
    """The text of a file with `notes` as comments after its `head`."""
    lines = [f"# {note}\n" for note in dict.fromkeys(notes)]
    return text.replace(head, head + "".join(lines), 1) if lines else text


def read_camera(path: str | Path, format: CameraFormat | None = None, name: str | None = None) -> Camera:
    """Read a camera; the format is recognised by what is in the file, unless it is given.

    `name`: which camera of a file with several (`cam1`; `left`; COLMAP's number). Distortion that is all zero reads as a pinhole.
    Raises FormatError, naming the file, the field and the fix, if the file holds none, several without a `name`, or a lens that rcdn doesn't know.
    """
    cameras = read_cameras(path, format)
    if name is None and len(cameras) == 1:
        return next(iter(cameras.values()))
    if name not in cameras:
        raise FormatError(
            f"{path}: holds the cameras {', '.join(cameras)}; name one of them"
            + (f", not {shown(name)}" if name else "")
        )
    return cameras[name]


def is_rig(path: str | Path) -> bool:
    """Whether a file is our JSON of a rig, or COLMAP's. Raises FormatError as `read_cameras` if it can't be read."""
    text = read_text(path).lstrip()
    if text.startswith("["):
        return True
    return text.startswith("{") and "lensmodel" not in text[:2000] and ours.load(str(path), text).get("kind") == "rig"


def read_cameras(path: str | Path, format: CameraFormat | None = None) -> dict[str, Camera]:
    """All cameras of a file by name, in its order; see `read_camera`. A file for one camera names it `camera`."""
    found, data = _load(path, format)
    return _FORMATS[found].cameras(data, str(path))


def write_stereo(
    path: str | Path, pair: StereoCameras | StereoCalibration, format: CameraFormat | None = None
) -> list[Path]:
    """Write two cameras and where they stand; returns the files, which are two for ROS and mrcal: `path` with _left and _right.

    The lens models may differ. Raises FormatError for COLMAP, whose cameras.txt has no place for a pose, for ROS without a rectification,
    and as `write_camera`, naming the camera that the format can't hold.
    """
    kind = _FORMATS[camera_format(path, format)]
    if kind.stereo_texts is None:
        raise _no_pair(kind)
    found = StereoCameras.of(pair)
    left, right = (_side(path, kind, side, format) for side in (("left", found.left), ("right", found.right)))
    fits = [left[1], right[1]]
    texts = kind.stereo_texts(replace(found, left=left[0], right=right[0]))
    target = Path(path)
    sides = [target.with_stem(f"{target.stem}_{side}") for side in ("left", "right")]
    files = [target] if len(texts) == 1 else sides
    for file in files:
        check_writable(file)
    for file, text, of in zip(files, texts, [fits] if len(texts) == 1 else [fits[:1], fits[1:]], strict=True):
        write_text(file, noted(kind.head, text, _texts(of)))
    return files


def _side(
    path: str | Path, kind: Format, side: tuple[str, Camera], format: CameraFormat | None
) -> tuple[Camera, LensFit | None]:
    """What a file holds of the camera of a side, and `lens_fit`; raises FormatError, naming the side, if the format can't hold it."""
    name, camera = side
    try:
        fit = lens_fit(path, camera, format)
        held = camera if fit is None else fit.held
        kind.text(held)
    except FormatError as error:
        raise FormatError(f"{name} camera: {error}") from error
    return held, fit


def read_stereo(left: str | Path, right: str | Path | None = None, format: CameraFormat | None = None) -> StereoCameras:
    """Read two cameras and where they stand, from one file (OpenCV, Kalibr, JSON) or from the `left` and the `right` one (ROS, mrcal).

    OpenCV's stereo sample writes two, too: intrinsics.yml and extrinsics.yml. The rectification is None where the
    file has none (Kalibr, mrcal). Raises FormatError, naming the file, the field and the fix.
    """
    paths = [left] if right is None else [left, right]
    found = [_load(path, format) for path in paths]
    kinds = {kind for kind, _ in found} if format is None else {format}
    if len(kinds) > 1:
        raise FormatError(
            f"{left} and {right}: one is {found[0][0]}, the other {found[1][0]}; give two files of one format"
        )
    kind = _FORMATS[kinds.pop()]
    if kind.stereo is None:
        raise FormatError(
            f"{left}: {kind.title} has no place for the pose of a pair; give opencv, ros, kalibr, mrcal or json"
        )
    try:
        pair = kind.stereo([(data, str(path)) for (_, data), path in zip(found, paths, strict=True)])
    except RcdnError as error:
        raise error if isinstance(error, FormatError) else FormatError(f"{left}: {error}") from error
    if not is_rigid(pair.T_right_left):
        raise FormatError(f"{left}: the pose of the right camera is no rotation and translation; export it again")
    return pair


def _known(format: str) -> CameraFormat:
    for known in get_args(CameraFormat):
        if format == known:
            return known
    raise FormatError(f"format must be one of {', '.join(_FORMATS)}, not {shown(format)}")


MOST = 4_000_000
"""characters of a camera file that isn't JSON: what is larger is none, and its YAML would take minutes to read"""


def _load(path: str | Path, format: CameraFormat | None) -> tuple[CameraFormat, Any]:
    """The format of a file, by what is in it, and its data."""
    text = read_text(path)
    if format is not None:
        return format, parsed(_known(format), path, text)
    lines = (line.strip() for line in text.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    for kind, sign in _SIGNS.items():
        if re.match(sign, first) and (kind != "mrcal" or "lensmodel" in text):
            return _known(kind), parsed(kind, path, text)
    data = parsed("opencv", path, text) if text.strip() else None  # YAML, whatever its kind
    return _yaml_kind(data, path), data


def parsed(kind: str, path: str | Path, text: str) -> Any:
    """The data of a file of a format. Raises FormatError for what is far too large to be one, and as its reader."""
    if len(text) > MOST and kind != "json":
        raise FormatError(f"{path}: too large for a camera file ({len(text) / 1e6:.0f} MB); check the path")
    return _FORMATS[kind].load(str(path), text)


# what the first line that isn't a comment begins with
_SIGNS = {"mrcal": r"\{", "json": r"\{", "colmap": r"\d+\s+[A-Z_0-9]+\s+\d+\s+\d+\b"}


def _yaml_kind(data: Any, path: str | Path) -> CameraFormat:
    """Which YAML: Kalibr has cam0, ROS plain mappings, OpenCV tagged matrices."""
    keys = {str(key).lower(): value for key, value in data.items()} if isinstance(data, dict) else {}
    if kalibr.names(data):
        return "kalibr"
    matrix = keys.get("camera_matrix")
    if isinstance(matrix, dict) and not isinstance(matrix, yaml_text.Matrix):
        return "ros"
    if {"camera_matrix", "m1", "r"} & set(keys):
        return "opencv"
    raise FormatError(
        f"{path}: no camera file that rcdn knows ({', '.join(f.title for f in _FORMATS.values())}); check the path"
    )
