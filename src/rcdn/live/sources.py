"""Cameras that the server reads itself: one of this computer, one on the network, or a video file."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import cv2

from rcdn.errors import ConfigError, ImageError
from rcdn.io import is_video
from rcdn.io.quiet import quiet_opencv
from rcdn.types import Array

BROWSER = "browser"
"""stands for the page's own camera, which is not a source of the server"""
AGAIN = 2.0
"""s: pause before a camera that has stopped is opened again"""
WAIT = 1.0
"""s: longest time that `read` waits for a frame"""
APART = 0.04
"""s: largest difference of the arrival times of two cameras' pictures that count as of one moment: a frame at 25
pictures a second"""
WIDTH, HEIGHT = 1280, 720
"""px: size requested from a camera of this computer"""
RATE = 25.0
"""frames per second, assumed for a file without a valid rate"""


Read = tuple[tuple[Array, ...], float]
"""a frame of each camera, and their time, s"""


class Source(Protocol):
    """`read` returns the next frame (H, W) or (H, W, 3) BGR uint8 of each camera and their time, s, or None if there is
    none at present; it may block for about a second. `trouble` is the reason why there is none, "" if there is no
    problem."""

    trouble: str

    def read(self) -> Read | None: ...
    def close(self) -> None: ...


def check_source(text: str) -> None:
    """Raise ConfigError unless `text` is `browser`, a camera's number, an address rtsp://… or an existing video."""
    if text == BROWSER or re.fullmatch(r"\d{1,2}", text) or re.match(r"rtsps?://\S", text):
        return
    if not is_video(text):
        raise ConfigError(
            f"--camera {text}: give `{BROWSER}`, the number of a camera of this computer (0, 1, …), "
            "an address rtsp://…, or a video file"
        )
    if not Path(text).is_file():
        raise ConfigError(f"--camera {text}: no such file; check the path")


def open_source(text: str) -> Source | None:
    """The source named by `text`, which `check_source` has accepted; None for the browser's camera."""
    if text == BROWSER:
        return None
    if _is_file(text):
        return VideoFile(text)
    return Camera(int(text) if text.isdigit() else text)


def open_pair(cameras: Sequence[str]) -> Source | None:
    """The source of two cameras, each named as in `open_source`, or of one whose pictures hold both side by side; None
    for the browser's cameras.

    Raises ConfigError if one of two is the browser's, or a video file and the other one isn't.
    """
    kinds = ["browser" if c == BROWSER else "file" if _is_file(c) else "camera" for c in cameras]
    if len(cameras) > 2 or len(set(kinds)) > 1:
        raise ConfigError(
            f"--camera {' --camera '.join(cameras)}: with --stereo two cameras of one kind, LEFT and RIGHT: both of "
            "this computer or the network, or two video files; or one whose pictures hold both side by side"
        )
    if kinds[0] == "browser":
        return None
    if len(cameras) == 2 and cameras[0] == cameras[1]:
        raise ConfigError(
            f"--camera {cameras[0]} is given twice; for one whose pictures hold both side by side give it once"
        )
    sources = [source for c in cameras if (source := open_source(c)) is not None]
    if len(sources) == 1:
        return Halves(sources[0])
    if kinds[0] == "file":
        return TwoFiles(sources[0], sources[1])
    return TwoCameras(sources[0], sources[1])


def _is_file(text: str) -> bool:
    return is_video(text) and not text.startswith("rtsp")


class VideoFile:
    """All frames of a video, at most at its frame rate. After the last one, `read` returns None."""

    def __init__(self, path: str) -> None:
        with quiet_opencv():
            self._video = cv2.VideoCapture(path)
        rate = float(self._video.get(cv2.CAP_PROP_FPS))
        self._step = 1 / (rate if 1 <= rate <= 240 else RATE)
        self._count, self._begin = 0, 0.0
        self.trouble = ""

    def read(self) -> Read | None:
        if not self._count:
            self._begin = time.monotonic()
        at = self._count * self._step
        early = self._begin + at - time.monotonic()
        if early > 0:
            time.sleep(min(early, WAIT))
        else:
            self._begin -= early  # don't catch up after a delay
        with quiet_opencv():
            there, frame = self._video.read()
        if not there:
            self.trouble = "The video has ended" if self._count else "The video can't be opened, or holds no frame"
            time.sleep(WAIT)
            return None
        self._count += 1
        return (frame,), at

    def close(self) -> None:
        self._video.release()


class Camera:
    """The newest frame of a camera: a thread reads all frames, so that `read` never returns an outdated one. A camera
    that stops is opened again."""

    def __init__(self, place: int | str) -> None:
        self._place = place
        self._new = threading.Condition()
        self._frame: Read | None = None
        self._ended = False
        self.trouble = "Opening the camera"
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> Read | None:
        with self._new:
            if self._frame is None:
                self._new.wait(WAIT)
            frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        self._ended = True
        self._thread.join(WAIT)

    def _run(self) -> None:
        while not self._ended:
            try:
                self._read_all()
            except (cv2.error, ImageError) as error:
                self.trouble = f"The camera can't be read ({type(error).__name__})"
            for _ in range(round(AGAIN / 0.1)):
                if not self._ended:
                    time.sleep(0.1)

    def _read_all(self) -> None:
        with quiet_opencv():
            video = cv2.VideoCapture(self._place)
        try:
            if isinstance(self._place, int):
                video.set(cv2.CAP_PROP_FRAME_WIDTH, WIDTH)
                video.set(cv2.CAP_PROP_FRAME_HEIGHT, HEIGHT)
            while not self._ended:
                with quiet_opencv():
                    there, frame = video.read()
                if not there:
                    self.trouble = (
                        "The camera gives no pictures; check that it is connected, and that no other program uses it"
                    )
                    return
                self.trouble = ""
                with self._new:
                    self._frame = ((frame,), time.monotonic())
                    self._new.notify_all()
        finally:
            video.release()


class _Two:
    """Two sources that are read together."""

    def __init__(self, left: Source, right: Source) -> None:
        self._left, self._right = left, right
        self.trouble = ""

    def close(self) -> None:
        self._left.close()
        self._right.close()

    def _name_trouble(self) -> None:
        sides = (("Left", self._left), ("Right", self._right))
        self.trouble = next((f"{side} camera: {s.trouble}" for side, s in sides if s.trouble), "")


class TwoFiles(_Two):
    """Frames of two videos with the same number, until the shorter one ends."""

    def read(self) -> Read | None:
        left = self._left.read()
        right = None if left is None else self._right.read()
        self._name_trouble()
        return None if left is None or right is None else (left[0] + right[0], left[1])


class TwoCameras(_Two):
    """The newest frames of two cameras that arrived at most APART s after one another; others are left out."""

    def __init__(self, left: Source, right: Source) -> None:
        super().__init__(left, right)
        self._waiting: list[Read | None] = [None, None]

    def read(self) -> Read | None:
        for side, source in enumerate((self._left, self._right)):
            if self._waiting[side] is None:
                self._waiting[side] = source.read()
        self._name_trouble()
        left, right = self._waiting
        if left is None or right is None:
            return None
        if abs(late := right[1] - left[1]) > APART:
            self._waiting[0 if late > 0 else 1] = None  # the older one
            return None
        self._waiting = [None, None]
        return left[0] + right[0], left[1]


class Halves:
    """The left and the right half of the pictures of one camera."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.trouble = source.trouble

    def read(self) -> Read | None:
        got = self._source.read()
        self.trouble = self._source.trouble
        if got is None:
            return None
        (both,), at = got
        middle = both.shape[1] // 2
        return (both[:, :middle], both[:, middle : 2 * middle]), at

    def close(self) -> None:
        self._source.close()
