"""OpenCV's two detectors: the classic one with cornerSubPix, and findChessboardCornersSB. Both need the board's
size."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer, lattice

HALF = 5
"""px: half side of cornerSubPix' window of 11 × 11"""
UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)


def classic(image: Array, size: tuple[int, int]) -> list[Grid]:
    """findChessboardCorners with its default flags, then cornerSubPix."""
    found, corners = cv2.findChessboardCorners(image, size)
    if not found or corners is None:
        return []
    refined = cv2.cornerSubPix(image, np.asarray(corners, np.float32), (HALF, HALF), (-1, -1), UNTIL)
    return [Grid(refined.reshape(-1, 2).astype(float), lattice(size))]


def sb(image: Array, size: tuple[int, int]) -> list[Grid]:
    """findChessboardCornersSB without flags."""
    found, corners = cv2.findChessboardCornersSB(image, size, flags=0)
    if not found or corners is None:
        return []
    return [Grid(np.asarray(corners, float).reshape(-1, 2), lattice(size))]


def _load_classic() -> Find:
    cv2.setNumThreads(1)
    return classic


def _load_sb() -> Find:
    cv2.setNumThreads(1)
    return sb


CLASSIC = Peer("opencv", "given", lambda: None, lambda: cv2.__version__, _load_classic)
SB = Peer("opencv-sb", "given", lambda: None, lambda: cv2.__version__, _load_sb)
