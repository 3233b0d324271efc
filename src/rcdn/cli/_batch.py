"""Many pictures, one after the other: reading ahead, failures that stay with their picture, places for the outputs."""

from __future__ import annotations

import os
import queue
import threading
import zlib
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.errors import ConfigError, OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Array

AHEAD = 3
"""Pictures read but not yet computed, at most: memory stays flat."""
LONGEST = 180
"""Bytes of an overlay's file name without its ending; file systems take 255."""


@dataclass(frozen=True)
class Picture:
    """One picture of input number `index` (a video has many). `grey` (H, W), or None and the `error` instead."""

    index: int
    name: str
    grey: Array | None
    error: str = ""


@dataclass(frozen=True)
class Failure:
    """A picture that could not be read, or not be computed."""

    name: str
    message: str


def explain(error: Exception, name: str) -> str:
    """What to tell the user; of an error that nobody raised on purpose also its type, for the bug report."""
    if isinstance(error, RcdnError):
        return str(error)
    return f"{name}: unexpected {type(error).__name__}: {error}"


def read_ahead(paths: Sequence[Path], ahead: int = AHEAD) -> Generator[Picture, None, None]:
    """The pictures of all `paths`, in order, read by another thread while the caller computes.

    A file that fails gives one Picture with an error; of a video that fails half-way the frames before it are given,
    too. The thread ends when the generator is closed.
    """
    waiting: queue.Queue[Picture | None] = queue.Queue(maxsize=ahead)
    stop = threading.Event()
    thread = threading.Thread(target=_read_all, args=(paths, waiting, stop), name="rcdn-reader", daemon=True)
    thread.start()
    try:
        while (picture := waiting.get()) is not None:
            yield picture
    finally:
        stop.set()
        thread.join(timeout=2)


def _read_all(paths: Sequence[Path], waiting: queue.Queue[Picture | None], stop: threading.Event) -> None:
    try:
        for picture in _pictures(paths):
            if not _put(picture, waiting, stop):
                return
    finally:  # without it the caller would wait for ever, whatever ended this thread
        _put(None, waiting, stop)


def _pictures(paths: Sequence[Path]) -> Iterator[Picture]:
    from rcdn.io import frames

    for index, path in enumerate(paths):
        try:
            for name, grey in frames(path):
                yield Picture(index, name, grey)
        except Exception as error:  # whatever a decoder does, the other files go on
            yield Picture(index, str(path), None, explain(error, str(path)))


def _put(picture: Picture | None, waiting: queue.Queue[Picture | None], stop: threading.Event) -> bool:
    """Wait for room, but not for a caller that has gone: False then."""
    while not stop.is_set():
        try:
            waiting.put(picture, timeout=0.1)
            return True
        except queue.Full:
            continue
    return False


def process(
    picture: Picture, detector: Any, draw: Callable[[Array, ImageResult], None] | None
) -> Iterator[ImageResult | Failure]:
    """Detect in one picture, then draw its overlay. Only OutputError (no place to write to) and interrupts get out.

    The result is given before it is drawn, so a drawing that fails takes nothing with it; a Failure follows it then.
    """
    if picture.grey is None:
        yield Failure(picture.name, picture.error)
        return
    try:
        result = _result(picture.name, picture.grey, detector)
    except Exception as error:  # one bad picture must not take the others with it
        yield Failure(picture.name, explain(error, picture.name))
        return
    yield result
    if draw is None:
        return
    try:
        draw(picture.grey, result)
    except OutputError:
        raise
    except Exception as error:
        yield Failure(picture.name, explain(error, picture.name))


def _result(name: str, grey: Array, detector: Any) -> ImageResult:
    from rcdn.io import ImageResult

    found = detector.detect(grey)
    height, width = grey.shape
    return ImageResult(name, width, height, found.corners, tuple(found.boards))


class OverlayNames:
    """A file name for each picture's overlay: never the same for two, the folders kept as `folder__name.png`."""

    def __init__(self, paths: Sequence[Path]) -> None:
        try:
            self._root = os.path.commonpath([os.path.dirname(os.path.abspath(p)) for p in paths])
        except ValueError:  # none, or on different drives
            self._root = ""
        self._used: set[str] = set()

    def take(self, name: str) -> str:
        """The file name for the picture `name` (a path, or a video's path and frame). Call once for each."""
        full = os.path.abspath(name)
        inside = os.path.relpath(full, self._root) if self._root else full
        flat = "__".join(_safe(part) for part in Path(inside).parts if _safe(part))
        stem = flat[: -len(Path(flat).suffix)] if Path(flat).suffix and "#" not in Path(name).suffix else flat
        tries = [stem, flat, *(f"{flat}-{k}" for k in range(2, len(self._used) + 3))]
        file = next(f for t in tries if (f := f"{_short(t)}.png").lower() not in self._used)
        self._used.add(file.lower())  # lower: some file systems take A.png and a.png for one
        return file


def _safe(part: str) -> str:
    """A path's part with nothing that a file system or a shell minds."""
    return "".join(c if c.isalnum() or c in "._-" else "-" for c in part).strip("-")


def _short(stem: str) -> str:
    """At most LONGEST bytes: the end says most, and a checksum of the whole keeps it apart from others."""
    data = stem.encode("utf-8", errors="replace")
    if len(data) <= LONGEST:
        return stem
    return f"{zlib.crc32(data):08x}-{data[-LONGEST + 9 :].decode('utf-8', errors='ignore')}"


def check_file(option: str, path: Path | None, inputs: Sequence[Path]) -> None:
    """Fail before the work, not after it, if `path` can't or mustn't be written."""
    if path is None:
        return
    from rcdn.io import check_writable, is_video
    from rcdn.io.files import PICTURE_ENDINGS

    mine = os.path.abspath(path)
    if is_video(path) or path.suffix.lower() in PICTURE_ENDINGS or any(os.path.abspath(p) == mine for p in inputs):
        raise ConfigError(
            f"{option} {path}: that would overwrite a picture (did the shell put a pattern's first file there?); "
            f"name the file to write after {option}"
        )
    check_writable(path)


def outside(folder: Path, arguments: Sequence[str], paths: Sequence[Path]) -> list[Path]:
    """The `paths` that are not in the overlay `folder`: what an earlier run drew there is no input.

    Raises ConfigError if the user named that folder, or something in it, as an input.
    """
    mine = Path(os.path.abspath(folder))
    if any(Path(os.path.abspath(a)).is_relative_to(mine) for a in arguments):
        raise ConfigError(f"--overlay {folder}: pictures in this folder are inputs, too; choose another folder")
    return [p for p in paths if not Path(os.path.abspath(p)).is_relative_to(mine)]
