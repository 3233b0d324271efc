"""Many pictures: reading ahead, and the work on each; failures stay with their picture."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rcdn import interrupts
from rcdn.errors import ConfigError, DependencyError, OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.batch.cache import Cache
    from rcdn.config import DetectorConfig
    from rcdn.io import ImageResult
    from rcdn.types import Array

T = TypeVar("T")
AHEAD = 3
"""Pictures read but not yet computed, at most: memory stays flat."""


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of input number `index` (a video has many; `number` is that of the frame, -1 elsewhere), and how far it is.

    `grey` (H, W); or None and the `path` to read it from, or the `error` instead. `known`: its detections, if they are
    there already; `key`: where the cache keeps them; `overlay`: the file to draw it to.
    """

    index: int
    name: str
    grey: Array | None
    error: str = ""
    path: Path | None = None
    known: ImageResult | None = None
    key: str = ""
    overlay: Path | None = None
    number: int = -1


@dataclass(frozen=True)
class Failure:
    """A picture that could not be read, or not be computed."""

    name: str
    message: str


@dataclass(frozen=True, eq=False)
class Done:
    """What became of one picture: its detections (as `Work.pack` packs them), or a failure, or both if only the drawing failed.

    `unwritten`: why its overlay could not be written.
    """

    index: int
    name: str
    outcomes: tuple[Any, ...]
    unwritten: OutputError | None = None


def explain(error: Exception, name: str) -> str:
    """What to tell the user; of an error that nobody raised on purpose also its type, for the bug report."""
    if isinstance(error, RcdnError):
        return str(error)
    return f"{name}: unexpected {type(error).__name__}: {error}"


# ---- reading


def read_ahead(
    paths: Sequence[Path], ahead: int = AHEAD, decode: bool = True, cache: Cache | None = None
) -> Generator[Picture, None, None]:
    """The pictures of all `paths`, in order, read by another thread while the caller computes.

    A file that fails gives one Picture with an error; of a video that fails half-way the frames before it are given,
    too. Without `decode` only videos are read; other pictures come as their path. What the `cache` holds is `known`.
    """
    return in_thread(lambda: (p for k, path in enumerate(paths) for p in pictures_of(k, path, decode, cache)), ahead)


def pictures_of(index: int, path: Path, decode: bool, cache: Cache | None) -> Iterator[Picture]:
    """The pictures of the file `path`. Raises nothing, whatever a decoder does: the other files go on."""
    from rcdn.io import frames, is_video
    from rcdn.io.files import is_special

    try:
        content = content_of(path, cache)
        if not is_video(path):
            picture = looked_up(Picture(index, str(path), None, path=path), content, cache)
            if picture.known is not None or not (decode or is_special(path)):  # a pipe can be read here only, and once
                yield picture
                return
        for number, (name, grey) in enumerate(frames(path)):
            yield looked_up(Picture(index, name, grey, number=number if is_video(path) else -1), content, cache)
    except Exception as error:
        yield Picture(index, str(path), None, explain(error, str(path)))


def frame_name(path: Path, number: int) -> str:
    """What a frame of a video is called everywhere (docs/formats.md)."""
    return f"{path}#{number:06d}"


def content_of(path: Path, cache: Cache | None) -> str:
    """Checksum of the file; "" if nobody needs it, or it is a pipe, or can't be read: the reader says why."""
    from rcdn.batch.cache import file_digest

    try:
        return file_digest(path) if cache is not None and path.is_file() else ""  # a pipe would be empty afterwards
    except OSError:
        return ""


def looked_up(picture: Picture, content: str, cache: Cache | None) -> Picture:
    """`picture`, of a file with the checksum `content`, with its key and with what the cache knows of it."""
    if cache is None or not content:
        return picture
    key = cache.key(content, "picture" if picture.number < 0 else f"frame {picture.number}")
    return replace(picture, key=key, known=cache.result(key, picture.name))


def in_thread(make: Callable[[], Iterable[T]], ahead: int = AHEAD) -> Generator[T, None, None]:
    """What `make()` gives, in order, computed by another thread, at most `ahead` of them before they are asked for.

    What is raised there is raised here. The thread ends when the generator is closed.
    """
    waiting: queue.Queue[tuple[bool, Any]] = queue.Queue(maxsize=ahead)
    stop = threading.Event()
    thread = threading.Thread(target=_fill, args=(make, waiting, stop), name="rcdn-reader", daemon=True)
    try:
        with interrupts.held():
            thread.start()
        while True:
            more, value = waiting.get()
            if more:
                yield value
            elif value is None:
                return
            else:
                raise value
    finally:
        stop.set()
        if thread.is_alive():  # it isn't if it could not be started, or an interrupt came before that
            thread.join(timeout=2)


def _fill(make: Callable[[], Iterable[T]], waiting: queue.Queue[tuple[bool, Any]], stop: threading.Event) -> None:
    end: BaseException | None = None
    try:
        for value in make():
            if not _put((True, value), waiting, stop):
                return
    except BaseException as error:  # without an end the caller would wait for ever, whatever ended this thread
        end = error
    _put((False, end), waiting, stop)


def _put(item: Any, waiting: queue.Queue[Any], stop: threading.Event) -> bool:
    """Wait for room, but not for a caller that has gone: False then."""
    while not stop.is_set():
        try:
            waiting.put(item, timeout=0.1)
            return True
        except queue.Full:
            continue
    return False


# ---- computing


def make_detector(config: DetectorConfig) -> Any:
    """A Detector; a function of its own so that worker processes can find it, and import it late.

    Raises DependencyError if it should compute on a graphics card and this ONNX Runtime can't.
    """
    from rcdn.detector import Detector

    if config.device == "cuda":
        from rcdn.corners.response import device_of

        try:
            device_of(config.device)
        except ConfigError as error:
            raise DependencyError(f"--{error}") from error
    return Detector(config)


class Work:
    """What is done to each picture: read, detect, draw, each only if it is still to do.

    `make`: makes the detector, at the first picture that needs it; `pack`: what to give of each result instead of the result itself.
    Goes to worker processes, so both must be functions that can be found by their names, or partials of such.
    """

    def __init__(
        self, make: Callable[[], Any], cache: Cache | None = None, pack: Callable[[ImageResult], Any] | None = None
    ) -> None:
        self.make = make
        self.cache = cache
        self.pack = pack
        self._detector: Any = None

    def prepare(self) -> None:
        """Make the detector. Raises what `make` raises: no picture is to blame."""
        if self._detector is None:
            self._detector = self.make()

    def needed(self, picture: Picture) -> bool:
        """False if nothing is left that takes long."""
        return not picture.error and (picture.known is None or picture.overlay is not None)

    def loaded(self, picture: Picture) -> Picture:
        """`picture` with its pixels if it needs them, or with the error that there are none. Raises nothing."""
        if picture.grey is not None or not self.needed(picture):
            return picture
        from rcdn.io import read_image

        try:
            return replace(picture, grey=read_image(picture.path or picture.name))
        except Exception as error:  # whatever a decoder does
            return replace(picture, error=explain(error, picture.name))

    def __call__(self, picture: Picture) -> Done:
        """Whatever goes wrong with this picture is in what it returns; only interrupts, and `make`'s errors, get out."""
        if self.needed(picture) and picture.known is None:
            self.prepare()
        picture = self.loaded(picture)
        if picture.error:
            return Done(picture.index, picture.name, (Failure(picture.name, picture.error),))
        outcomes: list[Any] = []
        unwritten = None
        try:
            result = picture.known or self._detect(picture, picture.grey)
            outcomes.append(result if self.pack is None else self.pack(result))
            if picture.overlay is not None and picture.grey is not None:
                _draw(picture.overlay, picture.grey, result)
        except OutputError as error:
            unwritten = error  # the detections are there all the same
        except Exception as error:  # one bad picture must not take the others with it
            outcomes.append(Failure(picture.name, explain(error, picture.name)))
        return Done(picture.index, picture.name, tuple(outcomes), unwritten)

    def _detect(self, picture: Picture, grey: Any) -> ImageResult:
        from rcdn.io import ImageResult

        found = self._detector.detect(grey)
        height, width = grey.shape
        result = ImageResult(picture.name, width, height, found.corners, tuple(found.boards), found.warnings)
        if self.cache is not None and picture.key:
            self.cache.keep(picture.key, result)
        return result


def _draw(file: Path, grey: Array, result: ImageResult) -> None:
    """Draw one result and write it at once: overlays don't pile up in memory."""
    from rcdn.io import write_image
    from rcdn.report.overlay import draw_overlay

    write_image(file, draw_overlay(grey, result.corners, result.boards), mark="rcdn overlay")
