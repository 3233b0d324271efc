"""`rcdn evaluate real-rigs`: rigs of real cameras, moments held out, beside OpenCV's solver."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.terminal import console
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show

CODED = 0.054
"""m: the side of a square of the coded sets' board; plain ones count in their own squares"""


def real_rigs(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDERS...", help="That hold the sets: boof-trinocular, opencv-left-right, rig-caliscope, …"
        ),
    ],
    parts: Annotated[int, typer.Option(min=2, help="Parts of each set's moments, each held out in turn.")] = 4,
    json: Json = None,
) -> None:
    """Rigs of real cameras: boards of moments that were held out, by our rig and by OpenCV's
    calibrateMultiview from the same corners.

    Corners that two cameras or more saw are triangulated: step_permille is the RMS error of the lengths between
    neighbours, ÷ the spacing, span_permille that of rows and columns from end to end; step_scatter and span_scatter
    are the standard deviations of the same length at different moments, ‰, which need no perfect board; rays_px is from
    corners to their triangulated points, board_px to the board in the pose that fits all cameras, RMS. Our lenses are
    of the models that are chosen, and once of OpenCV's (brown). OpenCV is given whole boards, and once parts of coded
    ones, too. A part for which a solver gives no rig has failed. Rigs that other programs left are scored on all
    moments. Then, of three cameras: how T_c_a by way of b differs from T_c_a, each pair calibrated apart, in stated
    deviations.
    """
    from rcdn.io import read_rig
    from rcdn_lab.real_rigs import run as suite
    from rcdn_lab.real_rigs.sets import SETS, shots_of

    check_files(json)
    rows: list[dict[str, Any]] = []
    for each in SETS:
        if (folder := each.inside(folders)) is None:
            continue
        with bar(each.name) as step:
            shots = shots_of(each, folder, step)
        spacing = CODED if each.size is None else 1.0
        names = {"set": each.name, "cameras": len(shots.boards)}
        for solver in suite.SOLVERS:
            if solver == suite.PARTS and each.size is not None:
                continue  # plain boards are whole ones
            rows.append({**names, "solver": solver, **suite.held_out(shots, solver, spacing, parts)})
        if each.other:
            rows.append(
                {
                    **names,
                    "solver": each.other,
                    **suite.of_rig(suite.renamed(read_rig(folder / each.other), shots), shots, spacing),
                }
            )
        if len(shots.boards) == 3:
            rows.append({**names, "solver": "pairs", **suite.closing(shots, spacing)})
    if not rows:
        raise typer.BadParameter(
            f"none of {', '.join(s.folder for s in SETS)} is in these folders", param_hint="FOLDERS"
        )
    show(_filled(rows), json, "real-rigs", {"parts": parts})
    compared = [
        (r, next(o for o in rows if o["set"] == r["set"] and o["solver"] == "opencv"))
        for r in rows
        if r["solver"] == "rcdn"
    ]
    better = sum(not a["step_permille"] > b["step_permille"] for a, b in compared)
    console.print_line(f"lengths not worse than OpenCV's in {better} of {len(compared)} sets")


def _filled(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """All with all columns."""
    columns = dict.fromkeys(k for row in rows for k in row)
    return [{k: row.get(k) for k in columns} for row in rows]
