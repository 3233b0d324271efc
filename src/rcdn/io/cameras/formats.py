"""The formats of camera files: which there are, and how a file's is recognised."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args

from rcdn.errors import FormatError, shown
from rcdn.io.cameras import colmap, kalibr, mrcal, opencv, ours, ros, yaml_text
from rcdn.io.cameras.base import Format, UnheldLensError, one_of
from rcdn.io.fields import check_path, read_text
from rcdn.types import Camera

CameraFormat = Literal["opencv", "ros", "kalibr", "colmap", "mrcal", "json"]

FORMATS: dict[CameraFormat, Format] = {
    "mrcal": mrcal.FORMAT,
    "json": ours.FORMAT,
    "colmap": colmap.FORMAT,
    "kalibr": kalibr.FORMAT,
    "ros": ros.FORMAT,
    "opencv": opencv.FORMAT,
}
"""in the order in which a file is compared with them: JSON may be of mrcal, YAML of Kalibr or ROS"""
MOST_CHARACTERS = 4_000_000
"""largest number of characters of a camera file that isn't JSON: YAML of a larger file would take minutes to parse"""


def names_of(suited: Callable[[Format], bool] = lambda _: True) -> list[CameraFormat]:
    """The formats that are `suited`, in the order of `CameraFormat`."""
    return [name for name in get_args(CameraFormat) if suited(FORMATS[name])]


def camera_format(path: str | Path, format: CameraFormat | None = None) -> CameraFormat:
    """The format in which `path` is written: `format` if given, else determined by the file name.

    `.cameramodel` is mrcal, `.txt` COLMAP, `.json` rcdn's; `.yaml` and `.yml` are OpenCV, or ROS if the name contains
    `camera_info`, or Kalibr if it contains `camchain`. Raises FormatError for any other name, and
    for what is no path.
    """
    check_path(path)
    if format is not None:
        return known(format)
    name, ending = Path(path).stem.lower(), Path(path).suffix.lower()
    suited = names_of(lambda kind: ending in kind.endings and kind.mark in name)
    if not suited:
        endings = dict.fromkeys(ending for kind in names_of() for ending in FORMATS[kind].endings)
        raise FormatError(
            f"{path}: which format? End the name with {', '.join(endings)}, or name one of {', '.join(names_of())}"
        )
    return max(suited, key=lambda kind: len(FORMATS[kind].mark))


def known(format: str) -> CameraFormat:
    """`format` itself. Raises FormatError if it is none."""
    for name in names_of():
        if format == name:
            return name
    raise FormatError(f"format must be one of {', '.join(names_of())}, not {shown(format)}")


def no_pair(title: str, use: str) -> FormatError:
    """The error for a format without a pose of a pair; `use`: what to do with the formats that have one."""
    pairs = names_of(lambda kind: kind.stereo is not None)
    return FormatError(f"{title} has no place for the pose of a pair; {use} {one_of(pairs)}")


def text_of(kind: Format, camera: Camera, of_pair: bool = False) -> str:
    """The text of a file of one camera. Raises FormatError if the format can't hold it, listing those that can;
    `of_pair`: those that can hold a pair."""
    try:
        return kind.text(camera)
    except UnheldLensError as error:
        model = error.model
        raise error.naming(
            names_of(lambda other: model in other.lenses and not (of_pair and other.stereo is None))
        ) from None


def load(path: str | Path, format: CameraFormat | None) -> tuple[CameraFormat, Any]:
    """(format, data) of a file; the format is recognised from its contents unless it is given."""
    text = read_text(path)
    if format is not None:
        return format, parsed(known(format), path, text)
    lines = (line.strip() for line in text.splitlines())
    first = next((line for line in lines if line and not line.startswith("#")), "")
    for name, kind in FORMATS.items():
        if kind.recognised is not None and kind.recognised(first, text):
            return name, parsed(name, path, text)
    _check_length(path, text)
    data = yaml_text.load(str(path), text) if text.strip() else None
    for name, kind in FORMATS.items():
        if isinstance(data, dict) and kind.recognised_yaml is not None and kind.recognised_yaml(data):
            return name, data
    titles = ", ".join(FORMATS[name].title for name in names_of())
    raise FormatError(f"{path}: no camera file that rcdn knows ({titles}); check the path")


def parsed(format: CameraFormat, path: str | Path, text: str) -> Any:
    """The data of a file in a `format`. Raises FormatError if it is too large for a camera file, and as the format's
    reader."""
    if format != "json":
        _check_length(path, text)
    return FORMATS[format].load(str(path), text)


def _check_length(path: str | Path, text: str) -> None:
    if len(text) > MOST_CHARACTERS:
        raise FormatError(f"{path}: too large for a camera file ({len(text) / 1e6:.0f} MB); check the path")
