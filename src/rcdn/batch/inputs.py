"""Inputs of a calibration: photographs, folders, patterns, videos and saved detections, in any mixture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcdn.batch import pool
from rcdn.batch.cache import Cache, file_digest
from rcdn.batch.paths import expanded
from rcdn.batch.work import (
    Failure,
    Picture,
    Work,
    content_of,
    explain,
    frame_name,
    in_thread,
    make_detector,
    pictures_of,
    with_cached,
)
from rcdn.errors import ConfigError, ImageError, many
from rcdn.terminal.console import first_time
from rcdn.terminal.group import print_error
from rcdn.terminal.picture_warnings import PictureWarnings
from rcdn.terminal.progress import Bar, progress

if TYPE_CHECKING:
    from rcdn.config import DetectorConfig
    from rcdn.io import ImageResult

KEPT = 40
"""The largest number of frames used of a video."""
SAVED = frozenset({".json", ".vnl"})
"""Endings of files that hold detections."""
Numbers = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Gathered:
    """The detections of all inputs, in their order.

    `images`: all photographs, with or without a board, and the chosen frames of videos. `failures`: inputs that could
    not be read, each already reported. `notes`: sentences on what was left out. `frames`: for each video the numbers of
    its frames in `images`. `saved`: for each picture that is named only by a file of saved detections, the folder of
    that file. `examined`: the number of frames of videos in which boards were looked for.
    """

    images: tuple[ImageResult, ...]
    failures: tuple[Failure, ...]
    notes: tuple[str, ...]
    frames: Numbers
    saved: Mapping[str, Path] = field(default_factory=dict)
    examined: int = 0

    @property
    def one_video(self) -> bool:
        """Whether all images are frames of one video."""
        return len(self.frames) == 1 and len(self.frames[0]) == len(self.images)


def gather(
    inputs: Sequence[str],
    config: DetectorConfig,
    *,
    jobs: int = 0,
    cache: Cache | None = None,
    frames: int = KEPT,
    numbers: Numbers | None = None,
    size: tuple[int, int] | None = None,
    make: Callable[[DetectorConfig], Any] = make_detector,
    silent: str | None = None,
) -> Gathered:
    """Detections of all `inputs`: pictures, videos, folders, patterns, and files of detections (.json, corners.vnl).

    `jobs` processes (0: one for each core) compute what isn't in the `cache`. Of each video at most `frames` frames are
    used, chosen to be sharp and to differ; `numbers` gives them instead, for each video, as they were chosen for the
    other camera of a pair (`Gathered.frames`). `size`: the board's (columns, rows), which a corners.vnl doesn't hold;
    None: it is guessed. `silent`: beginning of warnings that aren't printed, since the caller speaks of all of them.

    A file that fails is reported on stderr and the others are processed. The result doesn't depend on `jobs` or on the
    cache. Raises ConfigError if there is nothing to read, RcdnError if no detector can be made, KeyboardInterrupt.
    """
    run = _Run(expanded(inputs), frames, numbers, silent)
    if not run.paths:
        raise ConfigError("there is nothing to read; name pictures, videos, folders that hold some, or detections")
    run.read_saved(size, config)
    jobs = pool.jobs_for(jobs, list(run.shot.values()))
    config = pool.config_of_process(config, jobs)
    run.detect(Work(partial(make, config), cache), jobs)
    return run.gathered()


def _not_as_asked(images: Sequence[ImageResult], config: DetectorConfig) -> Iterator[str]:
    """Sentences on boards that were saved and that a detection with these settings wouldn't give."""
    boards = [board for image in images for board in image.boards]
    if config.pattern == "deltille" and (squares := sum(board.pattern != "deltille" for board in boards)):
        yield f"{many(squares, 'board')} of squares, used as saved: --pattern is for pictures"
    if config.target == "plain" and (coded := sum(board.target is not None for board in boards)):
        yield f"{many(coded, 'board')} with codes, used as saved: --target is for pictures"


@dataclass
class _Video:
    """A video's state: `count`, the total number of frames, and the numbers of those that are `examined`."""

    path: Path
    count: int = 0
    examined: list[int] = field(default_factory=list)


class _Run:
    def __init__(
        self, expanded: tuple[list[Path], list[Failure]], frames: int, numbers: Numbers | None, silent: str | None
    ) -> None:
        from rcdn.io import is_video

        self.paths, self.failures = expanded
        self.shot = {k: p for k, p in enumerate(self.paths) if p.suffix.lower() not in SAVED}
        self._videos = {k: _Video(p) for k, p in self.shot.items() if is_video(p)}
        self._images: dict[int, list[ImageResult]] = {k: [] for k in range(len(self.paths))}
        self._most = frames
        self._silent = silent
        self._given = dict(zip(self._videos, numbers, strict=False)) if numbers is not None else None
        self._notes: list[str] = []

    # ---- detections that were saved

    def read_saved(self, size: tuple[int, int] | None, config: DetectorConfig) -> None:
        for index, path in enumerate(self.paths):
            if index in self.shot:
                continue
            try:
                self._images[index] = self._saved(path, size)
                self._notes += [f"{path}: {other}" for other in _not_as_asked(self._images[index], config)]
            except Exception as error:
                self._fail(Failure(str(path), explain(error, str(path))), print_error)

    def _saved(self, path: Path, size: tuple[int, int] | None) -> list[ImageResult]:
        from rcdn.io import read_detections, read_vnl_boards

        if path.suffix.lower() == ".vnl":
            return read_vnl_boards(path, size)
        images, errors = read_detections(path)
        if errors:
            names = ", ".join(name for name, _ in errors[:3]) + (", …" if len(errors) > 3 else "")
            self._notes.append(f"{path}: {many(len(errors), 'file')} could not be read when it was written: {names}")
        return images

    # ---- pictures and videos

    def detect(self, work: Work, jobs: int) -> None:
        if not self.shot:
            return
        with (
            progress(len(self.paths)) as bar,
            closing(PictureWarnings(bar.warn)) as warnings,
            closing(in_thread(lambda: self._pictures(jobs == 1, work.cache, bar))) as pictures,
            closing(pool.compute(pictures, work, jobs)) as results,
        ):
            for done in results:
                bar.advance(done.index, done.name)
                for outcome in done.outcomes:
                    if isinstance(outcome, Failure):
                        self._fail(outcome, bar.print_error)
                        continue
                    self._images[done.index].append(outcome)
                    aloud = [w for w in outcome.warnings if not (self._silent and w.startswith(self._silent))]
                    warnings.add(outcome.path, aloud)
        if work.cache is not None:
            work.cache.prune()

    def _fail(self, failure: Failure, report: Callable[[str], None]) -> None:
        self.failures.append(failure)
        if first_time(failure.message):
            report(failure.message)

    def _pictures(self, decode: bool, cache: Cache | None, bar: Bar) -> Iterator[Picture]:
        for index, path in self.shot.items():
            if index not in self._videos:
                yield from pictures_of(index, path, decode, cache)
                continue
            try:
                yield from self._video(index, cache, bar)
            except Exception as error:  # whatever a decoder raises, the other files are still processed
                yield Picture(index, str(path), None, explain(error, str(path)))

    def _video(self, index: int, cache: Cache | None, bar: Bar) -> Iterator[Picture]:
        """The candidate frames of a video; those that aren't in the cache are read from the video in a second pass."""
        video = self._videos[index]
        content = content_of(video.path, cache)
        if self._given is not None:
            video.examined = sorted(self._given.get(index, ()))
        else:
            bar.describe(f"{video.path.name}: looking for sharp frames")
            video.count, video.examined, error = _candidates(video.path, content, cache)
            if error:
                yield Picture(index, str(video.path), None, error)
        blank = (Picture(index, frame_name(video.path, number), None, number=number) for number in video.examined)
        yield from _with_pixels(video.path, [with_cached(p, content, cache) for p in blank])

    # ---- all together

    def gathered(self) -> Gathered:
        from rcdn.batch.same_names import distinct

        kept: list[tuple[int, ...]] = []
        for index, video in self._videos.items():
            kept.append(self._keep_views(index, video))
        images = distinct(
            (None if index in self.shot else path, image)
            for index, path in enumerate(self.paths)
            for image in self._images[index]
        )
        return Gathered(
            images.images,
            tuple(self.failures),
            (*self._notes, *images.notes),
            tuple(kept),
            images.folders,
            sum(len(video.examined) for video in self._videos.values()),
        )

    def _keep_views(self, index: int, video: _Video) -> tuple[int, ...]:
        from rcdn.calibration.frames import choose_views

        images = self._images[index]
        if self._given is None:
            with_board = sum(bool(i.boards) for i in images)
            images = self._images[index] = [images[k] for k in choose_views(images, self._most)]
            if video.examined:
                self._notes.append(
                    f"{video.path}: {len(images)} frames are used, of {with_board} with a board, "
                    f"of {len(video.examined)} sharp and different ones, of {video.count}"
                )
        names = {frame_name(video.path, number): number for number in video.examined}
        return tuple(names[i.path] for i in images)


def _candidates(path: Path, content: str, cache: Cache | None) -> tuple[int, list[int], str]:
    """The number of frames of the video, the numbers of the candidates for detection, and the error after these frames,
    or ""."""
    from rcdn.calibration import frames as choice
    from rcdn.io import frames
    from rcdn.io.images import frame_rate

    key = ""
    if cache is not None and content:
        key = cache.key(content, "candidates", file_digest(choice.__file__))
        known = cache.get(key)
        if isinstance(known, dict) and _are_frames(known.get("frames"), known.get("count")):
            return known["count"], known["frames"], ""
    summaries, error = [], ""
    try:
        for _, grey in frames(path):
            summaries.append(choice.frame_summary(grey))
    except ImageError as failed:
        if not summaries:
            raise
        error = str(failed)
    numbers = choice.candidates(summaries, rate=frame_rate(path))
    if cache is not None and key and not error:
        cache.put(key, {"count": len(summaries), "frames": numbers})
    return len(summaries), numbers, error


def _are_frames(numbers: Any, count: Any) -> bool:
    """True if `numbers` increase strictly and are frame numbers of a video with `count` frames."""
    if type(count) is not int or not isinstance(numbers, list) or not all(type(k) is int for k in numbers):
        return False
    return all(a < b for a, b in zip([-1, *numbers], [*numbers, count], strict=True))


def _with_pixels(path: Path, pictures: Sequence[Picture]) -> Iterator[Picture]:
    """The frames of one video in increasing order, each with its pixels unless its detections are known; frames that
    the video doesn't contain are skipped."""
    from rcdn.io import frames

    wanted = {p.number: p for p in pictures if p.known is None}
    waiting = list(pictures)
    if wanted:
        for number, (_, grey) in enumerate(frames(path)):
            while waiting and waiting[0].number <= number:
                picture = waiting.pop(0)
                yield picture if picture.known is not None else replace(picture, grey=grey)
            if number >= max(wanted):
                break
    yield from (p for p in waiting if p.known is not None)
