"""`rcdn evaluate calibration`, `repeatability` and `trust`: accuracy of cameras, and validity of their standard
deviations."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from rcdn.errors import present
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show


def calibration(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="The folder that holds the sets' folders.")],
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME|NAME:PATTERN:COLSxROWS:MODEL",
            help="A known set, or pictures of one camera: a pattern in DATA, inner corners, lens model "
            "(pinhole, brown, rational, fisheye). May be given again; default: all known sets.",
        ),
    ] = None,
    detectors: Annotated[
        str, typer.Option(metavar="NAME,…", help="auto, paper, auto-fit, auto-first, and peers.")
    ] = "auto,paper,opencv,opencv-sb,boofcv-size",
    shape: Annotated[
        bool, typer.Option("--shape", help="On common pictures, solve for the shape of the board, too.")
    ] = False,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
    markdown: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Also write the tables of docs/calibration-results.md to this file."),
    ] = None,
) -> None:
    """Calibrations from the corners of several detectors by one solver, on photographs: the paper's section 4.4.

    `on all`: all boards that a detector found, outliers left out; `on common`: the pictures in which everybody found
    the whole board, everybody's same corners, equal weights, none left out; `on agreed`: these without anybody's
    outliers; `on with NAME`: pictures in common with one that finds too few whole boards to be compared with all. Root
    mean square lengths of the reprojection errors, px: `fit`: calibrated from all; `cal` and `pose`: calibrated from
    half of the pictures, and poses only on the other half, both directions, median of 5 splits; `unsteady`: worst split
    ÷ median; `folds`: poses of held-out fifths; `camera`: the same with these cameras, but poses and errors of the
    peers' corners: one measure for everybody. `auto, by sigma`: each corner weighs by its sigma.
    """
    from rcdn.batch.cache import Cache, fingerprint, open_cache
    from rcdn.config import DetectorConfig
    from rcdn.io import write_text
    from rcdn_lab import calibration as suite

    check_files(json, markdown)
    opened = present(open_cache(DetectorConfig(), cache), "the cache")
    folder = opened.folder
    names = [name.strip() for name in detectors.split(",") if name.strip()]
    found, missing = suite.contestants(names, fingerprint, lambda salt: Cache(folder, salt))
    with bar("looking for boards") as step:
        rows = suite.table(data, chosen := suite.chosen(sets or ()), found, missing, shape, step)
    if markdown is not None:
        write_text(markdown, suite.markdown(rows))
    show(rows, json, "calibration", suite.settings_of(chosen, found, shape) | {"skipped": missing})


def repeatability(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="The folder that holds the sets' folders.")],
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME|NAME:PATTERN:COLSxROWS:MODEL",
            help="A known set, or pictures of one camera; MODEL is what OpenCV's solver gets. May be given again; "
            "default: all known sets of ten pictures and more.",
        ),
    ] = None,
    splits: Annotated[int, typer.Option(min=1, help="Random splits of each set.")] = 8,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
) -> None:
    """Do cameras repeat, by as much as they state? Random halves of the photographs of one camera, calibrated apart.

    `px`: how far the cameras of two halves differ over the area with corners after the best rotation (root mean square;
    `median px` over the splits). `difference / stated`: difference of fx, fy, cx, cy ÷ what both state, root mean
    square (chance: 1), `within 1` the share within one standard deviation (.683); the same of projections. `auto` is
    rcdn.calibrate, `opencv` is OpenCV's solver on the same corners.
    """
    from functools import partial

    from rcdn.batch.cache import open_cache
    from rcdn.batch.inputs import gather
    from rcdn.config import DetectorConfig
    from rcdn_lab import calibration as known
    from rcdn_lab import repeatability as suite

    check_files(json)
    config = DetectorConfig()
    chosen = known.chosen(sets or ())
    found = []
    with bar("calibrating") as step:
        for k, cameras in enumerate(chosen):
            images = gather([str(f) for f in cameras.files(data)], config, cache=open_cache(config, cache)).images
            boards = [b for image in images for b in image.boards]
            names = [image.path for image in images for _ in image.boards]
            if sets or len(set(names)) >= suite.FEWEST:
                solvers: dict[str, suite.Solver] = {
                    "auto": suite.ours,
                    "opencv": partial(suite.opencv, model=cameras.model),
                }
                found += [suite.repeat(cameras.name, boards, names, s, solve, splits) for s, solve in solvers.items()]
            if step is not None:
                step(k + 1, len(chosen))
    rows = [suite.row(f) for f in found] + suite.summary(found)
    show(rows, json, "repeatability", {"splits": splits, "sets": [c.name for c in chosen]})


def trust(
    runs: Annotated[int, typer.Option(min=3, help="Calibrations of each lens model and kind of boards.")] = 40,
    models: Annotated[
        str, typer.Option(metavar="NAME,…", help="Lens models to simulate.")
    ] = "pinhole,brown,fisheye,rational",
    boards: Annotated[
        str, typer.Option(metavar="KIND,…", help="Kinds of boards: flat, uneven, paper.")
    ] = "flat,uneven,paper",
    json: Json = None,
) -> None:
    """Do the stated standard deviations hold? Simulated calibrations, and how often the truth lies within them.

    Each run: 20 views of a 9×6 board of 30 mm squares, parts included, noise of 0.1, 0.3 and 1 px in turn, 5 % of the
    corners thrown 5 to 40 px away. Boards are flat; or uneven, the same in all views (0.3 % longer in one direction,
    0.1 mm off within the plane, 0.7 mm out of it); or paper held by hand, bent anew by 0.3 mm in every view (root mean
    squares). `within`: share of all parameters within one standard deviation (chance: .683), `within2` within two
    (.954), `spread`: root mean square of error ÷ deviation (1); then shares within one at each noise, of fx and fy, of
    fx ÷ fy, of cx and cy, and of the lens. About 10 minutes on one core.
    """
    from rcdn_lab import trust as suite

    names, kinds = _listed("--models", models, suite.MODELS), _listed("--boards", boards, suite.BOARDS)
    check_files(json)
    rows = []
    with bar("calibrating") as step:
        for k, (name, kind) in enumerate(product(names, kinds)):
            rows.append(suite.row(suite.trust(name, runs, boards=kind)))
            if step is not None:
                step(k + 1, len(names) * len(kinds))
    settings = {"runs": runs, "views": 20, "noise": list(suite.NOISES), "outliers": suite.OUTLIERS}
    boards_are = {"stretch": suite.STRETCH, "print error": suite.PRINT_ERROR, "bend": suite.BEND, "paper": suite.PAPER}
    show(rows, json, "trust", settings | {"boards": boards_are})


def _listed(option: str, text: str, known: Sequence[str]) -> list[str]:
    """The comma-separated names in `text`; ConfigError for one that is not `known`."""
    from rcdn.errors import ConfigError

    names = [name.strip() for name in text.split(",") if name.strip()]
    if unknown := [n for n in names if n not in known]:
        raise ConfigError(f"{option}: {unknown[0]!r} isn't one of {', '.join(known)}")
    return names
