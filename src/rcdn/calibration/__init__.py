"""Cameras and poses from boards."""

from rcdn.calibration.calibrate import MODELS, calibrate
from rcdn.calibration.uncertainty import coverage, projection_uncertainty

__all__ = ["MODELS", "calibrate", "coverage", "projection_uncertainty"]
