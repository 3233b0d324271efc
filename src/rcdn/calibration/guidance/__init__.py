"""Guided calibration: the most informative next picture, which frames to take, and when the calibration is
sufficient."""

from rcdn.calibration.guidance.guide import Guide, Look
from rcdn.calibration.guidance.pair_guide import PairGuide, PairLook
from rcdn.calibration.guidance.pair_progress import PairProgress
from rcdn.calibration.guidance.progress import Progress

__all__ = ["Guide", "Look", "PairGuide", "PairLook", "PairProgress", "Progress"]
