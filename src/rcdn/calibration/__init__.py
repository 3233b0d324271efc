"""Calibration of cameras, pairs and rigs from detected boards, and estimation of board poses."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rcdn.calibration.behind import from_behind
from rcdn.calibration.calibrate import MODELS, calibrate
from rcdn.calibration.uncertainty import coverage, projection_uncertainty

if TYPE_CHECKING:
    from rcdn.calibration.pose import estimate_pose
    from rcdn.calibration.rig import calibrate_rig
    from rcdn.calibration.rig_pose import estimate_rig_pose
    from rcdn.calibration.stereo import calibrate_stereo

__all__ = [
    "MODELS",
    "calibrate",
    "calibrate_rig",
    "calibrate_stereo",
    "coverage",
    "estimate_pose",
    "estimate_rig_pose",
    "from_behind",
    "projection_uncertainty",
]

_HOMES = {
    "calibrate_rig": "rig",
    "calibrate_stereo": "stereo",
    "estimate_pose": "pose",
    "estimate_rig_pose": "rig_pose",
}


def __getattr__(name: str) -> Any:
    """Import what pairs, rigs and poses need at its first use: the calibration of one camera needs none of it."""
    if name not in _HOMES:
        raise AttributeError(f"module 'rcdn.calibration' has no attribute {name!r}")
    return getattr(import_module(f"rcdn.calibration.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
