"""The HTML report of a calibration: whether the result is reliable, and if not, why."""

from rcdn.report.calibration.page import write_report
from rcdn.report.calibration.rig import write_rig_report
from rcdn.report.calibration.stereo import write_stereo_report

__all__ = ["write_report", "write_rig_report", "write_stereo_report"]
