"""`rcdn evaluate deltille`: boards of triangles, the paper's section 4.5."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcdn.terminal import console
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def deltille(
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", envvar="RCDN_DATA", help="The folder that holds deltille-libcbdetect, two real pictures."
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Rendered scenes, and as many without a deltille.")] = 100,
    views: Annotated[int, typer.Option(min=8, help="Rendered views to calibrate from.")] = 40,
    json: Json = None,
) -> None:
    """Deltilles: rendered scenes, clutter, two real pictures, calibration and pose beside the
    paper's (about 8 minutes).

    `recall`, `precision`: of corners in boards, at 2 px; of those in the picture that can be placed to within 0.25 px
    at its noise, and `of all` (deep shadows hide some); `whole`: pictures with all of the former and nothing false.
    `cal`: calibrated from every second view, `pose`: only poses of the others, root mean square lengths of reprojection
    errors, px; the views have noise of 5 grey levels and blur of 1 px. Without the real pictures
    their rows are left out.
    """
    from rcdn_lab.paper import deltille as suite
    from rcdn_lab.paper.claim import lines

    check_files(json)
    with bar("rendered scenes") as step:
        rendered = suite.scenes(count, step)
    with bar("clutter") as step:
        alarms = suite.clutter(count, step)
    pictures = suite.real(data)
    with bar("calibration") as step:
        camera = suite.calibration(views, step)
    rows = [rendered, alarms, *pictures, camera]
    columns = list(dict.fromkeys(key for row in rows for key in row))
    settings = {
        "count": count,
        "views": views,
        "noise": suite.NOISE,
        "blur": suite.BLUR,
        "radius": suite.RADIUS,
        "unsure": suite.UNSURE,
    }
    show([{key: row.get(key) for key in columns} for row in rows], json, "deltille", settings)
    if not pictures:
        console.print_line(f"skipped: the real pictures; --data DIR must name the folder that holds {suite.PICTURES}")
    for text in lines(suite.claims(rendered, alarms, pictures, camera)):
        console.print_line(text)
