"""Reading and writing files of rigs (docs/formats.md).

Kalibr's camchain, TOML of aniposelib and caliscope, COLMAP's rig_config.json, one file per camera in the formats of
OpenCV and ROS, and rcdn's JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from rcdn.errors import FormatError, said_of, shown
from rcdn.io import rig_colmap, rig_folder, rig_toml
from rcdn.io.cameras import (
    FORMATS,
    CameraFormat,
    StereoCameras,
    camera_format,
    camera_names,
    kalibr,
    lens_fit,
    noted,
    ours,
    parsed,
    read_stereo,
)
from rcdn.io.cameras.base import LensFit, UnheldLensError
from rcdn.io.cameras.formats import load
from rcdn.io.fields import check_path, located, nullable, numbers, read_json, read_text, rigid, take
from rcdn.io.files import check_writable, write_text
from rcdn.types import Array, Camera, CameraModel, Pose, Rig

RigFormat = Literal["kalibr", "aniposelib", "caliscope", "colmap", "opencv", "ros", "json"]
_NAMES = (
    "camchain.yaml (Kalibr), .toml (aniposelib; camera_array.toml: caliscope), rig_config.json (COLMAP), .yaml "
    "(OpenCV, a file a camera; camera_info.yaml: ROS) or .json"
)
_PAIRS = ("stereo calibration", "stereo cameras")
"""kinds of rcdn's JSON that hold two cameras"""
_READ = "Kalibr (camchain.yaml), aniposelib, caliscope, COLMAP or rcdn"
_LENSES: dict[RigFormat, CameraFormat] = {
    "kalibr": "kalibr",
    "aniposelib": "opencv",
    "caliscope": "opencv",
    "opencv": "opencv",
    "ros": "ros",
    "colmap": "colmap",
    "json": "json",
}
"""the format of camera files with the same lens models"""


def rig_format(path: str | Path, format: str | None = None) -> RigFormat:
    """The format in which a rig is written to `path`: `format` if given, else determined by the file name.

    `.toml` is aniposelib, or caliscope if the name contains `camera_array`; `.json` is rcdn's, or COLMAP's if the name
    contains `rig_config`; YAML is Kalibr's if the name contains `camchain`, ROS's if it contains `camera_info`, else
    OpenCV's. Raises FormatError for any other name, listing the formats that can hold a rig.
    """
    name, ending = Path(path).stem.lower(), Path(path).suffix.lower()
    if format is None and ending == ".toml":
        return "caliscope" if "camera_array" in name else "aniposelib"
    if ending == ".json" and format is None and "rig_config" in name:
        return "colmap"
    found = format if format is not None else camera_format(path)
    for known in get_args(RigFormat):
        if found == known and not (found == "colmap" and ending == ".txt"):
            return known
    raise FormatError(f"{path}: {found} has no place for a rig; name the file {_NAMES}")


def rig_paths(path: str | Path, names: Sequence[str], format: str | None = None) -> list[Path]:
    """The files that `write_rig` writes for cameras of these `names`: `path`, or one file per camera (OpenCV, ROS) with
    the camera's name added to `path`."""
    kind = rig_format(path, format)
    return rig_folder.paths(Path(path), names, kind) if kind in ("opencv", "ros") else [Path(path)]


def write_rig(path: str | Path, rig: Rig, format: str | None = None) -> list[LensFit | None]:
    """Write the cameras of a rig and their poses in the format of `rig_format(path, format)`; each file of `rig_paths`
    is written whole or not at all.

    All digits are kept. A camera with a `correction` is represented exactly in json only. Returns for each camera the
    difference between the camera and its representation in the file, None if there is none; it is also written to the
    file as a comment if the format allows comments. Names, order and units: docs/formats.md. Raises FormatError, naming
    the camera, if the format can't hold its lens; OutputError as `write_text`.
    """
    kind, files, fits = rig_format(path, format), rig_paths(path, rig.names, format), lens_fits(path, rig, format)
    cameras = [c if f is None else f.held for c, f in zip(rig.cameras, fits, strict=True)]
    texts = _texts(kind, rig, cameras)
    if len(texts) > 1:
        for file in files:
            check_writable(file)
    named = [None if f is None else f"camera {n}: {f.text}" for n, f in zip(rig.names, fits, strict=True)]
    notes = [[n] for n in named] + [[]] if len(texts) > 1 else [named]
    for file, text, note in zip(files, texts, notes, strict=False):
        write_text(file, text if kind in ("json", "colmap") else noted(_head(kind), text, filter(None, note)))
    return fits


def _head(kind: RigFormat) -> str:
    """The text after which comments are inserted; the beginning of the file where `kind` is a rig's alone."""
    return FORMATS[_LENSES[kind]].head if kind == _LENSES[kind] else ""


def check_rig(path: str | Path, cameras: Mapping[str, Camera], format: str | None = None) -> None:
    """Raise FormatError, naming the camera, if the format of `rig_format(path, format)` can't hold a rig of `cameras`
    (by name)."""
    kind = rig_format(path, format)
    rig_paths(path, tuple(cameras), format)
    fits = [_fit(path, kind, name, camera) for name, camera in cameras.items()]
    held = [c if f is None else f.held for c, f in zip(cameras.values(), fits, strict=True)]
    _texts(kind, Rig(tuple(cameras), tuple(cameras.values()), (Pose(np.eye(4)),) * len(held)), held)


def _texts(kind: RigFormat, rig: Rig, cameras: list[Camera]) -> list[str]:
    places = list(rig.T_cam_rig)
    if kind == "json":
        return [_json(rig)]
    if kind == "kalibr":
        return ["".join(_chain(rig.names, cameras, places))]
    if kind == "colmap":
        return [rig_colmap.text(rig.names, cameras, places)]
    if kind in ("opencv", "ros"):
        return rig_folder.texts(kind, rig.names, cameras, places)
    return [rig_toml.text(rig.names, cameras, places, nested=kind == "caliscope")]


def read_rig(path: str | Path, *others: str | Path) -> Rig:
    """Read a rig from a file of `write_rig`, `rcdn calibrate --rig --json`, Kalibr, aniposelib, caliscope or COLMAP
    (rig_config.json).

    For formats with one file per camera (OpenCV; ROS, including the file of transforms) give all files, or the `path`
    that was given to `write_rig`. Names are those in the file; cameras without a pose are left out. Poses are those of
    the file, so the rig's frame need not be that of a camera. Files of two cameras (`rcdn calibrate --stereo`, OpenCV;
    both files of ROS or mrcal, or the path that was given to `write_stereo`) are rigs of `left` and `right`. Raises
    FormatError, naming the file, the field and the fix.
    """
    for each in (path, *others):
        check_path(each)
    paths = [Path(path), *map(Path, others)] if others else rig_folder.siblings(Path(path)) or [Path(path)]
    where = str(paths[0])
    with located(where):
        if len(paths) > 1:
            if pair := pair_of_files(paths):
                return _rig_of_pair(pair)
            return rig_folder.rig_of([(parsed("opencv", p, read_text(p)), str(p)) for p in paths])
        text = read_text(paths[0])
        if paths[0].suffix.lower() == ".toml":
            return rig_toml.rig_of(text, where)
        if text.lstrip().startswith("["):
            return rig_colmap.rig_of(read_json(where, text, "export the rig_config.json again"), where)
        if text.lstrip().startswith("{"):
            record = ours.load(where, text)
            return _rig_of_pair(read_stereo(paths[0])) if record.get("kind") in _PAIRS else rig_of_record(record, where)
        data = parsed("opencv", where, text)  # YAML of any format, or XML
        if kalibr.names(data):
            return _of_chain(data, where)
        try:
            return _rig_of_pair(read_stereo(paths[0]))
        except FormatError as error:
            if isinstance(data, dict) and {"M1", "M2"} & data.keys():
                raise
            if len(names := _names(paths[0])) > 1:
                raise FormatError(
                    f"{where}: holds the cameras {', '.join(names)}, but not where they stand; give a file of a rig"
                ) from error
            raise FormatError(
                f"{where}: holds no rig; of one file a camera (OpenCV, ROS) give all, or the name that they were "
                f"written under (rig.yaml of rig_left.yaml), else a file that {_READ} wrote"
            ) from error


def pair_of_files(paths: Sequence[Path]) -> StereoCameras | None:
    """The pair in two files: of mrcal, the left one first; of ROS with a rectification, or OpenCV's stereo sample, in
    any order. None if the files are no such pair."""
    kinds = {_kind(path) for path in paths} if len(paths) == 2 else set()
    if kinds == {"mrcal"}:
        return read_stereo(paths[0], paths[1])
    for left, right in (paths, paths[::-1]) if kinds in ({"ros"}, {"opencv"}) else ():
        with suppress(FormatError):
            return read_stereo(left, right)
    return None


def _kind(path: Path) -> CameraFormat | None:
    """The format of a camera file, None of another file."""
    try:
        return load(path, None)[0]
    except FormatError:
        return None


def _names(path: Path) -> list[str]:
    """The names of the cameras of a camera file, none of another file."""
    try:
        return camera_names(path)
    except FormatError:
        return []


def _rig_of_pair(pair: StereoCameras) -> Rig:
    poses = (Pose(np.eye(4)), Pose(pair.T_right_left))
    return Rig(("left", "right"), (pair.left, pair.right), poses)


def lens_fits(path: str | Path, rig: Rig, format: str | None = None) -> list[LensFit | None]:
    """The result of `write_rig`, without writing."""
    kind = rig_format(path, format)
    return [_fit(path, kind, name, camera) for name, camera in zip(rig.names, rig.cameras, strict=True)]


def _fit(path: str | Path, kind: RigFormat, name: str, camera: Camera) -> LensFit | None:
    """The representation of a camera with a correction in the format."""
    with said_of(f"camera {name}", FormatError):
        return lens_fit(path, camera, _LENSES[kind])


# ---- JSON


def rig_record(rig: Rig) -> dict[str, Any]:
    """The fields of a rig except its cameras."""
    return {"names": list(rig.names), "cov": None if rig.covariance is None else nullable(rig.covariance)}


def _json(rig: Rig) -> str:
    cameras = [
        {"name": name, "T_cam_rig": pose.T_cam_board.tolist(), "camera": ours.camera_record(camera)}
        for name, pose, camera in zip(rig.names, rig.poses, rig.cameras, strict=True)
    ]
    return ours.to_text("rig", rig_record(rig) | {"cameras": cameras})


def rig_of_record(data: Any, where: str) -> Rig:
    """The rig of rcdn's JSON."""
    if data.get("kind") != "rig":
        raise FormatError(
            f"{where}: holds {shown(data.get('kind'))}, not 'rig'; write it with `rcdn calibrate --rig --json`"
        )
    cameras, poses = {}, {}
    for k, record in enumerate(take(data, "cameras", list, where)):
        at = f"{where}: cameras[{k}]"
        name = take(record, "name", str, at)
        if record.get("T_cam_rig") is not None:
            cameras[name] = ours.camera_of(record, at)
            poses[name] = rigid(record, "T_cam_rig", at)
    names = take(data, "names", list, where)
    if sorted(map(str, names)) != sorted(cameras):
        raise FormatError(f"{where}: 'names' must be those of the cameras with a 'T_cam_rig': {', '.join(cameras)}")
    side = 6 * len(names)
    cov = None if data.get("cov") is None else numbers(data, "cov", where, shape=(side, side))
    return Rig(
        tuple(names), tuple(cameras[n] for n in names), tuple(Pose(poses[n]) for n in names), cov
    )  # in the covariance's order


# ---- Kalibr


def _chain(names: tuple[str, ...], cameras: list[Camera], places: list[Array]) -> list[str]:
    """The entries of a camchain: the pose of each camera is relative to the previous one."""
    entries = []
    for k, (name, camera) in enumerate(zip(names, cameras, strict=True)):
        T = places[k] @ np.linalg.inv(places[k - 1]) if k else None
        with said_of(f"camera {name}", FormatError):
            try:
                entries.append(kalibr.entry(camera, k, [n for n in range(len(names)) if n != k], T))
            except UnheldLensError as error:
                raise FormatError(error.naming(_holders(error.model))) from error
    return entries


def _holders(model: CameraModel) -> list[str]:
    """The formats of rigs that hold any camera of a lens `model`, as users name them."""
    held = [kind for kind, cameras in _LENSES.items() if model in FORMATS[cameras].lenses]
    return [*dict.fromkeys(".toml" if _LENSES[kind] != kind else kind for kind in held)]


def _of_chain(data: Any, where: str) -> Rig:
    cameras = kalibr.FORMAT.cameras(data, where)
    places, T = [], np.eye(4)
    for k, name in enumerate(cameras):
        T = rigid(data[name], "T_cn_cnm1", f"{where}: {name}") @ T if k else T
        places.append(T)
    return Rig(tuple(cameras), tuple(cameras.values()), tuple(map(Pose, places)))
