"""Videos of a ChArUco board without truth: frames that are read, and ids on which two readers disagree."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import FormatError
from rcdn.io import frames, is_video
from rcdn.types import Array
from rcdn.types.target import Charuco
from rcdn_lab.coded.readers import GIVEN, OURS, can_read, load, read
from rcdn_lab.peers.coded import Labelled
from rcdn_lab.share_out import share_out

PART = "videos"
APART = 3.0
"""px between two readers' positions of one id, above which one of them is wrong"""
ALL = "ALL"
Task = tuple[Path, Charuco]
Tally = dict[str, list[int]]
"""reader → frames, frames with ids, corners, corners that ours has, too, and those of them with another position in
ours; boards of the reader that are not the target"""


def videos_of(folder: Path) -> list[Task]:
    """The videos next to each `charuco.toml` in or below a folder, and the board that it describes: `columns`, `rows`
    in squares, `dictionary`, `aruco_scale` (marker ÷ square), `inverted`, `legacy_pattern`. Raises FormatError for an
    invalid file."""
    found: list[Task] = []
    for path in sorted(folder.rglob("charuco.toml")):
        try:
            known = tomllib.loads(path.read_text())
            board = Charuco(
                int(known["columns"]), int(known["rows"]), str(known["dictionary"]), float(known["aruco_scale"]),
                legacy=bool(known.get("legacy_pattern", False)), inverted=bool(known.get("inverted", False)),
            )  # fmt: skip
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise FormatError(f"{path}: doesn't describe a ChArUco board: {error!r}") from error
        found += [(video, board) for video in sorted(path.parent.iterdir()) if is_video(video)]
    return found


def table(
    folder: Path, peers: Sequence[str] = (), workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, Any]]:
    """One row for each video and reader, and one over all. `labelled`: frames with ids; `conflicts`: ids that ours has
    elsewhere; `other kind`: boards reported as another target."""
    tasks = videos_of(folder)
    names = (OURS, GIVEN, *peers)
    sums: dict[tuple[str, str], np.ndarray[Any, Any]] = {}
    for (video, _), tally in zip(
        tasks, share_out(partial(_one, names=names), tasks, workers, load, (names,), progress), strict=True
    ):
        for reader, counts in tally.items():
            for group in (f"{video.parent.name}/{video.name}", ALL):
                sums[group, reader] = sums.get((group, reader), np.zeros(6, int)) + counts
    order = sorted(sums, key=lambda key: (key[0] == ALL, key[0], names.index(key[1])))
    columns = ("frames", "labelled", "corners", "common", "conflicts", "other kind")
    return [
        {"part": PART, "set": group, "reader": reader, **dict(zip(columns, sums[group, reader].tolist(), strict=True))}
        for group, reader in order
    ]


def _one(task: Task, names: Sequence[str]) -> Tally:
    video, target = task
    known = [name for name in names if can_read(name, target)]
    tally: Tally = {name: [0] * 6 for name in known}
    for _, image in frames(video):
        grey = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        ours = read(OURS, grey, target)
        for name in known:
            boards = ours if name == OURS else read(name, grey, target)
            common, apart = disagreement(boards, ours)
            corners = sum(len(board.ids) for board in boards)
            other = sum(not _is(target, board) for board in boards)
            tally[name] = [
                a + b for a, b in zip(tally[name], (1, bool(boards), corners, common, apart, other), strict=True)
            ]
    return tally


def disagreement(some: Sequence[Labelled], others: Sequence[Labelled]) -> tuple[int, int]:
    """The number of ids in both, and of those whose positions differ by more than `APART` px from the nearest position
    in the other."""
    places: dict[int, list[Array]] = {}
    for board in others:
        for number, xy in zip(board.ids.tolist(), board.xy, strict=True):
            places.setdefault(number, []).append(xy)
    both = [
        min(float(np.linalg.norm(xy - place)) for place in places[number])
        for board in some
        for number, xy in zip(board.ids.tolist(), board.xy, strict=True)
        if number in places
    ]
    return len(both), sum(gap > APART for gap in both)


def _is(target: Charuco, board: Labelled) -> bool:
    reported = board.target
    if reported is None:
        return True
    own = (target.columns, target.legacy and target.rows is not None and target.rows % 2 == 0, target.inverted)
    return isinstance(reported, Charuco) and (reported.columns, reported.legacy, reported.inverted) == own
