"""`rcdn report`: the page of a calibration that was saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.cli import _batch
from rcdn.cli._pictures import Pictures
from rcdn.errors import FormatError

if TYPE_CHECKING:
    from rcdn.types import BoardView


def report(
    calibration: Annotated[Path, typer.Argument(metavar="FILE", help="What `rcdn calibrate --json` wrote.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The page to write.")] = Path(
        "report.html"
    ),
) -> None:
    """Write the page of a calibration again, from its JSON; photographs that are still where they were are drawn in.

    Exit code: 0 if it was written, 1 if not, 2 for wrong use.
    """
    from rcdn.io import read_calibration, read_stereo_calibration
    from rcdn.report.calibration import write_report, write_stereo_report

    _batch.check_file("--output", output, [calibration])
    try:
        mono = read_calibration(calibration)
    except FormatError as error:
        try:
            pair = read_stereo_calibration(calibration)
        except FormatError:
            raise error from None
        write_stereo_report(output, pair, _of(pair.left.views), _of(pair.right.views))
    else:
        write_report(output, mono, _of(mono.views))
    typer.echo(f"written: {output}", err=True)


def _of(views: Sequence[BoardView]) -> Pictures:
    return Pictures(v.name for v in views)
