"""Calibration of cameras, pairs and rigs from detected boards, and estimation of board poses."""

from rcdn.calibration.behind import from_behind
from rcdn.calibration.calibrate import MODELS, calibrate
from rcdn.calibration.pose import estimate_pose
from rcdn.calibration.rig import calibrate_rig
from rcdn.calibration.rig_pose import estimate_rig_pose
from rcdn.calibration.stereo import calibrate_stereo
from rcdn.calibration.uncertainty import coverage, projection_uncertainty

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
