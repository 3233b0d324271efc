"""COLMAP's rig_config.json, as read by its `rig_configurator` and by pycolmap: one rig with its lenses and sensor
poses.

COLMAP takes the image size of a camera from its pictures. This module adds the fields `width` and `height`, which
COLMAP ignores, so that the file can be read back.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.errors import FormatError, said_of
from rcdn.geometry.rigid import motion
from rcdn.io.cameras import colmap
from rcdn.io.fields import numbers, take
from rcdn.types import Array, Camera, Pose, Rig


def text(names: Sequence[str], cameras: Sequence[Camera], places: Sequence[Array]) -> str:
    """The file's text; pictures of a camera are in the folder of its name, and the first camera is the reference
    sensor. `places`: T_cam_rig (4, 4) of each camera."""
    from scipy.spatial.transform import Rotation  # imported late: detection must not load it

    first = np.linalg.inv(places[0])
    sensors = []
    for k, (name, camera, T) in enumerate(zip(names, cameras, places, strict=True)):
        with said_of(f"camera {name}", FormatError):
            model, params = colmap.model_and_params(camera)
        sensor: dict[str, Any] = {"image_prefix": f"{name}/"}
        if k:
            T_cam_ref = T @ first
            x, y, z, w = Rotation.from_matrix(T_cam_ref[:3, :3]).as_quat().tolist()
            sensor |= {"cam_from_rig_rotation": [w, x, y, z], "cam_from_rig_translation": T_cam_ref[:3, 3].tolist()}
        else:
            sensor["ref_sensor"] = True
        width, height = camera.image_size
        sensors.append(sensor | {"camera_model_name": model, "camera_params": params, "width": width, "height": height})
    return json.dumps([{"cameras": sensors}], indent=2, ensure_ascii=False) + "\n"


def rig_of(data: Any, where: str) -> Rig:
    """The rig in a file's data. Raises FormatError if there are several rigs, or a camera has no lens, pose or size."""
    if not isinstance(data, list) or len(data) != 1:
        many = len(data) if isinstance(data, list) else 0
        raise FormatError(f"{where}: holds {many} rigs; rcdn reads a rig_config.json of one")
    names, cameras, places = [], [], []
    for k, sensor in enumerate(take(data[0], "cameras", list, where)):
        at = f"{where}: cameras[{k}]"
        name = take(sensor, "image_prefix", str, at).rstrip("/").rpartition("/")[2] or f"cam{k}"
        lost = [key for key in ("camera_model_name", "camera_params", "width", "height") if key not in sensor]
        if lost:
            raise FormatError(
                f"{at} ({name}) has no {' and no '.join(lost)}; add the lens (and the size of its pictures, px), as "
                "`rcdn calibrate --rig -o rig_config.json` writes them"
            )
        names.append(name)
        cameras.append(_camera(sensor, at))
        places.append(Pose(np.eye(4) if sensor.get("ref_sensor") is True else _place(sensor, at)))
    return Rig(tuple(names), tuple(cameras), tuple(places))


def _camera(sensor: dict[str, Any], where: str) -> Camera:
    params = np.ravel(numbers(sensor, "camera_params", where, finite=True)).tolist()
    size = [str(take(sensor, key, int, where)) for key in ("width", "height")]
    return colmap.camera_of(["1", take(sensor, "camera_model_name", str, where), *size, *map(repr, params)], where)


def _place(sensor: dict[str, Any], where: str) -> Array:
    from scipy.spatial.transform import Rotation

    w, x, y, z = numbers(sensor, "cam_from_rig_rotation", where, finite=True, shape=(4,)).tolist()
    t = numbers(sensor, "cam_from_rig_translation", where, finite=True, shape=(3,))
    if not np.isclose(np.linalg.norm([w, x, y, z]), 1, atol=1e-3):
        raise FormatError(f"{where}: 'cam_from_rig_rotation' must be a unit quaternion (w, x, y, z); export it again")
    return motion(Rotation.from_quat([x, y, z, w]).as_matrix(), t)
