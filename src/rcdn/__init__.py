"""rcdn: robust and precise checkerboard corners. Finds X-corners, recovers the boards, needs no board size."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rcdn.provided import provide_camera_work

if TYPE_CHECKING:
    from rcdn.calibration import calibrate as calibrate
    from rcdn.calibration import calibrate_rig as calibrate_rig
    from rcdn.calibration import calibrate_stereo as calibrate_stereo
    from rcdn.calibration import estimate_pose as estimate_pose
    from rcdn.config import DetectorConfig as DetectorConfig
    from rcdn.detector import Detection as Detection
    from rcdn.detector import Detector as Detector
    from rcdn.errors import RcdnError as RcdnError
    from rcdn.io import read_image as read_image
    from rcdn.opencv import detect_charuco as detect_charuco
    from rcdn.opencv import find_chessboard_corners as find_chessboard_corners
    from rcdn.types import Board as Board
    from rcdn.types import Calibration as Calibration
    from rcdn.types import Camera as Camera
    from rcdn.types import Corners as Corners
    from rcdn.types import Pose as Pose

__version__ = "0.1.0"

_HOMES = {
    "Board": "types",
    "Calibration": "types",
    "Camera": "types",
    "Corners": "types",
    "Detection": "detector",
    "Detector": "detector",
    "DetectorConfig": "config",
    "Pose": "types",
    "RcdnError": "errors",
    "calibrate": "calibration",
    "calibrate_rig": "calibration",
    "calibrate_stereo": "calibration",
    "detect_charuco": "opencv",
    "estimate_pose": "calibration",
    "find_chessboard_corners": "opencv",
    "read_image": "io",
}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name: str) -> Any:
    """Import a public name at its first use, so that `import rcdn` itself loads nothing heavy."""
    if name not in _HOMES:
        raise AttributeError(f"module 'rcdn' has no attribute {name!r}")
    return getattr(import_module(f"rcdn.{_HOMES[name]}"), name)


def _camera_work() -> Any:
    return import_module("rcdn.camera_work")


provide_camera_work(_camera_work)


def __dir__() -> list[str]:
    return sorted(__all__)
