"""Files of rigs: Kalibr's camchain, the TOML of aniposelib and of caliscope, and our JSON; written and read (docs/formats.md)."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np

from rcdn.errors import FormatError, RcdnError, shown
from rcdn.io.cameras import camera_format, kalibr, lens_fit, ours
from rcdn.io.cameras.base import LensFit, make_camera, opencv_lens, pinhole_numbers
from rcdn.io.cameras.rig import motion
from rcdn.io.cameras.yaml_text import flow
from rcdn.io.fields import nullable, numbers, read_text, rigid, take, two_whole_numbers
from rcdn.io.files import write_text
from rcdn.types import Array, Camera, Pose, Rig
from rcdn.types.arrays import Real

RigFormat = Literal["kalibr", "aniposelib", "caliscope", "json"]
_NAMES = "camchain.yaml (Kalibr), .toml (aniposelib; camera_array.toml: caliscope) or .json"


def rig_format(path: str | Path, format: str | None = None) -> RigFormat:
    """The format that a rig is written in at `path`: `format` if it is given, else what the name says.

    `.toml` is aniposelib, but caliscope if the name holds `camera_array`; YAML whose name holds `camchain` is Kalibr, `.json` ours. Raises
    FormatError for any other, naming those that hold a rig.
    """
    name, ending = Path(path).stem.lower(), Path(path).suffix.lower()
    if format is None and ending == ".toml":
        return "caliscope" if "camera_array" in name else "aniposelib"
    found = format if format is not None else camera_format(path)
    for known in get_args(RigFormat):
        if found == known:
            return known
    raise FormatError(f"{path}: {found} has no place for a rig; name the file {_NAMES}")


def write_rig(path: str | Path, rig: Rig, format: str | None = None) -> list[LensFit | None]:
    """Write the cameras of a rig and where they stand in the format of `rig_format(path, format)`, whole or not at all.

    Every digit is kept. A camera with a `correction` is written as it is to json only; for each camera it is returned how far the file's one is
    off, None if it isn't. Names, order and lengths: docs/formats.md. Raises FormatError if the format can't hold a camera's lens, naming
    the camera; OutputError as `write_text`.
    """
    kind = rig_format(path, format)
    fits = [_fit(path, kind, camera) for camera in rig.cameras]
    cameras = [c if f is None else f.held for c, f in zip(rig.cameras, fits, strict=True)]
    places = [pose.T_cam_board for pose in rig.poses]
    if kind == "json":
        text = _json(rig)
    elif kind == "kalibr":
        text = "".join(_chain(rig.names, cameras, places))
    else:
        text = _toml(rig.names, cameras, places, nested=kind == "caliscope")
    write_text(path, text)
    return fits


def read_rig(path: str | Path) -> Rig:
    """Read a rig: what `write_rig` or `rcdn calibrate --rig --json` wrote, a camchain of Kalibr, or the TOML of aniposelib or caliscope.

    Names are those of the file; cameras without a place are left out. Poses are as the file has them, so the rig's frame need not be a
    camera's. Raises FormatError, naming the file, the field and the fix.
    """
    text, ending = read_text(path), Path(path).suffix.lower()
    where = str(path)
    try:
        if ending == ".toml":
            return _of_toml(text, where)
        if text.lstrip().startswith("{"):
            return _of_json(ours.load(where, text), where)
        return _of_chain(kalibr.FORMAT.load(where, text), where)
    except RcdnError as error:
        raise error if isinstance(error, FormatError) else FormatError(f"{where}: {error}") from error


def _fit(path: str | Path, kind: RigFormat, camera: Camera) -> LensFit | None:
    """What the format holds of a camera with a correction; the TOML files have OpenCV's lenses."""
    return lens_fit(path, camera, kind if kind in ("kalibr", "json") else "opencv")


# ---- JSON


def rig_record(rig: Rig) -> dict[str, Any]:
    """The fields of a rig but its cameras."""
    return {"names": list(rig.names), "cov": None if rig.covariance is None else nullable(rig.covariance)}


def _json(rig: Rig) -> str:
    cameras = [
        {"name": name, "T_cam_rig": pose.T_cam_board.tolist(), "camera": ours.camera_record(camera)}
        for name, pose, camera in zip(rig.names, rig.poses, rig.cameras, strict=True)
    ]
    return ours.to_text("rig", rig_record(rig) | {"cameras": cameras})


def _of_json(data: Any, where: str) -> Rig:
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
    """The entries of a camchain: each camera's place after the one before."""
    entries = []
    for k, (name, camera) in enumerate(zip(names, cameras, strict=True)):
        T = places[k] @ np.linalg.inv(places[k - 1]) if k else None
        try:
            entries.append(kalibr.entry(camera, k, [n for n in range(len(names)) if n != k], T, ".toml or json"))
        except FormatError as error:
            raise FormatError(f"camera {name}: {error}") from error
    return entries


def _of_chain(data: Any, where: str) -> Rig:
    cameras = kalibr.FORMAT.cameras(data, where)
    places, T = [], np.eye(4)
    for k, name in enumerate(cameras):
        T = rigid(data[name], "T_cn_cnm1", f"{where}: {name}") @ T if k else T
        places.append(T)
    return Rig(tuple(cameras), tuple(cameras.values()), tuple(map(Pose, places)))


# ---- TOML


def _toml(names: tuple[str, ...], cameras: list[Camera], places: list[Array], nested: bool) -> str:
    """aniposelib's file, a table `cam_K` each, or (`nested`) caliscope's, `cameras.K`, which knows the cameras by their numbers."""
    width = len(str(len(names) - 1))
    text = "" if nested else "[metadata]\nadjusted = false\nerror = 0.0\n"
    for k, (name, camera, T) in enumerate(zip(names, cameras, places, strict=True)):
        try:
            d = _distortion(camera)
        except FormatError as error:
            raise FormatError(f"camera {name}: {error}") from error
        table = f"cameras.{k}" if nested else f"cam_{k:0{width}}"
        head = f"cam_id = {k}" if nested else f"name = {_quoted(name)}"
        text += (
            f"\n[{table}]\n{head}\nsize = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"matrix = [{', '.join(flow(row) for row in camera.K)}]\ndistortions = {flow(d)}\n"
            f"rotation = {flow(cv2.Rodrigues(T[:3, :3])[0].ravel())}\ntranslation = {flow(T[:3, 3])}\n"
            f"fisheye = {'true' if camera.model == 'fisheye' else 'false'}\n"
        )
    return text.lstrip()


def _distortion(camera: Camera) -> Array:
    title = "TOML of aniposelib and caliscope"
    pinhole_numbers(camera, title)
    if camera.model == "division":
        raise FormatError(f"{title} has no lens model for 'division' cameras; write json")
    d = camera.distortion
    return np.pad(d, (0, 5 - len(d))) if len(d) < 5 and camera.model != "fisheye" else d


def _quoted(name: str) -> str:
    """A basic string of TOML, whose escapes are JSON's."""
    return json.dumps(name)


def _of_toml(text: str, where: str) -> Rig:
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FormatError(f"{where}: is no TOML ({error}); export it again") from error
    tables: Mapping[str, Any] = data.get("cameras", data)
    if not isinstance(tables, dict):
        raise FormatError(f"{where}: 'cameras' must be a table; export the file again")
    cameras, poses = {}, []
    for key, record in tables.items():
        if not isinstance(record, dict) or "matrix" not in record or "rotation" not in record:
            continue
        at = f"{where}: {key}"
        name = record.get("name", key)
        K, d = numbers(record, "matrix", at, finite=True, shape=(3, 3)), _list(record, "distortions", at)
        size = two_whole_numbers(record, "size", at)
        if record.get("fisheye") is True:
            cameras[str(name)] = make_camera(at, K, d, size, "fisheye")
        else:
            model, lens = opencv_lens(at, d)
            cameras[str(name)] = make_camera(at, K, lens, size, model)
        poses.append(Pose(_place(record, at)))
    if not poses:
        raise FormatError(f"{where}: holds no camera with a place; give a TOML of aniposelib or caliscope")
    return Rig(tuple(cameras), tuple(cameras.values()), tuple(poses))


def _list(record: dict[str, Any], key: str, where: str) -> Array:
    return np.ravel(numbers(record, key, where, finite=True))


def _place(record: dict[str, Any], where: str) -> Real[Array, "4 4"]:
    """(4, 4) of a rotation vector, or of a matrix as older files of caliscope have it."""
    turn, t = _list(record, "rotation", where), _list(record, "translation", where)
    if len(turn) not in (3, 9) or len(t) != 3:
        raise FormatError(f"{where}: 'rotation' must hold 3 or 9 numbers and 'translation' 3; export the file again")
    T = motion(cv2.Rodrigues(turn)[0] if len(turn) == 3 else turn.reshape(3, 3), t)
    return rigid({"rotation": T.tolist()}, "rotation", where)
