"""`rcdn detect`: corners and boards of many pictures, written as JSON, corners.vnl and overlays."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rcdn.batch import pool, summary
from rcdn.batch.cache import open_cache
from rcdn.batch.detection_files import FORMATS, DetectionFormat, format_of
from rcdn.batch.no_board import markers_hint, target_hint
from rcdn.batch.outputs import Outputs
from rcdn.batch.overlay_names import OverlayNames
from rcdn.batch.paths import check_file, expanded, outside
from rcdn.batch.work import Done, Failure, Picture, Work, make_detector, read_ahead
from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError, FormatError, RcdnError, many
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.group import FAILED, INTERRUPTED, WRONG_USE, print_error, print_stopped
from rcdn.terminal.options import GridSize, Jobs, MaxMegapixels, Pattern, PatternName, parse_folder, parse_size
from rcdn.terminal.picture_warnings import PictureWarnings
from rcdn.terminal.progress import progress
from rcdn.terminal.target import DEFAULT, Target


class Preset(StrEnum):
    """The presets of DetectorConfig."""

    auto = "auto"
    paper = "paper"


class Engine(StrEnum):
    """Where the worker processes run."""

    local = "local"
    ray = "ray"


class Device(StrEnum):
    """`rcdn.config.Device`."""

    cpu = "cpu"
    cuda = "cuda"
    auto = "auto"


@dataclass
class _Run:
    """The state of a run: the outcomes so far in the order of the inputs, the reason for an early end, and the number
    of overlays that could not be written."""

    tally: summary.Tally
    outputs: Outputs
    stopped: KeyboardInterrupt | RcdnError | None = None
    undrawn: int = 0

    def add(self, outcome: summary.Brief | Failure) -> None:
        if isinstance(outcome, summary.Brief):
            self.outputs.add(outcome.line)
        self.tally.add(outcome)


def detect(
    images: Annotated[
        list[str],
        typer.Argument(
            metavar="IMAGES...", help="Pictures, videos, folders (with all below them), or patterns: 'a/*.png'."
        ),
    ],
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write corners and boards as JSON; - is standard output.")
    ] = None,
    vnl: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write corners.vnl, which mrcal-calibrate-cameras reads; one board a picture."
        ),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write a file, by its name .json, .vnl or .csv (a table); may be repeated.",
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            parser=parse_folder, metavar="DIR", help="Draw what was found over each picture, into this folder."
        ),
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
    pattern: Pattern = PatternName.checker,
    target: Target = DEFAULT,
    jobs: Jobs = 0,
    max_megapixels: MaxMegapixels = None,
    threads: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Threads of each process; 0: one, or all cores if there is one process only."
        ),
    ] = 0,
    device: Annotated[
        Device,
        typer.Option(
            help="Where the network runs. auto: on a graphics card if there is one that ONNX Runtime can use."
        ),
    ] = Device.cpu,
    engine: Annotated[
        Engine, typer.Option(help="local: processes of this machine. ray: a Ray cluster's (needs the extra `ray`).")
    ] = Engine.local,
    address: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            envvar="RAY_ADDRESS",
            help="With --engine ray: the cluster; `auto`: the one of this machine. "
            "Without it one is started here, for this run.",
        ),
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Keep what was found here and take it from here: a run that was stopped goes on."
        ),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Find checkerboard corners, and their boards, in pictures.

    The boards' sizes need not be known; several boards in a picture and boards that are partly hidden are found. A
    file that can't be read is reported and the others go on.

    Exit code: 0 if all pictures were read, 1 if some failed, 2 for wrong use, 130 after Ctrl-C.
    """
    start = time.perf_counter()
    files = _files(json, vnl, output or [])
    console.begin(quiet, files)
    paths, unread = expanded(images)
    if overlay is not None:
        paths = _without_overlays(overlay, images, paths)
    if not paths:
        print_error("there is nothing to read; name pictures, videos or folders that hold some")
        raise typer.Exit(WRONG_USE)
    _check_outputs(files, {json: "--json", vnl: "--vnl"}, overlay, paths)
    pattern, board = target.pattern(pattern), target.board(board)
    _check_pattern(pattern, board, files.values())
    reads = (
        {} if target is DEFAULT else {"target": target.reads}
    )  # the preset `paper` decodes no codes unless requested
    config = DetectorConfig.preset(preset.value, threads=threads, pattern=pattern.value, device=device.value, **reads)
    team = _team(engine, address, jobs, paths)
    with closing(Outputs(files, board)) as outputs:
        run = _Run(summary.Tally(board), outputs)
        for failure in unread:
            run.add(failure)
        _detect_all(run, paths, _work(config, team, cache, outputs.wanted), team, overlay)
        failures = outputs.write(run.tally.failures)
    for text in run.tally.lines(time.perf_counter() - start):
        console.print_line(text)
    if run.tally.no_board and (hint := markers_hint(map(str, paths))):
        console.print_line(hint)
    if hint := target_hint(config.target, run.tally.targets.elements()):
        console.print_line(f"hint: {hint}")
    _finish(run, failures, len(paths))


_make_detector = make_detector


@dataclass(frozen=True)
class _Team:
    """The workers: `jobs` processes, or this process alone. `compute` is `rcdn.batch.pool.compute`, or a function with
    the same interface for another engine."""

    jobs: int
    alone: bool
    compute: Callable[[Iterator[Picture], Work, int], Generator[Done, None, None]]


def _team(engine: Engine, address: str | None, jobs: int, paths: Sequence[Path]) -> _Team:
    if engine is Engine.local:
        many = pool.jobs_for(jobs, paths)
        return _Team(many, many == 1, pool.compute)

    from rcdn.batch import ray

    ray.check()
    return _Team(jobs, False, partial(ray.compute, address=address))


def _work(config: DetectorConfig, team: _Team, cache: Path | None, lines: bool) -> Work:
    store = open_cache(config, cache, off=cache is None)
    make = partial(_make_detector, config if team.alone or config.threads else replace(config, threads=1))
    return Work(make, store, partial(summary.brief, lines=lines))


def _without_overlays(folder: Path, arguments: Sequence[str], paths: list[Path]) -> list[Path]:
    kept = outside(folder, arguments, paths)
    if len(kept) < len(paths):
        console.note(f"note: skipped: {many(len(paths) - len(kept), 'file')} in {folder}, where overlays go")
    return kept


def _files(json: Path | None, vnl: Path | None, output: Sequence[Path]) -> dict[Path, DetectionFormat]:
    """The files to write. Raises ConfigError if two are the same, or if a name tells no format."""
    try:
        named = [(json, FORMATS["json"]), (vnl, FORMATS["vnl"]), *((path, format_of(path)) for path in output)]
    except FormatError as error:
        raise ConfigError(f"--output {error}") from error
    files: dict[Path, DetectionFormat] = {}
    for path, format in named:
        if path is not None and path.absolute() in map(Path.absolute, files):
            raise ConfigError(f"{path} is named twice as a file to write; give two names")
        if path is not None:
            files[path] = format
    return files


def _check_outputs(
    files: Mapping[Path, DetectionFormat],
    options: Mapping[Path | None, str],
    overlay: Path | None,
    paths: Sequence[Path],
) -> None:
    """Raise before the computation the errors that would prevent writing afterwards. `options`: those that name a file;
    the others are from --output."""
    for file, format in files.items():
        option = options.get(file, "--output")
        check_file(option, file, paths)
        if reason := next(filter(None, map(format.refusal, map(str, paths))), None):
            raise ConfigError(f"{option}: {reason}")
    if overlay is not None:
        from rcdn.io import check_writable

        check_writable(overlay / "overlay.png")


def _check_pattern(pattern: PatternName, board: GridSize | None, formats: Iterable[DetectionFormat]) -> None:
    """Raise for options that don't apply to a board of triangles."""
    if pattern is not PatternName.deltille:
        return
    if board is not None:
        raise ConfigError("--board: a size has no meaning for a deltille; leave it out")
    for format in formats:
        if format.squares_only:
            raise ConfigError(f"{format.squares_only}; write --json for a deltille")


def _detect_all(run: _Run, paths: Sequence[Path], work: Work, team: _Team, overlay: Path | None) -> None:
    """Process all pictures and fill `run`. An interrupt, or a full disk, ends the run early but loses no results."""
    names = OverlayNames(paths) if overlay is not None else None
    try:
        with (
            progress(len(paths)) as bar,
            closing(PictureWarnings(bar.warn)) as warnings,
            closing(read_ahead(paths, decode=team.alone, cache=work.cache)) as pictures,
            closing(team.compute((_placed(p, overlay, names) for p in pictures), work, team.jobs)) as results,
        ):
            for done in results:
                bar.advance(done.index, done.name)
                for outcome in done.outcomes:
                    run.add(outcome)
                    if isinstance(outcome, Failure):
                        bar.print_error(outcome.message)
                    else:
                        warnings.add(outcome.path, outcome.warnings)
                if done.unwritten is not None:
                    run.undrawn += 1
                    if run.undrawn == 1:  # only the first: a full disk would give one line per picture
                        bar.print_error(str(done.unwritten))
    except KeyboardInterrupt as stopped:
        run.stopped = stopped
    except RcdnError as stopped:
        if not run.tally.images and not run.tally.failures:
            raise
        run.stopped = stopped
    if work.cache is not None:
        work.cache.prune()


def _placed(picture: Picture, folder: Path | None, names: OverlayNames | None) -> Picture:
    """`picture` with the file name for its overlay, assigned here in the order of the inputs, whichever worker draws
    it."""
    if folder is None or names is None:
        return picture
    return replace(picture, overlay=folder / names.take(picture.name))


def _finish(run: _Run, failures: Sequence[RcdnError], total: int) -> None:
    """Report errors that don't concern single pictures, and set the exit code."""
    for failure in failures:
        print_error(str(failure))
    if run.undrawn > 1:
        print_error(f"{run.undrawn} overlays could not be written")
    files = console.named(run.outputs.written)
    written = " and ".join(files)
    verb = "holds" if len(files) == 1 else "hold"
    held = f"; {written} {verb} what was found in them" if written else ""
    if isinstance(run.stopped, KeyboardInterrupt):
        print_stopped(f" after {many(run.tally.images, 'picture')} of {many(total, 'file')}{held}")
        raise typer.Exit(INTERRUPTED)
    if run.stopped is not None:
        print_error(f"{run.stopped} (stopped after {many(run.tally.images, 'picture')}{held})")
    if run.stopped is not None or run.undrawn or failures or run.tally.failures:
        raise typer.Exit(FAILED)
