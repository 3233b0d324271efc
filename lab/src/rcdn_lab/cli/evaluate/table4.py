"""`rcdn evaluate table4`: calibration and pose errors compared with the paper's."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from rcdn.errors import present
from rcdn.terminal import console
from rcdn_lab.cli.evaluate._table import Json, bar, check_files, write_csv


def table4(
    data: Annotated[
        Path | None,
        typer.Option(
            envvar="RCDN_DATA",
            metavar="DIR",
            help="The folder of the photographs' folders. Without it: the rendered pair only.",
        ),
    ] = None,
    sets: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME",
            help="rendered, opencv-left-right, sourishg-stereo1, rochade-gopro-a, udacity-wide, or one camera as in "
            "`rcdn evaluate calibration --set`. May be given again; default: these five.",
        ),
    ] = None,
    detectors: Annotated[
        str, typer.Option(metavar="NAME,…", help="auto, paper, and peers that find boards.")
    ] = "auto,paper,opencv,opencv-sb,boofcv-size,geiger,rochade,ocpad,ocamcalib",
    views: Annotated[int, typer.Option(min=12, help="Of the rendered pair, half of them to calibrate from.")] = 30,
    full: Annotated[bool, typer.Option("--full", help="100 views, as many as the paper has.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the rendered pair.")] = 0,
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also keep the rendered pictures, in this new or empty folder.")
    ] = None,
    json: Json = None,
    csv: Annotated[Path | None, typer.Option(help="Also write the rows to this file.")] = None,
    markdown: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the tables of docs/paper-results.md to this file.")
    ] = None,
) -> None:
    """Calibrate on half of the views, solve poses on the others: the paper's section 4.4.

    On a rendered stereo pair with known truth, and on photographs; the cameras of a set count together. `on all`: the
    largest board of each picture, parts too, no corner left out; `on common`: the pictures in which all find the whole
    board, the same corners; `on with NAME`: the same for one that finds too few of them. `cal`, `pose`: root mean
    square reprojection error, px, of the half calibrated from and of the other, both directions, median of 5 splits;
    `÷ opencv`: over that of OpenCV's corners on the same pictures, with the paper's ratio and the difference: its
    pictures aren't public. `outliers`: corners that `rcdn.calibrate` would leave out. Against the truth: `mean`, `rms`
    of found corners, `95 %` of all true ones (missing count); `focal`, `centre`; `rotation`, `translation` of held-out
    poses; `model`: all true corners from where camera and pose see them; `baseline`, `turn` of the stereo pair. The
    paper's rows are marked.

    The rendered boards are perfectly flat and come from our own renderer: they flatter our presets; photographs don't.
    About 10 minutes of two cores, 4 without photographs; --full: 20.
    """
    from functools import partial
    from tempfile import TemporaryDirectory

    from rcdn.batch.cache import Cache, fingerprint, open_cache
    from rcdn.batch.pool import usable_cores
    from rcdn.config import DetectorConfig
    from rcdn_lab.calibration import contestants
    from rcdn_lab.paper import table4 as suite
    from rcdn_lab.paper import table4_work as work

    check_files(json, csv, markdown)
    opened = present(open_cache(DetectorConfig(), cache), "the cache")
    store = (fingerprint, partial(Cache, opened.folder))
    found, missing = contestants([n.strip() for n in detectors.split(",") if n.strip()], *store)
    count, texts, many = suite.FULL_VIEWS if full else views, sets or suite.NAMES, workers or usable_cores()
    used, skipped = suite.sets_of(texts, data)
    with TemporaryDirectory(prefix="rcdn-") as folder:
        if suite.RENDERED in texts:
            pair, drawings = suite.rendered(count, seed, _new(pictures) or Path(folder))
            used.insert(0, pair)
            with bar("rendering") as step:
                work.draw(drawings, many, step)
        with bar("looking for boards") as step:
            work.fill(suite.sized_pictures(used), [d.name for d in found], *store, many, step)
        with bar("calibrating") as step:
            rows = suite.table(used, found, missing, skipped, many, step)
    settings = suite.settings_of(used, found, count, seed) | {"skipped": missing | skipped}
    _write_results(rows, settings, json, csv, markdown)


def _new(folder: Path | None) -> Path | None:
    """`folder`, created if it does not exist. Raises ConfigError if it is not empty: existing pictures would be
    counted."""
    from rcdn.errors import ConfigError

    if folder is None:
        return None
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"--pictures {folder}: name a new or an empty folder")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write_results(
    rows: list[dict[str, Any]], settings: dict[str, Any], json: Path | None, csv: Path | None, markdown: Path | None
) -> None:
    """Print the tables, and write the requested files."""
    from dataclasses import asdict

    from rcdn.io import write_text
    from rcdn.provenance import provenance
    from rcdn_lab.paper import table4_published as published
    from rcdn_lab.paper.claim import lines
    from rcdn_lab.results import save

    stated = published.claims(rows)
    if csv is not None:
        write_csv(rows, csv)
    if markdown is not None:
        write_text(markdown, published.markdown(rows, stated))
    if json is not None:
        save(json, "table4", settings | {"claims": [asdict(c) for c in stated]}, rows)
    for table in published.tables(rows):
        console.print_line(table.text() + "\n")
    for line in lines(stated):
        console.print_line(line)
    facts = provenance()
    console.print_line(
        f"rcdn {facts['rcdn']} at {facts['commit']}, seed {settings['seed']}, {facts['date']}, {facts['platform']}, "
        f"{facts['cpus']} CPUs"
    )
