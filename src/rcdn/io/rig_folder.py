"""Rigs as one file per camera: OpenCV's YAML including the camera's pose, or ROS camera_info with a file of static
transforms."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import FormatError, said_of
from rcdn.geometry.rigid import motion
from rcdn.io.cameras import opencv, ros
from rcdn.io.cameras.yaml_text import Matrix, block_matrix, digits
from rcdn.io.fields import number, numbers, rigid, take
from rcdn.types import Array, Camera, Pose, Rig

FRAME = "_optical_frame"
"""ROS's suffix (REP 103) of frames with z forward, x right and y down"""
TRANSFORMS = "transforms"
"""suffix of the name of ROS's file of transforms"""


def paths(path: Path, names: Sequence[str], kind: str) -> list[Path]:
    """The files of a rig that is written to `path`: `path` with each camera's name added (ROS: also `transforms`)."""
    if odd := [name for name in names if not name or Path(name).name != name or "\0" in name or "\\" in name]:
        raise FormatError(
            f"{path}: one file a camera is named by it, and {odd[0]!r} can't be a part of a file's name; "
            "rename the camera, or write json"
        )
    parts = [*names, TRANSFORMS] if kind == "ros" else list(names)
    if kind == "ros" and TRANSFORMS in names:
        raise FormatError(f"{path}: a camera called {TRANSFORMS!r} has the name of ROS's file of places; rename it")
    return [path.with_name(f"{path.stem}_{part}{path.suffix}") for part in parts]


def texts(kind: str, names: Sequence[str], cameras: Sequence[Camera], places: Sequence[Array]) -> list[str]:
    """The contents of the files of `paths`. `places`: T_cam_rig (4, 4) of each camera."""
    of = ros.FORMAT if kind == "ros" else opencv.FORMAT
    out = []
    for k, (name, camera, T) in enumerate(zip(names, cameras, places, strict=True)):
        with said_of(f"camera {name}", FormatError):
            text = of.text(camera)
        if kind == "ros":
            text = text.replace("camera_name: camera\n", f"camera_name: {_quoted(name)}\n", 1)
        else:
            text += f"camera_name: {_quoted(name)}\ncamera_index: {k}\n"
            text += "".join(block_matrix(key, a, " !!opencv-matrix") for key, a in (("R", T[:3, :3]), ("T", T[:3, 3:])))
        out.append(text)
    return [*out, _transforms(names, places)] if kind == "ros" else out


def _quoted(text: str) -> str:
    """A YAML string in double quotes, which has the same escapes as JSON."""
    return json.dumps(text, ensure_ascii=False)


def _transforms(names: Sequence[str], places: Sequence[Array]) -> str:
    """A tf2_msgs/TFMessage with each camera's frame relative to that of the first camera."""
    from scipy.spatial.transform import Rotation  # imported late: detection must not load it

    first, out = places[0], "transforms:\n"
    for name, T in zip(names[1:], places[1:], strict=True):
        pose = first @ np.linalg.inv(T)  # from the camera's coordinates to the first one's, as in tf
        quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
        turn, t = (
            "".join(f", {n}: {digits(v)}" for n, v in zip("xyzw", a, strict=False))[2:]
            for a in (quaternion, pose[:3, 3])
        )
        out += (
            f"- header: {{frame_id: {_quoted(names[0] + FRAME)}}}\n  child_frame_id: {_quoted(name + FRAME)}\n"
            f"  transform:\n    translation: {{{t}}}\n    rotation: {{{turn}}}\n"
        )
    return out


def siblings(path: Path) -> list[Path]:
    """The existing files whose names `paths` derives from `path`; [] if `path` is a file itself, or there are none."""
    if path.exists() or not path.suffix:
        return []
    start = f"{path.stem}_"
    folder = path.parent
    return sorted(p for p in folder.glob(f"*{path.suffix}") if p.name.startswith(start)) if folder.is_dir() else []


def rig_of(files: Sequence[tuple[Any, str]]) -> Rig:
    """The rig in files (data, path), one per camera: OpenCV's, or ROS's including the file of transforms, in any
    order."""
    trees = [(data, path) for data, path in files if isinstance(data, dict) and "transforms" in data]
    rest = [file for file in files if file not in trees] if trees else list(files)
    if not trees:
        return _of_opencv(rest)
    if len(trees) > 1:
        raise FormatError(f"{trees[1][1]}: holds transforms, as {trees[0][1]} does; give one file of them")
    return _of_ros(rest, *trees[0])


def _of_opencv(files: Sequence[tuple[Any, str]]) -> Rig:
    found: list[tuple[float, str, Camera, Pose]] = []
    for k, (data, path) in enumerate(files):
        if isinstance(data, dict) and ros.recognised(data):
            raise FormatError(
                f"{path}: ROS's file of one camera doesn't say where it stands; give the file of transforms, too, or "
                "both files of a pair that is rectified (the right one with a baseline in its projection_matrix)"
            )
        if not isinstance(data, dict) or not all(
            isinstance(data.get(key), Matrix) for key in ("camera_matrix", "R", "T")
        ):
            raise FormatError(
                f"{path}: has no camera_matrix, R and T (!!opencv-matrix) of a rig's camera; give the files that `rcdn "
                "calibrate --rig -o` wrote"
            )
        camera = opencv.FORMAT.cameras({key: v for key, v in data.items() if key not in ("R", "T")}, path)["camera"]
        R, t = data["R"].array(f"{path}: 'R'"), data["T"].array(f"{path}: 'T'")
        if R.shape != (3, 3) or t.size != 3:
            raise FormatError(f"{path}: 'R' must be 3 × 3 and 'T' 3 × 1; export it again")
        T = rigid({"R and T": motion(R, t).tolist()}, "R and T", path)
        index = number(data, "camera_index", path) if "camera_index" in data else float(k)
        name = data.get("camera_name", Path(path).stem)
        found.append((index, str(name), camera, Pose(T)))
    found.sort(key=lambda each: each[0])
    _, names, cameras, poses = zip(*found, strict=True)
    return Rig(names, cameras, poses)


def _of_ros(files: Sequence[tuple[Any, str]], tree: Any, where: str) -> Rig:
    cameras = {take(data, "camera_name", str, path): ros.FORMAT.cameras(data, path)["camera"] for data, path in files}
    places: dict[str, Array] = {}
    for k, each in enumerate(take(tree, "transforms", list, where)):
        at = f"{where}: transforms[{k}]"
        parent, child = take(take(each, "header", dict, at), "frame_id", str, at), take(each, "child_frame_id", str, at)
        parent, child = (name.removesuffix(FRAME) for name in (parent, child))
        if not places:
            places[parent] = np.eye(4)
        if parent not in places:
            raise FormatError(
                f"{at}: the frame {parent} is none of those before ({', '.join(places)}); put it after its own"
            )
        T = _motion(take(each, "transform", dict, at), at)
        places[child] = np.linalg.inv(T) @ places[parent]
    if lost := [name for name in cameras if name not in places]:
        raise FormatError(
            f"{where}: has no frame of {', '.join(lost)} ({lost[0]}{FRAME} or {lost[0]}); it has {', '.join(places)}"
        )
    mine = [name for name in places if name in cameras]
    if not mine:
        raise FormatError(f"{where}: is of no camera; give the cameras' camera_info files, too")
    return Rig(tuple(mine), tuple(cameras[n] for n in mine), tuple(Pose(places[n]) for n in mine))


def _motion(record: dict[str, Any], where: str) -> Array:
    """The matrix (4, 4) of a geometry_msgs/Transform."""
    from scipy.spatial.transform import Rotation

    t, q = take(record, "translation", dict, where), take(record, "rotation", dict, where)
    shift = numbers({"translation": [t.get(n) for n in "xyz"]}, "translation", where, finite=True, shape=(3,))
    turn = numbers({"rotation": [q.get(n) for n in "xyzw"]}, "rotation", where, finite=True, shape=(4,))
    if not np.isclose(np.linalg.norm(turn), 1, atol=1e-3):
        raise FormatError(f"{where}: 'rotation' must be a unit quaternion; export it again")
    return motion(Rotation.from_quat(turn).as_matrix(), shift)
