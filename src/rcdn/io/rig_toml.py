"""Rigs as TOML: the files of aniposelib and of caliscope."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from rcdn.errors import FormatError, said_of
from rcdn.geometry.rigid import motion, rotation_vector
from rcdn.io.cameras.base import opencv_camera, pinhole_numbers
from rcdn.io.cameras.yaml_text import flow
from rcdn.io.fields import numbers, rigid, two_whole_numbers
from rcdn.types import Array, Camera, Pose, Rig


def text(names: tuple[str, ...], cameras: list[Camera], places: list[Array], nested: bool) -> str:
    """The text of aniposelib's file with a table `cam_K` for each camera, or (`nested`) of caliscope's with tables
    `cameras.K`, in which cameras have numbers instead of names: their names, where all of these are numbers."""
    ids = names if all(map(_is_number, names)) else tuple(map(str, range(len(names))))
    width = len(str(len(names) - 1))
    lines = "" if nested else "[metadata]\nadjusted = false\nerror = 0.0\n"
    for k, (name, camera, T) in enumerate(zip(names, cameras, places, strict=True)):
        with said_of(f"camera {name}", FormatError):
            d = _distortion(camera)
        table = f"cameras.{ids[k]}" if nested else f"cam_{k:0{width}}"
        head = f"cam_id = {ids[k]}" if nested else f"name = {_quoted(name)}"
        lines += (
            f"\n[{table}]\n{head}\nsize = [{camera.image_size[0]}, {camera.image_size[1]}]\n"
            f"matrix = [{', '.join(flow(row) for row in camera.K)}]\ndistortions = {flow(d)}\n"
            f"rotation = {flow(rotation_vector(T[:3, :3]))}\ntranslation = {flow(T[:3, 3])}\n"
            f"fisheye = {'true' if camera.model == 'fisheye' else 'false'}\n"
        )
    return lines.lstrip()


def _distortion(camera: Camera) -> Array:
    title = "TOML of aniposelib and caliscope"
    pinhole_numbers(camera, title)
    if camera.model == "division":
        raise FormatError(f"{title} has no lens model for 'division' cameras; write json")
    d = camera.distortion
    return np.pad(d, (0, 5 - len(d))) if len(d) < 5 and camera.model != "fisheye" else d


def _is_number(name: str) -> bool:
    """Whether `name` is a number as caliscope's files have it."""
    return name.isdecimal() and len(name) < 10 and str(int(name)) == name


def _quoted(name: str) -> str:
    """A basic string of TOML, which has the same escapes as JSON."""
    return json.dumps(name)


def rig_of(text: str, where: str) -> Rig:
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
        cameras[str(name)] = opencv_camera(at, K, d, size, fisheye=record.get("fisheye") is True)
        poses.append(Pose(_place(record, at)))
    if not poses:
        raise FormatError(f"{where}: holds no camera with a place; give a TOML of aniposelib or caliscope")
    return Rig(tuple(cameras), tuple(cameras.values()), tuple(poses))


def _list(record: dict[str, Any], key: str, where: str) -> Array:
    return np.ravel(numbers(record, key, where, finite=True))


def _place(record: dict[str, Any], where: str) -> Array:
    """T_cam_rig (4, 4) from a rotation vector, or from a rotation matrix as in older files of caliscope."""
    turn, t = _list(record, "rotation", where), _list(record, "translation", where)
    if len(turn) not in (3, 9) or len(t) != 3:
        raise FormatError(f"{where}: 'rotation' must hold 3 or 9 numbers and 'translation' 3; export the file again")
    T = motion(cv2.Rodrigues(turn)[0] if len(turn) == 3 else turn.reshape(3, 3), t)
    return rigid({"rotation": T.tolist()}, "rotation", where)
