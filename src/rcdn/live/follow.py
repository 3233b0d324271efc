"""Tracking of the board through the frames: occasional detection in reduced pictures, optical flow in between."""

from __future__ import annotations

import itertools
import os
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace

import cv2
import numpy as np

from rcdn.types import Array, Board

SMALL = 640
"""longer side of the reduced pictures for detection and tracking, px"""
REST = 1.0
"""pause after a detection while a board is tracked, as a multiple of the detection's time"""
NICENESS = 5
"""niceness of threads whose results are not needed within a frame"""
WINDOW, LEVELS = 15, 3
BACK = 0.7
"""largest forward–backward error of a tracked corner, px of the reduced picture"""
KEPT = 0.85
"""smallest share of a board's corners that must be tracked successfully"""
WAITING = 40
"""largest number of reduced pictures kept during a detection"""

Detect = Callable[[Array, bool], Board | None]
"""function that detects the largest board in a grey picture; True: thorough detection, also at other scales"""


class Follower:
    """Tracks the largest board; `detect` runs in a separate thread, on one picture at a time."""

    def __init__(self, detect: Detect) -> None:
        self._detect = detect
        self._worker = ThreadPoolExecutor(1, "detection", initializer=yielding)
        self._running: Future[tuple[Board | None, float]] | None = None
        self._since: list[Array] = []
        self._board: Board | None = None
        self._small: Array | None = None
        self._missed, self._rest_until = 0, 0.0

    def close(self) -> None:
        """End the thread."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def see(self, grey: Array) -> Board | None:
        """The board in the next frame (H, W) uint8, with positions in the frame's pixels; None if there is none or it
        hasn't been detected yet."""
        small, scale = _small(grey)
        if self._small is not None and self._small.shape != small.shape:
            self._forget()
        if self._board is not None and self._small is not None:
            self._board = followed(self._small, small, self._board)
        self._small = small
        self._since.append(small)
        self._collect()
        self._start_detection(small)
        return None if self._board is None else _enlarged(self._board, scale, (grey.shape[1], grey.shape[0]))

    def _forget(self) -> None:
        self._board, self._small, self._since = None, None, []
        if self._running is not None:
            self._running.cancel()
            self._running = None

    def _start_detection(self, small: Array) -> None:
        """Start a detection if none is running and the pause is over."""
        if self._running is None and (self._board is None or time.monotonic() >= self._rest_until):
            self._since = [small]
            self._running = self._worker.submit(self._timed, small, self._missed % 2 == 1)

    def _timed(self, small: Array, closely: bool) -> tuple[Board | None, float]:
        begin = time.monotonic()
        return self._detect(small, closely), time.monotonic() - begin

    def _collect(self) -> None:
        """Take the result of a finished detection, tracked through the pictures that have arrived since its start."""
        if self._running is None or not self._running.done():
            return
        found, took = self._running.result()
        self._running = None
        self._rest_until = time.monotonic() + REST * took
        if found is None:
            self._missed += 1
            if self._missed >= 2:
                self._board = None
            return
        self._missed = 0
        pictures = self._since if len(self._since) <= WAITING else []
        board: Board | None = found if pictures else None
        for before, after in itertools.pairwise(pictures):
            board = None if board is None else followed(before, after, board)
        self._board = board


def yielding() -> None:
    """Lower the scheduling priority of this thread (on Linux only, where each thread has its own priority)."""
    if sys.platform == "linux":
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)


def followed(before: Array, after: Array, board: Board) -> Board | None:
    """`board` of the picture `before` tracked to the picture `after` (H, W) uint8, without the corners that can't be
    tracked; None if these are too many."""
    start = board.xy.astype(np.float32).reshape(-1, 1, 2)
    settings = {"winSize": (WINDOW, WINDOW), "maxLevel": LEVELS}
    there, ok, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        before, after, start, np.zeros_like(start), **settings
    )
    back, ok_back, _ = cv2.calcOpticalFlowPyrLK(  # type: ignore[call-overload]
        after, before, there, np.zeros_like(start), **settings
    )
    off = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    xy = there.reshape(-1, 2).astype(float)
    inside = ((xy >= 0) & (xy <= np.array(after.shape[::-1]) - 1)).all(axis=1)
    good = (ok[:, 0] == 1) & (ok_back[:, 0] == 1) & (off < BACK) & inside
    if good.mean() < KEPT or good.sum() < 4:
        return None
    pick = lambda a: None if a is None else a[good]  # noqa: E731
    return replace(
        board, xy=xy[good], ij=board.ij[good], response=board.response[good], status=board.status[good],
        sigma=pick(board.sigma), ids=pick(board.ids),
    )  # fmt: skip


def _small(grey: Array) -> tuple[Array, float]:
    """The picture reduced to at most SMALL px on its longer side, and the scale from original to reduced pixels."""
    scale = min(1.0, SMALL / max(grey.shape))
    if scale == 1:
        return grey, 1.0
    return cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), scale


def _enlarged(board: Board, scale: float, image_size: tuple[int, int]) -> Board:
    """A board of the reduced picture converted to pixels of the original one."""
    sigma = None if board.sigma is None else board.sigma / scale
    return replace(board, xy=(board.xy + 0.5) / scale - 0.5, sigma=sigma, image_size=image_size)
