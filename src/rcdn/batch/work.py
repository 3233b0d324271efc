"""Processing many pictures: reading ahead, and the work on each picture; a failure affects only its own picture."""

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
"""The largest number of pictures that are read but not yet processed, which bounds memory use."""


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of input number `index` (a video has many; `number` is that of the frame, -1 for other files), and
    its state of processing.

    `grey` (H, W); or None and the `path` to read it from, or the `error` that occurred. `known`: its detections, if
    they were found in the cache; `key`: their key in the cache; `overlay`: the file for the drawing of its detections.
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
    """A picture that could not be read or processed."""

    name: str
    message: str


@dataclass(frozen=True, eq=False)
class Done:
    """The outcomes of one picture: its detections (as packed by `Work.pack`), a failure, or both if only the drawing
    failed.

    `unwritten`: the error because of which its overlay could not be written.
    """

    index: int
    name: str
    outcomes: tuple[Any, ...]
    unwritten: OutputError | None = None


def explain(error: Exception, name: str) -> str:
    """The message for the user; for an unexpected error it includes the type, for the bug report."""
    if isinstance(error, RcdnError):
        return str(error)
    return f"{name}: unexpected {type(error).__name__}: {error}"


# ---- reading


def read_ahead(
    paths: Sequence[Path], ahead: int = AHEAD, decode: bool = True, cache: Cache | None = None
) -> Generator[Picture, None, None]:
    """The pictures of all `paths`, in order, read by another thread while the caller computes.

    A file that fails gives one Picture with an error; a video that fails half-way also gives the frames before the
    error. Without `decode` only videos are read; other pictures are given by their path. `known` is set for pictures
    whose detections are in the `cache`.
    """
    return in_thread(lambda: (p for k, path in enumerate(paths) for p in pictures_of(k, path, decode, cache)), ahead)


def pictures_of(index: int, path: Path, decode: bool, cache: Cache | None) -> Iterator[Picture]:
    """The pictures of the file `path`. Raises nothing, whatever a decoder raises: the other files are still
    processed."""
    from rcdn.io import frames, is_video
    from rcdn.io.files import is_special

    try:
        content = content_of(path, cache)
        if not is_video(path):
            picture = with_cached(Picture(index, str(path), None, path=path), content, cache)
            # a pipe is always read here: it can be read only once, and only in this process
            if picture.known is not None or not (decode or is_special(path)):
                yield picture
                return
        for number, (name, grey) in enumerate(frames(path)):
            yield with_cached(Picture(index, name, grey, number=number if is_video(path) else -1), content, cache)
    except Exception as error:
        yield Picture(index, str(path), None, explain(error, str(path)))


def frame_name(path: Path, number: int) -> str:
    """The name of a frame of a video, as used in all outputs (docs/formats.md)."""
    return f"{path}#{number:06d}"


def content_of(path: Path, cache: Cache | None) -> str:
    """Checksum of the file; "" if it isn't needed, or the file is a pipe or can't be read (its reader reports the
    reason)."""
    from rcdn.batch.cache import file_digest

    try:
        return file_digest(path) if cache is not None and path.is_file() else ""  # a pipe would be empty afterwards
    except OSError:
        return ""


def with_cached(picture: Picture, content: str, cache: Cache | None) -> Picture:
    """`picture`, from a file with checksum `content`, with its key and its cached detections, if any."""
    if cache is None or not content:
        return picture
    key = cache.key(content, "picture" if picture.number < 0 else f"frame {picture.number}")
    return replace(picture, key=key, known=cache.result(key, picture.name))


def in_thread(make: Callable[[], Iterable[T]], ahead: int = AHEAD) -> Generator[T, None, None]:
    """The items of `make()`, in order, computed by another thread, at most `ahead` of them in advance.

    An exception raised there is raised here. The thread ends when the generator is closed.
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
        if thread.is_alive():  # false if it could not be started, or was interrupted before
            thread.join(timeout=2)


def _fill(make: Callable[[], Iterable[T]], waiting: queue.Queue[tuple[bool, Any]], stop: threading.Event) -> None:
    end: BaseException | None = None
    try:
        for value in make():
            if not _put((True, value), waiting, stop):
                return
    except BaseException as error:  # whatever ends this thread: without a last item the caller would wait forever
        end = error
    _put((False, end), waiting, stop)


def _put(item: Any, waiting: queue.Queue[Any], stop: threading.Event) -> bool:
    """Put `item` into the queue, waiting for room; False if the caller has stopped reading."""
    while not stop.is_set():
        try:
            waiting.put(item, timeout=0.1)
            return True
        except queue.Full:
            continue
    return False


# ---- computing


def make_detector(config: DetectorConfig) -> Any:
    """A Detector; a module-level function so that worker processes can import it by name, and late.

    Raises DependencyError if it should run on a GPU and the installed ONNX Runtime can't.
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
    """The steps for each picture: read, detect, draw, each only if it is still to be done.

    `make`: makes the detector, called at the first picture that needs it; `pack`: converts each result before it is
    returned. The object is sent to worker processes, so both must be module-level functions or partials of such.
    """

    def __init__(
        self, make: Callable[[], Any], cache: Cache | None = None, pack: Callable[[ImageResult], Any] | None = None
    ) -> None:
        self.make = make
        self.cache = cache
        self.pack = pack
        self._detector: Any = None

    def prepare(self) -> None:
        """Make the detector. Raises the errors of `make`, which aren't attributed to a picture."""
        if self._detector is None:
            self._detector = self.make()

    def needed(self, picture: Picture) -> bool:
        """Whether a time-consuming step is left for `picture`."""
        return not picture.error and (picture.known is None or picture.overlay is not None)

    def loaded(self, picture: Picture) -> Picture:
        """`picture` with its pixels if it needs them, or with the error of reading them. Raises nothing."""
        if picture.grey is not None or not self.needed(picture):
            return picture
        from rcdn.io import read_image

        try:
            return replace(picture, grey=read_image(picture.path or picture.name))
        except Exception as error:  # whatever a decoder raises
            return replace(picture, error=explain(error, picture.name))

    def __call__(self, picture: Picture) -> Done:
        """Process one picture. Its errors are part of the returned Done; only interrupts and errors of `make` are
        raised."""
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
            unwritten = error  # the detections are returned nevertheless
        except Exception as error:  # one bad picture must not stop the others
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
    """Draw one result and write it at once, so that overlays don't accumulate in memory."""
    from rcdn.io import write_image
    from rcdn.report.overlay import draw_overlay

    write_image(file, draw_overlay(grey, result.corners, result.boards), mark="rcdn overlay")
