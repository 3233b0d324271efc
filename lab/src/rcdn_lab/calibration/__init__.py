"""Calibration accuracy with the corners of several detectors: one solver, the same pictures, public sets of
photographs."""

from rcdn_lab.calibration.detectors import DETECTORS, Contestant, Store, contestants
from rcdn_lab.calibration.run import markdown, settings_of, table
from rcdn_lab.calibration.sets import SETS, CameraSet, chosen, parse

__all__ = [
    "DETECTORS",
    "SETS",
    "CameraSet",
    "Contestant",
    "Store",
    "chosen",
    "contestants",
    "markdown",
    "parse",
    "settings_of",
    "table",
]
