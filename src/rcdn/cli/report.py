"""`rcdn report`: the report of a saved calibration of a camera, a pair or a rig."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.paths import check_file
from rcdn.batch.pictures import Pictures
from rcdn.terminal.options import PicturePlaces

if TYPE_CHECKING:
    from rcdn.types import BoardView


def report(
    calibration: Annotated[Path, typer.Argument(metavar="FILE", help="What `rcdn calibrate --json` wrote.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The page to write.")] = Path(
        "report.html"
    ),
    shown: PicturePlaces = None,
) -> None:
    """Write the page of a calibration (of a camera, a pair or a rig) again, from its JSON;
    photographs that are still where they were are drawn in, and those that are found in --pictures.

    Only those in the JSON's own folder, or in --pictures: a file from elsewhere could name any picture of yours.

    Exit code: 0 if it was written, 1 if not, 2 for wrong use.
    """
    check_file("--output", output, [calibration])
    for note in dict.fromkeys(filter(None, _written(calibration, output, shown))):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"written: {output}", err=True)


def _written(file: Path, output: Path, shown: Sequence[Path] | None) -> list[str]:
    """Writes the page, and returns notes on pictures that aren't drawn in. Raises FormatError if `file` isn't the
    calibration of a camera, a pair or a rig."""
    from rcdn.io import read_calibration, read_rig_calibration, read_stereo_calibration
    from rcdn.report.calibration import write_report, write_rig_report, write_stereo_report

    kind = _kind(file)
    if kind == "rig":
        rig = read_rig_calibration(file)
        views = [v for camera in rig.cameras.values() for v in camera.views]
        each = {name: _of(camera.views, file, shown, views) for name, camera in rig.cameras.items()}
        write_rig_report(output, rig, each)
        return [pictures.left_out for pictures in each.values()]
    if kind == "stereo calibration":
        pair = read_stereo_calibration(file)
        views = [*pair.left.views, *pair.right.views]
        left, right = (_of(side.views, file, shown, views) for side in (pair.left, pair.right))
        write_stereo_report(output, pair, left, right)
        return [left.left_out, right.left_out]
    mono = read_calibration(file)
    pictures = _of(mono.views, file, shown)
    write_report(output, mono, pictures)
    return [pictures.left_out]


def _kind(file: Path) -> str:
    """What rcdn's JSON holds."""
    from rcdn.io.cameras import ours
    from rcdn.io.fields import read_text

    return str(ours.load(str(file), read_text(file)).get("kind"))


def _of(
    views: Sequence[BoardView], file: Path, shown: Sequence[Path] | None, of_all: Sequence[BoardView] = ()
) -> Pictures:
    """The photographs of a camera's `views`; `of_all`: the views of all cameras."""
    names = [v.name for v in views]
    return Pictures(names, dict.fromkeys(names, file.parent), shown or (), (v.name for v in of_all))
