"""`rcdn evaluate rig-shifts`: videos of a rig put out of step by known numbers of frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def rig_shifts(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDERS...", help="That hold rig-caliscope.")],
    camera: Annotated[str, typer.Option(help="The camera whose frames are shifted.")] = "cam_3",
    json: Json = None,
) -> None:
    """Frames of one of four real videos numbered one or two too early or too late: is that found and corrected?

    Lenses are those of each camera alone. true: the shift, with what is found of the videos as they are;
    epipolar_px: of moments held out.
    """
    from rcdn_lab import rig_shifts as suite
    from rcdn_lab.cli.evaluate.real_rigs import CODED
    from rcdn_lab.real_rigs.sets import SETS, shots_of

    check_files(json)
    each = next(s for s in SETS if s.name == "caliscope")
    folder = each.inside(folders)
    if folder is None:
        raise typer.BadParameter(f"{each.folder} is in none of these folders", param_hint="FOLDERS")
    with bar(each.name) as step:
        shots = shots_of(each, folder, step)
    if camera not in shots.boards:
        raise typer.BadParameter(f"the cameras are {', '.join(shots.boards)}", param_hint="--camera")
    cameras = suite.lenses(shots, CODED)
    bare = suite.rig(suite.shifted(shots, camera, 0), cameras, CODED, correct=True).shifts or {}
    base = {name: s.moments for name, s in bare.items()}
    rows = [suite.row_of(shots, cameras, CODED, camera, by, base) for by in (0, 1, -1, 2, -2)]
    show(rows, json, "rig-shifts", {"camera": camera, "as_they_are": base})
