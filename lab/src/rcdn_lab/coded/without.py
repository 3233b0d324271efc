"""Pictures without codes: no board in them may be given ids."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import RcdnError
from rcdn.io import expand, frames
from rcdn.synthetic import HARD, ORDINARY, random_scene, render
from rcdn.types import Array
from rcdn_lab.coded.scenes import FIRST
from rcdn_lab.share_out import share_out

PART = "no codes"
SCENES = "rendered plain scenes"
SEED = FIRST + 1
NO_CODES = replace(HARD, coded_p=0.0)
"""the hard scenes without the random codes that some of their boards carry"""
Task = Path | int
"""a file, or the index of a rendered scene"""
Outcome = tuple[int, list[str]]
"""number of boards without ids; targets reported for boards with ids"""
_detector: list[Detector] = []


def files_of(folders: Sequence[Path], skip: Sequence[str] = ()) -> list[Path]:
    """All pictures and videos in the folders, except the files and folders named in `skip`. Raises RcdnError for a
    folder without any."""
    files, errors = expand(folders)
    for path, message in errors:
        raise RcdnError(f"{path}: {message}")
    return [file for file in files if not set(skip) & set(file.parts)]


def table(
    folders: Sequence[Path],
    skip: Sequence[str],
    scenes: int,
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """One row for each set, which is the folder of a file, one for `scenes` rendered scenes, and one over all.
    `alarms`: boards with ids."""
    tasks: list[Task] = [*files_of(folders, skip), *range(scenes)]
    rows: dict[str, dict[str, Any]] = {}
    for task, (plain, targets) in zip(tasks, share_out(_one, tasks, workers, _load, (), progress), strict=True):
        for group in (SCENES if isinstance(task, int) else task.parent.name, "ALL"):
            new = {"part": PART, "set": group, "pictures": 0, "plain boards": 0, "alarms": 0, "of": []}
            own = rows.setdefault(group, new)
            own["pictures"] += 1
            own["plain boards"] += plain
            own["alarms"] += len(targets)
            if group != "ALL":
                own["of"] += [f"{task if isinstance(task, int) else task.name}: {target}" for target in targets]
    return sorted(rows.values(), key=lambda r: (r["set"] == "ALL", r["set"] == SCENES))


def scene_picture(index: int) -> Array:
    """Rendered scene `index`: checkerboards and clutter without codes, alternately ordinary and hard, (H, W) uint8."""
    scene = random_scene(np.random.default_rng([SEED, index]), NO_CODES if index % 2 else ORDINARY)
    return render(scene)


def _load() -> None:
    _detector[:] = [Detector(DetectorConfig(target="auto", threads=1))]


def _one(task: Task) -> Outcome:
    images = [scene_picture(task)] if isinstance(task, int) else [image for _, image in frames(task)]
    boards = [board for image in images for board in _detector[0].boards(image)]
    return sum(b.ids is None for b in boards), [str(b.target) for b in boards if b.ids is not None]
