"""`rcdn detect`: corners and boards of many pictures, to JSON, corners.vnl and pictures to look at."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcdn.cli import _batch, _summary
from rcdn.cli._group import FAILED, INTERRUPTED, WRONG_USE, one_line, say_error
from rcdn.cli._options import GridSize, parse_size
from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError, OutputError, RcdnError

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Array

LIST_UP_TO = 20
"""Up to that many pictures the summary has a line for each."""


class Preset(StrEnum):
    """The presets of DetectorConfig."""

    auto = "auto"
    paper = "paper"


@dataclass
class _Run:
    """What has been done so far, in the order of the inputs, and what ended it early."""

    outcomes: list[ImageResult | _batch.Failure] = field(default_factory=list)
    stopped: KeyboardInterrupt | OutputError | None = None

    @property
    def images(self) -> list[ImageResult]:
        return [o for o in self.outcomes if not isinstance(o, _batch.Failure)]

    @property
    def errors(self) -> list[tuple[str, str]]:
        return [(o.name, o.message) for o in self.outcomes if isinstance(o, _batch.Failure)]


def detect(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGES...", help="Pictures, videos, folders (with all below them), or patterns: 'a/*.png'."
        ),
    ],
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="Write corners and boards as JSON.")] = None,
    vnl: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write corners.vnl, which mrcal-calibrate-cameras reads; one board a picture."
        ),
    ] = None,
    overlay: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw what was found over each picture, into this folder.")
    ] = None,
    board: Annotated[
        GridSize | None,
        typer.Option(
            parser=parse_size,
            metavar="COLSxROWS",
            help="The board's inner corners, where four squares meet: 10x7 squares are 9x6. Only boards of that size "
            "then count as complete. Not needed to find boards.",
        ),
    ] = None,
    preset: Annotated[
        Preset, typer.Option(help="auto: the best there is. paper: exactly the published method, to compare with.")
    ] = Preset.auto,
    threads: Annotated[int, typer.Option(min=0, help="Threads to compute with; 0: all cores.")] = 0,
) -> None:
    """Find checkerboard corners, and their boards, in pictures.

    The boards' sizes need not be known; several boards in a picture and boards that are partly hidden are found. A
    file that can't be read is reported and the others go on.

    Exit code: 0 if all pictures were read, 1 if some failed, 2 for wrong use, 130 after Ctrl-C.
    """
    start = time.perf_counter()
    paths, run = _inputs(images)
    if overlay is not None:
        paths = _without_overlays(overlay, images, paths)
    if not paths:
        say_error("there is nothing to read; name pictures, videos or folders that hold some")
        raise typer.Exit(WRONG_USE)
    _check_outputs(json, vnl, overlay, paths)
    detector = _make_detector(DetectorConfig.preset(preset.value, threads=threads))
    _detect_all(run, paths, detector, _painter(overlay, paths) if overlay is not None else None)
    failures = _write(run, json, vnl, board)
    _print_summary(run, board, time.perf_counter() - start)
    _finish(run, failures, len(paths))


def _make_detector(config: DetectorConfig) -> Any:
    from rcdn.detector import Detector

    return Detector(config)


def _inputs(arguments: Sequence[str]) -> tuple[list[Path], _Run]:
    from rcdn.io import expand

    paths, errors = expand(arguments)
    run = _Run([_batch.Failure(name, message) for name, message in errors])
    for _, message in errors:
        say_error(message)
    return paths, run


def _without_overlays(folder: Path, arguments: Sequence[str], paths: list[Path]) -> list[Path]:
    kept = _batch.outside(folder, arguments, paths)
    if len(kept) < len(paths):
        typer.echo(f"note: {len(paths) - len(kept)} files in {folder} are passed over: overlays go there", err=True)
    return kept


def _check_outputs(json: Path | None, vnl: Path | None, overlay: Path | None, paths: Sequence[Path]) -> None:
    """Raise before the work what would spoil it afterwards."""
    _batch.check_file("--json", json, paths)
    _batch.check_file("--vnl", vnl, paths)
    if json is not None and json == vnl:
        raise ConfigError(f"--json and --vnl are both {json}; give two names")
    if vnl is not None:
        for path in map(str, paths):  # the rule of mrcal's format, which write_vnl keeps to
            if not path.isascii() or any(c.isspace() or not c.isprintable() for c in path) or path.startswith("#"):
                raise ConfigError(f"--vnl: mrcal can't read the path {path!r} (spaces, non-ASCII, #); rename it")
    if overlay is not None:
        from rcdn.io import check_writable

        check_writable(overlay / "overlay.png")


def _painter(folder: Path, paths: Sequence[Path]) -> Callable[[Array, ImageResult], None]:
    """A function that draws one result and writes it at once: overlays don't pile up in memory."""
    from rcdn.io import write_image
    from rcdn.report.overlay import draw_overlay

    names = _batch.OverlayNames(paths)

    def paint(grey: Array, result: ImageResult) -> None:
        write_image(folder / names.take(result.path), draw_overlay(grey, result.corners, result.boards))

    return paint


def _detect_all(
    run: _Run, paths: Sequence[Path], detector: Any, paint: Callable[[Array, ImageResult], None] | None
) -> None:
    """Fill `run`. An interrupt, or a disk that takes no more overlays, ends it early but loses nothing."""
    try:
        with _progress(len(paths)) as bar, closing(_batch.read_ahead(paths)) as pictures:
            for picture in pictures:
                bar.advance(picture.index, picture.name)
                for outcome in _batch.process(picture, detector, paint):
                    run.outcomes.append(outcome)
                    if isinstance(outcome, _batch.Failure):
                        bar.say(outcome.message)
    except (KeyboardInterrupt, OutputError) as stopped:
        run.stopped = stopped


@dataclass(frozen=True)
class _Bar:
    """`advance(inputs done, current name)` moves the bar; `say(message)` tells of an error without tearing it."""

    advance: Callable[[int, str], None]
    say: Callable[[str], None]


@contextmanager
def _progress(total: int) -> Iterator[_Bar]:
    """A progress bar on stderr if that is a terminal; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield _Bar(lambda done, name: None, say_error)
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.text import Text

    columns = BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=total)
        yield _Bar(
            lambda done, name: bar.update(task, completed=done, description=escape(one_line(Path(name).name))),
            lambda message: bar.console.print(Text(f"error: {one_line(message)}", style="red"), soft_wrap=True),
        )


def _write(run: _Run, json: Path | None, vnl: Path | None, board: GridSize | None) -> list[RcdnError]:
    """Write what is asked for. One file that can't be written doesn't stop the other; returns what went wrong."""
    from rcdn.io import write_detections, write_vnl

    failures: list[RcdnError] = []
    try:
        if json is not None:
            write_detections(json, run.images, run.errors)
    except RcdnError as error:
        failures.append(error)
    try:
        if vnl is not None:
            write_vnl(vnl, run.images, board)
    except RcdnError as error:
        failures.append(error)
    return failures


def _print_summary(run: _Run, board: GridSize | None, seconds: float) -> None:
    if len(run.outcomes) <= LIST_UP_TO:
        for text in (*_summary.picture_lines(run.outcomes, board), ""):
            typer.echo(text)
    for text in _summary.table(run.outcomes, board, seconds):
        typer.echo(text)
    if hint := _summary.size_hint(run.images, board):
        typer.echo(f"hint: {hint}")


def _finish(run: _Run, failures: Sequence[RcdnError], total: int) -> None:
    """Say what went wrong outside the pictures, and set the exit code."""
    for failure in failures:
        say_error(str(failure))
    if isinstance(run.stopped, KeyboardInterrupt):
        say_error(f"stopped by Ctrl-C after {len(run.images)} pictures of {total} files; their results are kept")
        raise typer.Exit(INTERRUPTED)
    if run.stopped is not None:
        say_error(f"{run.stopped} (stopped after {len(run.images)} pictures; --json and --vnl hold these)")
    if run.stopped is not None or failures or run.errors:
        raise typer.Exit(FAILED)
