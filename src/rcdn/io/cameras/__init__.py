"""Reading and writing camera files: OpenCV, ROS, Kalibr, COLMAP, mrcal and rcdn's JSON (docs/formats.md)."""

from rcdn.io.cameras.base import LensFit
from rcdn.io.cameras.files import (
    camera_names,
    check_lens,
    is_rig,
    lens_fit,
    name_in,
    noted,
    read_camera,
    read_cameras,
    read_stereo,
    stereo_paths,
    write_camera,
    write_stereo,
)
from rcdn.io.cameras.formats import FORMATS, CameraFormat, camera_format, names_of, parsed
from rcdn.io.cameras.rig import Rectification, StereoCameras

__all__ = [
    "FORMATS",
    "CameraFormat",
    "LensFit",
    "Rectification",
    "StereoCameras",
    "camera_format",
    "camera_names",
    "check_lens",
    "is_rig",
    "lens_fit",
    "name_in",
    "names_of",
    "noted",
    "parsed",
    "read_camera",
    "read_cameras",
    "read_stereo",
    "stereo_paths",
    "write_camera",
    "write_stereo",
]
