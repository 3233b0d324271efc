"""Final outputs of `rcdn live`: the camera in three formats, the calibration and its report, as from `rcdn
calibrate`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import CalibrationError, FormatError

if TYPE_CHECKING:
    from rcdn.calibration.guidance.pair_estimate import Moment
    from rcdn.live.folder import Settings
    from rcdn.live.session import Written
    from rcdn.types import Board, Calibration, StereoCalibration

CAMERAS = ("camera.yaml", "camera_info.yaml", "camera.json")
"""the formats of OpenCV, ROS and rcdn"""
PAIR = ("cameras.yaml", "camera_info.yaml", "cameras.json")
"""the formats of OpenCV, ROS (two files) and rcdn for two cameras"""
CALIBRATION, REPORT = "calibration.json", "report.html"


def write_camera_files(folder: Path, names: Sequence[str], boards: Sequence[Board], settings: Settings) -> Written:
    """Calibrate from all `boards` of the pictures `names`, and write the results into `folder`.

    A format that can't hold the lens is skipped and reported; a camera that the pictures don't determine is not
    written, as in `rcdn calibrate` without --force. Raises CalibrationError if the calibration fails.
    """
    from rcdn.batch.pictures import Pictures
    from rcdn.calibration import calibrate
    from rcdn.calibration.next_view import advised
    from rcdn.calibration.observability import undetermined
    from rcdn.calibration.plain_lens import plain_fit
    from rcdn.io import write_camera
    from rcdn.live.folder import PICTURES
    from rcdn.report.calibration import write_report

    paths = [str(folder / PICTURES / name) for name in names]
    done = advised(calibrate(boards, _spacing(settings), names=paths, model=settings.model, size=settings.size))

    def write(path: Path) -> Sequence[Path]:
        write_camera(path, done.camera, fit=plain_fit(str(path), done))
        return [path]

    doubt = "The camera is not written: these pictures don't settle it." if undetermined(done) else ""
    report = lambda path: write_report(path, done, Pictures(paths))  # noqa: E731
    return _write(folder, done, CAMERAS, write, report, doubt)


def write_pair_files(folder: Path, names: Sequence[str], moments: Sequence[Moment], settings: Settings) -> Written:
    """As `write_camera_files`, for two cameras: `moments` are the boards of the left and of the right picture, None
    where one isn't used."""
    from rcdn.batch.pictures import Pictures
    from rcdn.calibration import calibrate_stereo
    from rcdn.calibration.guidance.pair_estimate import by_camera
    from rcdn.calibration.observability import undetermined
    from rcdn.io import write_stereo
    from rcdn.live.folder import SIDES
    from rcdn.report.calibration import write_stereo_report

    spacing = _spacing(settings)
    (left, right), named, pairs = by_camera(moments, names)
    paths = tuple([str(folder / side / n) for n in of] for side, of in zip(SIDES, named, strict=True))
    done = calibrate_stereo(
        left, right, spacing, pairs=pairs, names=(paths[0], paths[1]), model=settings.model, size=settings.size
    )
    open_ = any(undetermined(side) for side in (done.left, done.right))
    doubt = "The cameras are not written: these pictures don't settle them." if open_ else ""
    report = lambda path: write_stereo_report(path, done, Pictures(paths[0]), Pictures(paths[1]))  # noqa: E731
    return _write(folder, done, PAIR, lambda path: write_stereo(path, done), report, doubt)


def _spacing(settings: Settings) -> float:
    if settings.spacing is None:
        raise CalibrationError("the side of a square isn't known")
    return settings.spacing


def _write(
    folder: Path,
    done: Calibration | StereoCalibration,
    formats: Sequence[str],
    write: Callable[[Path], Sequence[Path]],
    report: Callable[[Path], object],
    doubt: str,
) -> Written:
    """Write the calibration `done`, its `report`, and, unless there is a `doubt`, its cameras in all `formats` that can
    hold them; a line tells each of the others."""
    from rcdn.io import write_calibration
    from rcdn.live.session import Written
    from rcdn.terminal.camera_text import advice_lines, verdict_line

    lines = [
        *verdict_line(done.verdict, several=hasattr(done, "left")),
        *advice_lines(done.verdict, done.advice),
        *([doubt] if doubt else []),
    ]
    files: list[Path] = []
    for name in () if doubt else formats:
        try:
            files += write(folder / name)
        except FormatError as error:
            lines.append(f"{name} is not written: {error}")
    report(folder / REPORT)
    write_calibration(folder / CALIBRATION, done)
    return Written((*files, folder / CALIBRATION, folder / REPORT), done.verdict.level, tuple(lines))
