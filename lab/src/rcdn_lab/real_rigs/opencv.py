"""OpenCV 5's `calibrateMultiview` on given corners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from rcdn.errors import CalibrationError
from rcdn.types import Camera, Pose, Rig
from rcdn_lab.real_rigs.sets import Shots

MISSING = -1.0
"""how it is told that a corner wasn't seen"""
FEWEST = 4
"""corners of a view that it is given, where it is given parts"""


def opencvs(shots: Shots, spacing: float, parts: bool = False) -> Rig:
    """The rig of all cameras, with the lens k1 k2 p1 p2 k3; the first camera's frame. It is given whole boards,
    or those seen in `parts`, too.

    Raises CalibrationError with OpenCV's own words, or if what it gives is no rig.
    """
    names, moments = list(shots.boards), shots.moments
    labels = sorted({tuple(x) for each in shots.boards.values() for b in each.values() for x in b.ij.tolist()})
    number = {x: k for k, x in enumerate(labels)}
    points = np.column_stack([np.array(labels) * spacing, np.zeros(len(labels))]).astype(np.float32)
    seen = np.zeros((len(names), len(moments)), np.uint8)
    xy = np.full((len(names), len(moments), len(labels), 2), MISSING, np.float32)
    for c, name in enumerate(names):
        for m, moment in enumerate(moments):
            board = shots.boards[name].get(moment)
            if board is not None and len(board) >= (FEWEST if parts else len(labels)):
                seen[c, m] = 255
                xy[c, m, [number[tuple(x)] for x in board.ij.tolist()]] = board.xy
    sizes = [next(iter(shots.boards[name].values())).image_size for name in names]
    models = np.full(len(names), cv2.CALIB_MODEL_PINHOLE, np.uint8)
    solve: Any = cv2.calibrateMultiview  # its stub wants lists where None lets OpenCV begin by itself
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    try:
        _, Ks, distortions, Rs, Ts = solve(
            [points] * len(moments), [list(each) for each in xy], sizes, seen, models, None, None, None, None
        )
    except (cv2.error, TypeError) as error:
        raise CalibrationError(" ".join(str(error).split())) from error
    finally:
        cv2.utils.logging.setLogLevel(level)
    return _rig(names, sizes, Ks, distortions, Rs, Ts)


def _rig(names: Sequence[str], sizes: Sequence[tuple[int, int]], Ks: Any, distortions: Any, Rs: Any, Ts: Any) -> Rig:
    cameras, poses = [], []
    for K, d, R, t, size in zip(Ks, distortions, Rs, Ts, sizes, strict=True):
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(np.array(R, float))[0] if np.size(R) == 3 else R
        T[:3, 3] = np.ravel(t)
        if not np.isfinite(T).all() or not np.isfinite(K).all():
            raise CalibrationError("numbers that aren't finite")
        cameras.append(Camera(np.asarray(K, float), np.ravel(d)[:5], size))
        poses.append(Pose(T))
    return Rig(tuple(names), tuple(cameras), tuple(poses))
