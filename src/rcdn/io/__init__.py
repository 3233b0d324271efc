"""Reading and writing files: pictures and videos, detections as JSON, corners.vnl, cameras and calibrations. All public
names of the package are exported here."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rcdn.io.files import STDOUT, check_writable, is_video, write_bytes, write_chunks, write_text
from rcdn.io.finding import expand, find
from rcdn.io.formats import (
    FormatError,
    ImageResult,
    image_line,
    image_of_line,
    read_detections,
    write_detections,
    write_lines,
)
from rcdn.io.images import as_grey, colour_frames, frames, grey_of, read_image, read_pixels, write_image

if TYPE_CHECKING:
    from rcdn.io.calibration import read_calibration, read_stereo_calibration, write_calibration
    from rcdn.io.calibrations import read_calibrations
    from rcdn.io.cameras import (
        CameraFormat,
        LensFit,
        Rectification,
        StereoCameras,
        camera_format,
        check_lens,
        lens_fit,
        read_camera,
        read_cameras,
        read_stereo,
        stereo_paths,
        write_camera,
        write_stereo,
    )
    from rcdn.io.maps import write_maps, write_stereo_maps
    from rcdn.io.rig_calibration import read_rig_calibration, write_rig_calibration
    from rcdn.io.rig_files import RigFormat, check_rig, read_rig, rig_format, rig_paths, write_rig
    from rcdn.io.table import write_csv
    from rcdn.io.vnl import read_vnl, read_vnl_boards, write_vnl

__all__ = [
    "STDOUT",
    "CameraFormat",
    "FormatError",
    "ImageResult",
    "LensFit",
    "Rectification",
    "RigFormat",
    "StereoCameras",
    "as_grey",
    "camera_format",
    "check_lens",
    "check_rig",
    "check_writable",
    "colour_frames",
    "expand",
    "find",
    "frames",
    "grey_of",
    "image_line",
    "image_of_line",
    "is_video",
    "lens_fit",
    "read_calibration",
    "read_calibrations",
    "read_camera",
    "read_cameras",
    "read_detections",
    "read_image",
    "read_pixels",
    "read_rig",
    "read_rig_calibration",
    "read_stereo",
    "read_stereo_calibration",
    "read_vnl",
    "read_vnl_boards",
    "rig_format",
    "rig_paths",
    "stereo_paths",
    "write_bytes",
    "write_calibration",
    "write_camera",
    "write_chunks",
    "write_csv",
    "write_detections",
    "write_image",
    "write_lines",
    "write_maps",
    "write_rig",
    "write_rig_calibration",
    "write_stereo",
    "write_stereo_maps",
    "write_text",
    "write_vnl",
]

_HOMES = {
    "calibration": ("read_calibration", "read_stereo_calibration", "write_calibration"),
    "calibrations": ("read_calibrations",),
    "cameras": (
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
        "stereo_paths",
        "write_camera",
        "write_stereo",
    ),
    "maps": ("write_maps", "write_stereo_maps"),
    "rig_calibration": ("read_rig_calibration", "write_rig_calibration"),
    "rig_files": ("RigFormat", "check_rig", "read_rig", "rig_format", "rig_paths", "write_rig"),
    "table": ("write_csv",),
    "vnl": ("read_vnl", "read_vnl_boards", "write_vnl"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what reads and writes cameras, calibrations and tables at its first use: detection needs none of it."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'rcdn.io' has no attribute {name!r}")
    return getattr(import_module(f"rcdn.io.{_HOME_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
