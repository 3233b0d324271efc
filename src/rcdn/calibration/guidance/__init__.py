"""Guided calibration: the next picture that helps most, which frames to take, and when it is enough."""

from rcdn.calibration.guidance.guide import Guide, Look
from rcdn.calibration.guidance.progress import Progress

__all__ = ["Guide", "Look", "Progress"]
