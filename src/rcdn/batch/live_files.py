"""Final outputs of `rcdn live`: the camera in three formats, the calibration and its report, as from `rcdn
calibrate`."""

from __future__ import annotations

from collections.abc import Sequence
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
CALIBRATION, REPORT = "calibration.json", "report.html"


def write_camera_files(folder: Path, names: Sequence[str], boards: Sequence[Board], settings: Settings) -> Written:
    """Calibrate from all `boards` of the pictures `names`, and write the results into `folder`.

    A format that can't hold the lens is skipped and reported; a camera that the pictures don't determine is not
    written, as in `rcdn calibrate` without --force. Raises CalibrationError if the calibration fails.
    """
    from rcdn.batch.pictures import Pictures
    from rcdn.calibration import calibrate
    from rcdn.calibration.next_view import advised
    from rcdn.calibration.observability import unsettled
    from rcdn.io import write_calibration
    from rcdn.live.folder import PICTURES
    from rcdn.live.session import Written
    from rcdn.report.calibration import write_report
    from rcdn.terminal.camera_text import advice_lines, verdict_line

    if settings.spacing is None:
        raise CalibrationError("the side of a square isn't known")
    paths = [str(folder / PICTURES / name) for name in names]
    done = advised(calibrate(boards, settings.spacing, names=paths, model=settings.model, size=settings.size))
    lines = [*verdict_line(done.verdict), *advice_lines(done.verdict, done.advice)]
    files: list[Path] = []
    if unsettled(done):
        lines.append("The camera is not written: these pictures don't settle it.")
    else:
        files += _cameras(folder, done, lines)
    write_report(folder / REPORT, done, Pictures(paths))
    write_calibration(folder / CALIBRATION, done)
    return Written((*files, folder / CALIBRATION, folder / REPORT), done.verdict.level, tuple(lines))


PAIR = ("cameras.yaml", "camera_info.yaml", "cameras.json")
"""the formats of OpenCV, ROS (two files) and rcdn for two cameras"""


def write_pair_files(folder: Path, names: Sequence[str], moments: Sequence[Moment], settings: Settings) -> Written:
    """As `write_camera_files`, for two cameras: `moments` are the boards of the left and of the right picture, None
    where one isn't used."""
    from rcdn.batch.pictures import Pictures
    from rcdn.calibration import calibrate_stereo
    from rcdn.calibration.guidance.pair_estimate import by_camera
    from rcdn.calibration.observability import unsettled
    from rcdn.io import write_calibration
    from rcdn.live.folder import SIDES
    from rcdn.live.session import Written
    from rcdn.report.calibration import write_stereo_report
    from rcdn.terminal.camera_text import advice_lines, verdict_line

    if settings.spacing is None:
        raise CalibrationError("the side of a square isn't known")
    (left, right), named, pairs = by_camera(moments, names)
    paths = tuple([str(folder / side / n) for n in of] for side, of in zip(SIDES, named, strict=True))
    done = calibrate_stereo(
        left, right, settings.spacing, pairs=pairs, names=(paths[0], paths[1]), model=settings.model, size=settings.size
    )
    lines = [*verdict_line(done.verdict), *advice_lines(done.verdict, done.advice)]
    files: list[Path] = []
    if any(unsettled(side) for side in (done.left, done.right)):
        lines.append("The cameras are not written: these pictures don't settle them.")
    else:
        files += _pair(folder, done, lines)
    write_stereo_report(folder / REPORT, done, Pictures(paths[0]), Pictures(paths[1]))
    write_calibration(folder / CALIBRATION, done)
    level = "unsure" if done.verdict is None else done.verdict.level
    return Written((*files, folder / CALIBRATION, folder / REPORT), level, tuple(lines))


def _pair(folder: Path, done: StereoCalibration, lines: list[str]) -> list[Path]:
    """As `_cameras`, for two."""
    from rcdn.io import write_stereo

    written: list[Path] = []
    for name in PAIR:
        try:
            written += write_stereo(folder / name, done)
        except FormatError as error:
            lines.append(f"{name} is not written: {error}")
    return written


def _cameras(folder: Path, done: Calibration, lines: list[str]) -> list[Path]:
    """Write the camera in all formats that can hold it; a line for each of the others is added to `lines`."""
    from rcdn.io import write_camera

    written = []
    for name in CAMERAS:
        try:
            write_camera(folder / name, done.camera)
        except FormatError as error:
            lines.append(f"{name} is not written: {error}")
        else:
            written.append(folder / name)
    return written
