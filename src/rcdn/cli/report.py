"""`rcdn report`: the report of a saved calibration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.paths import check_file
from rcdn.batch.pictures import Pictures
from rcdn.errors import FormatError
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
    """Write the page of a calibration again, from its JSON; photographs that are still where they were are drawn in.

    Only those in the JSON's own folder, or in --pictures: a file from elsewhere could name any picture of yours.

    Exit code: 0 if it was written, 1 if not, 2 for wrong use.
    """
    from rcdn.io import read_calibration, read_stereo_calibration
    from rcdn.report.calibration import write_report, write_stereo_report

    check_file("--output", output, [calibration])
    try:
        mono = read_calibration(calibration)
    except FormatError as error:
        try:
            pair = read_stereo_calibration(calibration)
        except FormatError:
            raise error from None
        left, right = (_of(side.views, calibration, shown) for side in (pair.left, pair.right))
        write_stereo_report(output, pair, left, right)
        notes = [left.left_out, right.left_out]
    else:
        pictures = _of(mono.views, calibration, shown)
        write_report(output, mono, pictures)
        notes = [pictures.left_out]
    for note in dict.fromkeys(filter(None, notes)):
        typer.echo(f"note: {note}", err=True)
    typer.echo(f"written: {output}", err=True)


def _of(views: Sequence[BoardView], file: Path, shown: Sequence[Path] | None) -> Pictures:
    names = [v.name for v in views]
    return Pictures(names, dict.fromkeys(names, file.parent), shown or ())
