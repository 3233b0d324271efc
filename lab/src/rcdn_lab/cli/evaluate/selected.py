"""`rcdn evaluate selected`: cameras from a few selected photographs compared with those from as many others."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn_lab.cli.evaluate._table import Json, bar, check_files, show

if TYPE_CHECKING:
    from rcdn.types import Board
    from rcdn_lab.selected import Pictures


def selected(
    data: Annotated[Path, typer.Argument(metavar="DATA", help="The folder that holds the public sets' folders.")],
    videos: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Also a video of a coded board. May be given several times."),
    ] = None,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Where detections are kept.")] = None,
    json: Json = None,
) -> None:
    """Photographs: how near the camera of 8, 10 and 12 selected pictures comes to that of all, compared with the
    cameras of as many at random and as many evenly spaced ones.

    Sets with boards in at least 20 pictures, and videos with a board in at least 16 frames. Differences are root mean
    squares over the frame, px, after the best rotation; `random`: the median of nine choices. `rcdn calibrate --select`
    selects so.
    """
    from rcdn_lab import selected as suite

    check_files(json)
    rows = []
    for one in (*_sets(data, cache), *_videos(videos or [], cache)):
        with bar(one.name):
            rows.append(suite.row_of(one))
    show(rows, json, "selected", {"videos": [v.name for v in videos or []]})


def _sets(data: Path, cache: Path | None) -> Iterator[Pictures]:
    """The public sets that are large enough, with the boards that show the set's board whole, or at least from end to
    end."""
    from rcdn_lab import selected as suite
    from rcdn_lab.calibration.sets import SETS

    for one in SETS:
        files = [str(p) for p in one.files(data)]
        if len(files) < suite.FEWEST["photographs"]:
            continue
        boards = tuple(b for b in _boards(files, cache) if sorted(b.size) == sorted(one.size))
        if len(boards) >= suite.FEWEST["photographs"]:
            yield suite.Pictures(one.name, one.model, one.size, boards)


def _videos(files: list[Path], cache: Path | None) -> Iterator[Pictures]:
    """The videos that show enough boards whose codes were read."""
    from rcdn_lab import selected as suite

    for file in files:
        boards = tuple(b for b in _boards([str(file)], cache) if b.ids is not None)
        if len(boards) >= suite.FEWEST["video"]:
            yield suite.Pictures(file.stem, "brown", None, boards)


def _boards(files: list[str], cache: Path | None) -> list[Board]:
    """The first board of each picture or frame."""
    from rcdn.batch.cache import open_cache
    from rcdn.batch.inputs import gather
    from rcdn.config import DetectorConfig

    config = DetectorConfig()
    got = gather(files, config, cache=open_cache(config, cache))
    return [i.boards[0] for i in got.images if i.boards]
