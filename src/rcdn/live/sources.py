"""Cameras that the server reads itself: one of this computer, one on the network, or a video file."""

from __future__ import annotations

import re
import threading
import time
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
WIDTH, HEIGHT = 1280, 720
"""px: size requested from a camera of this computer"""
RATE = 25.0
"""frames per second, assumed for a file without a valid rate"""


class Source(Protocol):
    """`read` returns the next frame (H, W) or (H, W, 3) BGR uint8 and its time, s, or None if there is none at present;
    it may block for about a second. `trouble` is the reason why there is none, "" if there is no problem."""

    trouble: str

    def read(self) -> tuple[Array, float] | None: ...
    def close(self) -> None: ...


def check_source(text: str) -> None:
    """Raise ConfigError unless `text` is `browser`, a camera's number, an address rtsp://… or an existing video."""
    if text == BROWSER or re.fullmatch(r"\d{1,2}", text) or re.match(r"rtsps?://\S", text):
        return
    if not is_video(text):
        raise ConfigError(
            f"--camera {text}: give `{BROWSER}`, the number of a camera of this computer (0, 1, …), an address rtsp://…, or a video file"
        )
    if not Path(text).is_file():
        raise ConfigError(f"--camera {text}: no such file; check the path")


def open_source(text: str) -> Source | None:
    """The source named by `text`, which `check_source` has accepted; None for the browser's camera."""
    if text == BROWSER:
        return None
    if is_video(text) and not text.startswith("rtsp"):
        return VideoFile(text)
    return Camera(int(text) if text.isdigit() else text)


class VideoFile:
    """All frames of a video, at most at its frame rate. After the last one, `read` returns None."""

    def __init__(self, path: str) -> None:
        with quiet_opencv():
            self._video = cv2.VideoCapture(path)
        rate = float(self._video.get(cv2.CAP_PROP_FPS))
        self._step = 1 / (rate if 1 <= rate <= 240 else RATE)
        self._count, self._begin = 0, 0.0
        self.trouble = ""

    def read(self) -> tuple[Array, float] | None:
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
        return frame, at

    def close(self) -> None:
        self._video.release()


class Camera:
    """The newest frame of a camera: a thread reads all frames, so that `read` never returns an outdated one. A camera
    that stops is opened again."""

    def __init__(self, place: int | str) -> None:
        self._place = place
        self._new = threading.Condition()
        self._frame: tuple[Array, float] | None = None
        self._ended = False
        self.trouble = "Opening the camera"
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> tuple[Array, float] | None:
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
                    self._frame = (frame, time.monotonic())
                    self._new.notify_all()
        finally:
            video.release()
