"""A detector that finds what a picture's first pixels say: for tests of the command line,
in its own and in other processes."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from rcdn.errors import DependencyError
from rcdn.types import Board, Corners

BROKEN, STOP, KILL, KILL_ONCE, SLOW, LIMITED = 255, 254, 253, 252, 251, 40
LIMIT = ("too many", "far too many")
MARKS = "RCDN_TEST_MARKS"
"""names the folder where a detector leaves a file for each thing that happened"""


BEFORE_DEATH = 0.5
"""seconds that a picture is computed before it kills its process; meanwhile the result of the picture before arrives"""


@dataclass
class Found:
    corners: Corners
    boards: list[Board]
    warnings: tuple[str, ...] = ()


class StandIn:
    """Finds what the picture's first pixels say: columns, rows, and how many corners are missing.

    0 columns: no board. BROKEN: an unexpected error. STOP: the user presses Ctrl-C. KILL: this process is killed;
    KILL_ONCE: only the first that sees the picture; SLOW: it takes a minute. LIMITED corners missing: it warns.
    """

    def __init__(self, config) -> None:
        self.config = config

    def detect(self, image):
        cols, rows, missing = (int(v) for v in image[0, :3])
        first = mark(f"{cols} {rows} {missing}")
        if cols == BROKEN:
            raise ValueError("a bug\nof two lines")
        if cols == STOP:
            raise KeyboardInterrupt
        if cols == KILL or (cols == KILL_ONCE and first):
            time.sleep(BEFORE_DEATH)
            os.kill(os.getpid(), signal.SIGKILL)
        if cols == SLOW:
            time.sleep(60)
        ij = np.array([(i, j) for j in range(rows) for i in range(cols)]).reshape(-1, 2)
        keep = np.setdiff1d(np.arange(len(ij)), 1 + np.arange(missing))  # the first and the last row stay
        boards = [make_board(ij[keep], image.shape[::-1])] if len(ij) and cols < SLOW else []
        xy = np.concatenate([np.array([[50.0, 60.0]]), *(b.xy for b in boards)])
        return Found(
            Corners(xy, np.ones(len(xy)), np.zeros(len(xy)), sigma=np.full(len(xy), 1 / 3)),
            boards,
            LIMIT * (missing == LIMITED),
        )


def mark(what: str) -> bool:
    """Leave a mark that this happened in this process; True if it's the first of all processes."""
    folder = os.environ.get(MARKS)
    if not folder:
        return False
    first = not list(Path(folder).glob(f"{what} *"))
    Path(folder, f"{what} {os.getpid()} {time.monotonic_ns()}").touch()
    return first


def make_board(ij, wh):
    return Board(5.0 + 7.1 / 3 * np.array(ij), ij, tuple(wh), np.ones(len(ij)), np.zeros(len(ij)), "unique")


def picture(path: Path, cols=9, rows=6, missing=0) -> Path:
    """Write a picture in which the stand-in finds this."""
    image = np.full((80, 100), 100, np.uint8)
    image[0, :3] = cols, rows, missing
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


class BrightSquare:
    """Finds a board of 4 × 3 corners where the picture is bright, and none in a dark one:
    for videos, which change pixels."""

    def __init__(self, config) -> None:
        self.config = config

    def detect(self, image):
        mark("look")
        y, x = np.nonzero(image > 128)
        if not len(x):
            return Found(Corners(np.zeros((0, 2)), [], []), [])
        ij = np.array([(i, j) for j in range(3) for i in range(4)])
        low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
        xy = low + (high - low) * (ij + 0.5) / [4, 3]
        board = Board(xy, ij, image.shape[::-1], np.ones(12), np.zeros(12), "unique", np.full(12, 1 / 30))
        return Found(Corners(xy, np.ones(12), np.zeros(12)), [board])


class NoDetector:
    """A detector that can't be made."""

    def __init__(self, config) -> None:
        raise DependencyError("onnxruntime is missing:\ninstall it")


def ends_at_once(config):
    """Kills the process that should make a detector."""
    os.kill(os.getpid(), signal.SIGKILL)


def video(path: Path, places) -> Path:
    """Write a video of 160 × 120 with a bright square of 40 × 30 px at each of `places` (x, y); None: a dark frame."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (160, 120))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no video")
    for place in places:
        frame = np.full((120, 160, 3), 20, np.uint8)
        if place is not None:
            x, y = place
            frame[y : y + 30, x : x + 40] = 230
        writer.write(frame)
    writer.release()
    return path
