"""The steps of `rcdn calibrate` for one camera or two: detection, calibration, printed summary and output files."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.batch.calibration_outputs import Outputs
from rcdn.batch.detection_settings import DetectionSettings
from rcdn.batch.no_board import note_target
from rcdn.batch.pair_file import PairFile
from rcdn.batch.video_rates import rates_note
from rcdn.errors import CalibrationError, ConfigError, many
from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn.terminal.spacing import Length, Lengths, check_spacing, metres, sizes_of

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered
    from rcdn.batch.moment_file import MomentFile
    from rcdn.batch.pictures import Pictures
    from rcdn.io import ImageResult
    from rcdn.types import Board, Calibration, StereoCalibration, Verdict


REASONS = ("not supported: ", "mirrored: ", "contradictory: ")
"""prefixes of the warnings that state why a detection isn't a board"""

FEWEST_FRAMES = 8
"""fewest frames chosen from the video of each of more than two cameras"""


class BoardReader:
    """Reads the boards of all inputs with the same `settings`, at most `frames` of each video; `failed`: some file
    could not be read or written."""

    def __init__(self, settings: DetectionSettings, frames: int) -> None:
        self.settings, self.frames = settings, frames
        self.failed = False

    @property
    def size(self) -> tuple[int, int] | None:
        """(columns, rows) of the boards, None if not given."""
        return self.settings.size

    def gather(
        self,
        inputs: Sequence[str],
        numbers: tuple[tuple[int, ...], ...] | None = None,
        cameras: int = 1,
        behind: bool = False,
        silent: str | None = None,
    ) -> Gathered:
        """The boards in `inputs`, as by `DetectionSettings.gather`.

        With more than two `cameras`, fewer frames are chosen from each video: in total about twice as many as for one
        camera. Raises CalibrationError if there are no boards.
        """
        frames = self.frames if cameras <= 2 else max(FEWEST_FRAMES, 2 * self.frames // cameras)
        got = self.settings.gather(inputs, numbers, frames=frames, behind=behind, silent=silent)
        self.failed = self.failed or bool(got.failures)
        for note in got.notes:
            console.note(note)
        if not any(image.boards for image in got.images):
            filmed = not got.images and got.examined
            raise CalibrationError(NO_FRAME if filmed else _no_board(got.images))
        note_target(self.settings.config.target, got)
        return got

    def seen_from_behind(self, name: str, inputs: Sequence[str], got: Gathered) -> Gathered:
        """`got` with the boards identified that the camera `name` sees from behind; `got` unchanged if there are
        none."""
        from rcdn.types.limits import READ_IN_A_MIRROR

        some = sum(any(w.startswith(READ_IN_A_MIRROR) for w in image.warnings) for image in got.images)
        if not some:
            return got
        console.note(
            f"{name}: codes run the other way round in {many(some, 'picture')}, which are taken to show the board's "
            "back (a print that shines through, or a mirrored one); if the pictures themselves are mirrored (selfie "
            "mode), flip them first"
        )
        return self.gather(inputs, got.frames or None, behind=True)

    def check(self, got: Gathered, spacing: Length | Lengths) -> None:
        """Name the pictures without a board, and raise ConfigError if the boards contradict --board or --spacing."""
        from rcdn.batch.summary import size_hint_of

        if without := [image.path for image in got.images if not image.boards]:
            names = ", ".join(without[:3]) + (", …" if len(without) > 3 else "")
            console.note(f"no board was found in {len(without)} of {many(len(got.images), 'picture')}: {names}")
        if hint := size_hint_of(got.images, self.size):
            if "squares have" in hint:
                raise ConfigError(f"--board {self.size[0]}x{self.size[1]}: {hint}" if self.size else hint)
            console.note(f"hint: {hint}")
        check_spacing(spacing, sizes_of(flat(got.images)[0], self.size))


@dataclass(frozen=True)
class Problem:
    """The calibration problem: the `spacing` and the lens `model`.

    For one camera: whether its board is `flat`, the views to `leave_out`, the parameters to `fix`, and how many
    pictures to `select`. For several cameras: the files of `cameras` whose lenses are known; for a rig, whether to
    correct its time offsets, and the file of its `moments`, if given.
    """

    spacing: Length | Lengths
    model: str
    flat: bool = False
    leave_out: tuple[str, ...] = ()
    fix: frozenset[str] = frozenset()
    select: int | None = None
    cameras: tuple[Path, ...] = ()
    correct_time: bool = False
    fixed_boards: bool = False
    moments: MomentFile | None = None


def one_camera(reader: BoardReader, inputs: Sequence[str], problem: Problem, outputs: Outputs) -> Verdict | None:
    """Calibrate the camera of `inputs`, print a summary, and write the outputs."""
    from rcdn.batch import camera_files
    from rcdn.calibration.next_view import advised
    from rcdn.io import write_calibration
    from rcdn.report.calibration import write_report
    from rcdn.terminal import camera_text

    got = reader.gather(inputs)
    reader.check(got, problem.spacing)
    done = _solved(reader, problem, *flat(got.images))
    done = advised(done)
    views = camera_text.cut_lines(done) + camera_text.left_out_lines(done)
    _print_results(done, camera_text.camera_lines(done), views)
    reader.failed |= not outputs.write(
        outputs.kept(done),
        lambda path: camera_files.write_calibrated(path, done, outputs.format),
        lambda path: write_calibration(path, done),
        lambda path: write_report(path, done, pictures_of(done, got, outputs)),
    )
    return done.verdict


def _solved(reader: BoardReader, problem: Problem, boards: Sequence[Board], names: Sequence[str]) -> Calibration:
    """The calibration; if `problem.select` is given, only from so many pictures, and by the lens model of all."""
    from rcdn.calibration import calibrate
    from rcdn.calibration.selection import selected

    solve = partial(calibrate, size=reader.size, flat=problem.flat, fix=problem.fix)
    spacing = metres(problem.spacing)
    done = solve(boards, spacing, names=names, model=problem.model, leave_out=problem.leave_out)
    if problem.select is None:
        return done
    lens = problem.model
    if lens == "auto":
        lens = done.models[0].model if done.camera.correction is None else "splined"

    def of_some(some: Collection[str]) -> Calibration:
        kept = [k for k, name in enumerate(names) if name in some]
        return solve([boards[k] for k in kept], spacing, names=[names[k] for k in kept], model=lens)

    some, best = selected(done, problem.select, of_some)
    console.note(
        f"{len(some)} of {len(set(names))} pictures with a board are used, those whose camera is nearest to that of all"
    )
    return best


def two_cameras(
    reader: BoardReader, inputs: Sequence[str], problem: Problem, outputs: Outputs, pair_file: PairFile | None
) -> Verdict | None:
    """Calibrate the left and the right camera of `inputs`, print a summary, and write the outputs."""
    from rcdn.batch import camera_files
    from rcdn.batch.known_cameras import known_pair
    from rcdn.batch.moments import cameras_in
    from rcdn.calibration import calibrate_stereo
    from rcdn.io import write_calibration
    from rcdn.report.calibration import write_stereo_report
    from rcdn.terminal import camera_text
    from rcdn.types.limits import READ_IN_A_MIRROR

    known = known_pair(problem.cameras, list(cameras_in(inputs)))
    outputs = outputs.without_refused(
        lambda path: camera_files.pair_refusal(path, outputs.format, problem.model, known)
    )
    left = reader.gather(inputs[:1], silent=READ_IN_A_MIRROR)
    right = reader.gather(inputs[1:], left.frames or None, silent=READ_IN_A_MIRROR)
    if note := rates_note([left, right]):
        console.note(note)
    left, right = reader.seen_from_behind("left", inputs[:1], left), reader.seen_from_behind("right", inputs[1:], right)
    reader.check(left, problem.spacing)
    reader.check(right, problem.spacing)
    pairs = _paired_boards(left, right, pair_file)
    (boards, names), (others, theirs) = flat(left.images), flat(right.images)
    done = calibrate_stereo(
        boards,
        others,
        metres(problem.spacing),
        pairs=pairs,
        names=(names, theirs),
        model=problem.model,
        size=reader.size,
        cameras=known,
    )
    out = camera_text.left_out_lines(done.left) + camera_text.left_out_lines(done.right)
    _print_results(done, camera_text.stereo_lines(done), out)
    if hint := camera_text.swapped_hint(done):
        console.note(hint)
    shown = partial(pictures_of, of_all=(*names, *theirs))
    reader.failed |= not outputs.write(
        outputs.kept(*(c for c, held in zip((done.left, done.right), known, strict=True) if held is None)),
        lambda path: camera_files.write_pair(path, done, outputs.format),
        lambda path: write_calibration(path, done),
        lambda path: write_stereo_report(
            path, done, shown(done.left, left, outputs), shown(done.right, right, outputs)
        ),
    )
    return done.verdict


def _paired_boards(left: Gathered, right: Gathered, pair_file: PairFile | None) -> list[tuple[int, int]]:
    """(index of the left board, index of the right one) of the same board in paired pictures: boards of the same
    target, else the largest ones."""
    from rcdn.calibration.coded import same_boards

    first, second = _starts(left.images), _starts(right.images)
    return [
        (first[a] + k, second[b] + m)
        for a, b in _paired(left, right, pair_file)
        for k, m in same_boards(left.images[a].boards, right.images[b].boards)
    ]


def _paired(left: Gathered, right: Gathered, pair_file: PairFile | None) -> list[tuple[int, int]]:
    """(index of the left picture, index of the right one) of each pair; prints the rule used where names are
    ambiguous."""
    from rcdn.batch.pairs import pair_names, pairing_hint

    one, two = ([image.path for image in side.images] for side in (left, right))
    if pair_file is not None:
        return pair_file.match(one, two, ([f.name for f in left.failures], [f.name for f in right.failures]))
    found = pair_names(one, two)
    if hint := pairing_hint(one, two, found):
        console.note(one_line(hint))
    return found.pairs


NO_FRAME = "no board was found in the frames that were looked at; see what `rcdn detect VIDEO --overlay DIR` draws"


def _no_board(images: Sequence[ImageResult]) -> str:
    """The message that no board was found in any of the pictures."""
    from rcdn.batch.no_board import markers_hint

    if not images:
        return "no picture was read, so there is nothing to calibrate from"
    reasons = [text for image in images for text in image.warnings if text.startswith(REASONS)]
    if reasons:
        why = f"{len(reasons)} of them: {reasons[0]}"
    else:
        why = markers_hint(image.path for image in images) or (
            "see what `rcdn detect PICTURES --overlay DIR` draws: squares need sharp, dark-light edges"
        )
    return f"no board was found in {many(len(images), 'picture')}; {why}"


def flat(images: Sequence[ImageResult]) -> tuple[list[Board], list[str]]:
    """All boards, and for each board the name of its picture."""
    boards = [board for image in images for board in image.boards]
    return boards, [image.path for image in images for _ in image.boards]


def _starts(images: Sequence[ImageResult]) -> list[int]:
    """For each picture the index of its largest board in the list of all boards."""
    return [0, *accumulate(len(image.boards) for image in images)]


def pictures_of(calibration: Calibration, got: Gathered, outputs: Outputs, of_all: Iterable[str] = ()) -> Pictures:
    """The photographs of a calibration's views, for its report. `of_all`: names of all cameras' pictures."""
    from rcdn.batch.pictures import Pictures

    pictures = Pictures((v.name for v in calibration.views), got.saved, outputs.pictures, of_all)
    if pictures.left_out:
        console.note(f"note: --report: {pictures.left_out}")
    return pictures


def _print_results(done: Calibration | StereoCalibration, lines: Sequence[str], left_out: Sequence[str]) -> None:
    from rcdn.terminal.camera_text import advice_lines, verdict_line

    first = verdict_line(done.verdict, several=hasattr(done, "left"))
    for line in [*first, *lines, *left_out, *advice_lines(done.verdict, done.advice)]:
        console.print_line(line)
