"""`rcdn compare`: the difference of two cameras over the frame, px."""

from __future__ import annotations

import json as json_module
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcdn.batch.paths import check_file
from rcdn.batch.writing import write_each
from rcdn.errors import ConfigError
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.group import FAILED

if TYPE_CHECKING:
    from rcdn.calibration.comparison import Comparison
    from rcdn.types import Array, Calibration, Camera


class Where(StrEnum):
    """The areas of `rcdn.calibration.comparison.compare`."""

    seen = "seen"
    frame = "frame"


def compare(
    first: Annotated[
        Path,
        typer.Argument(
            metavar="A",
            help="A camera file (OpenCV, ROS, Kalibr, COLMAP, mrcal, JSON), or what `rcdn calibrate --json` wrote.",
        ),
    ],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another, of the same frame size.")],
    where: Annotated[
        Where | None,
        typer.Option(
            help="Fit the rotation and take the figures over the area that the corners of both calibrations cover "
            "(seen, the default where a calibration is given), or wherever both cameras have rays (frame)."
        ),
    ] = None,
    camera_name: Annotated[
        list[str] | None,
        typer.Option(
            "--camera-name",
            metavar="NAME",
            help="Which camera of files that hold several: left, cam1, …; given twice: that of A, then that of B.",
        ),
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write figures and the vectors as JSON; - is standard output.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page with the map of the difference.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Compare two cameras: where B sees what A sees, px, after the rotation that brings them together best.

    Parameters alone don't tell: a shift of the principal point is nearly a rotation of the camera. If both files are
    calibrations (`rcdn calibrate --json`), the difference is set against what both state, and said to be within it or
    not.

    Exit code: 0 if they were compared, 1 if not, 2 for wrong use.
    """
    from rcdn.calibration import comparison
    from rcdn.io import write_text
    from rcdn.report.calibration.comparison import write_comparison_report

    console.begin(quiet, [json, report])
    names = camera_name or []
    if len(names) > 2:
        raise ConfigError(f"--camera-name: once for both files, or twice, not {len(names)} times")
    for option, path in (("--json", json), ("--report", report)):
        check_file(option, path, [first, second])
    a, b = _read(first, names[0] if names else None), _read(second, names[-1] if names else None)
    found = comparison.compare(a, b, None if where is None else where.value)
    for line in lines(found, str(first), str(second)):
        console.print_line(line)

    def text() -> str:
        return json_module.dumps(_record(found, first, second), allow_nan=False) + "\n"

    written = write_each(
        [
            (json, lambda path: write_text(path, text())),
            (report, lambda path: write_comparison_report(path, found, (str(first), str(second)), (a, b))),
        ]
    )
    if written:
        console.note_written(written)
    if len(written) < sum(path is not None for path in (json, report)):
        raise typer.Exit(FAILED)


def _read(path: Path, name: str | None) -> Camera | Calibration:
    from rcdn.batch.camera_files import cameras_of
    from rcdn.io import read_calibrations

    members: dict[str, Camera | Calibration] = {**cameras_of(path, name), **read_calibrations(path)}
    if len(members) == 1:
        return next(iter(members.values()))
    if name not in members:
        rejected = f", not {name}" if name else ""
        raise ConfigError(f"{path} holds several cameras; choose one: --camera-name {' | '.join(members)}{rejected}")
    return members[name]


def lines(found: Comparison, first: str, second: str) -> list[str]:
    """The printed lines: the two cameras, the figures, and whether the cameras agree."""
    from rcdn.report.calibration.comparison import figures, judgement, points_of
    from rcdn.terminal.group import one_line

    out = []
    for letter, name, camera in zip("AB", (first, second), found.cameras, strict=True):
        width, height = camera.image_size
        out.append(f"{letter}: {one_line(name)}: {camera.model}, {width}×{height} px")
    out.append(f"Where B sees what A sees, at {points_of(found)}:")
    rows = figures(found)
    wide = max(len(name) for name, _ in rows)
    out += [f"  {name:<{wide}}  {value}" for name, value in rows]
    return [*out, *judgement(found)]


def _record(found: Comparison, first: Path, second: Path) -> dict[str, Any]:
    from rcdn.io.cameras.ours import camera_record
    from rcdn.io.fields import nullable
    from rcdn.report.calibration.comparison import statistics

    stated = found.agreement
    spots = {"middle": found.middle, "corners": found.ends}
    agreement = stated and {
        "rms": nullable(stated.rms),
        "expected_99": nullable(stated.expected),
        "probability": nullable(stated.probability),
        "agree": stated.agree,
        "pictures_shared": found.shared,
        "deviation": _rounded(stated.deviation),
        "ratio": _rounded(stated.ratio),
    }
    return {
        "version": 1,
        "kind": "camera difference",
        "files": [str(first), str(second)],
        "cameras": [camera_record(c) for c in found.cameras],
        "where": found.where,
        **{name: nullable(value) for name, value in statistics(found).items()},
        **{name: nullable(value) for name, value in spots.items()},
        "rotation": nullable(found.found.rotation),
        "agreement": agreement,
        "points": nullable(found.found.points),
        "vectors": _rounded(found.found.vectors),
        "inside": found.inside.astype(int).tolist(),
    }


def _rounded(values: Array) -> Any:
    """Rounded to a millionth: further digits aren't significant."""
    from rcdn.io.fields import nullable

    return nullable(values.round(6))
