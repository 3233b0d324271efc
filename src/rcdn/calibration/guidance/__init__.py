"""Guided calibration: the most informative next picture, which frames to take, and when the calibration is
sufficient."""

from rcdn.calibration.guidance.guide import Guide, Look
from rcdn.calibration.guidance.progress import Progress

__all__ = ["Guide", "Look", "Progress"]
