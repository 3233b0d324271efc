"""`rcdn evaluate selected`: cameras from a few selected photographs compared with those from as many random ones."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show

if TYPE_CHECKING:
    from rcdn.types import Board
    from rcdn_lab.calibration.sets import CameraSet


def selected(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="The folder that holds the public sets' folders.")],
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
) -> None:
    """Photographs: how near the camera of 8, 10 and 12 selected pictures comes to that of all,
    beside as many at random.

    Sets with boards in at least 20 pictures. Differences are root mean squares over the frame, px, after the best
    rotation; `random`: the median of nine choices. `rcdn calibrate --select` selects so.
    """
    from rcdn_lab import selected as suite

    check_files(json)
    rows = []
    for one, boards in _sets(data, cache):
        with bar(one.name):
            rows.append(suite.row_of(one, boards))
    show(rows, json, "selected", {})


def _sets(data: Path, cache: Path | None) -> Iterator[tuple[CameraSet, list[Board]]]:
    """The public sets that are large enough, with the board of each picture."""
    from rcdn.batch.cache import open_cache
    from rcdn.batch.inputs import gather
    from rcdn.config import DetectorConfig
    from rcdn_lab import selected as suite
    from rcdn_lab.calibration.sets import SETS

    config = DetectorConfig()
    for one in SETS:
        files = [str(p) for p in one.files(data)]
        if len(files) < suite.FEWEST:
            continue
        got = gather(files, config, cache=open_cache(config, cache))
        boards = suite.boards_of(one, [i.boards[0] for i in got.images if i.boards])
        if len(boards) >= suite.FEWEST:
            yield one, boards
