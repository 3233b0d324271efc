"""Photographs and videos of rigs: which boards which camera saw at which moment."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path

from rcdn.calibration.behind import from_behind
from rcdn.calibration.coded import identity
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.io import frames, read_image
from rcdn.types import Array, Board
from rcdn.types.limits import READ_IN_A_MIRROR

Step = Callable[[int, int], None]


@dataclass(frozen=True)
class RigSet:
    """A rig in `folder` of the data: by camera the `patterns` of its pictures, whose last number is the moment, or of
    one video. `size` of the plain board in inner corners; None: it is coded. `other`: a file of the rig by another
    program, or ""."""

    name: str
    folder: str
    patterns: Mapping[str, str]
    size: tuple[int, int] | None = None
    other: str = ""

    def inside(self, data: Sequence[Path]) -> Path | None:
        """Its folder, in the first of `data` that has it."""
        return next((d / self.folder for d in data if (d / self.folder).is_dir()), None)


SETS = (
    RigSet(
        "trinocular", "boof-trinocular", {"left": "left*", "middle": "middle*", "right": "right*"}, (13, 9)
    ),
    RigSet("opencv", "opencv-left-right", {"left": "left*", "right": "right*"}, (9, 6)),
    RigSet("stereo1", "sourishg-stereo1", {"left": "*left*", "right": "*right*"}, (9, 6)),
    RigSet("caliscope", "rig-caliscope", {f"cam_{k}": f"cam_{k}.mp4" for k in range(4)}, None, "camera_array.toml"),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Shots:
    """By camera and moment the board that it saw; of plain ones whole boards only,
    so that a label means one corner in all cameras."""

    boards: Mapping[str, Mapping[str, Board]]

    @cached_property
    def moments(self) -> list[str]:
        """All of them, in order."""
        return sorted({m for each in self.boards.values() for m in each}, key=int)

    def only(self, moments: Collection[str]) -> Shots:
        """What was seen at these moments."""
        return Shots({n: {m: b for m, b in each.items() if m in moments} for n, each in self.boards.items()})

    def arguments(self) -> tuple[dict[str, list[Board]], dict[str, list[str]]]:
        """The boards and their moments as `calibrate_rig` takes them."""
        return {n: list(each.values()) for n, each in self.boards.items()}, {n: list(e) for n, e in self.boards.items()}

    def pairs(self) -> dict[tuple[str, str], list[str]]:
        """For each two cameras the moments at which both saw the board."""
        return {(a, b): [m for m in self.boards[a] if m in self.boards[b]] for a, b in combinations(self.boards, 2)}


def shots_of(of: RigSet, folder: Path, step: Step | None = None) -> Shots:
    """The boards of a set's pictures. Raises ConfigError if a camera has none."""
    detector = Detector(DetectorConfig.preset("auto", threads=1, target="auto" if of.size is None else "plain"))
    found: dict[str, dict[str, Board]] = {}
    for k, (name, pattern) in enumerate(of.patterns.items()):
        found[name] = {m: b for m, grey in _pictures(folder, pattern) if (b := _board(detector, grey, of)) is not None}
        if not found[name]:
            raise ConfigError(f"set {of.name}: no board in {folder / pattern}; name the folder of the sets")
        if step is not None:
            step(k + 1, len(of.patterns))
    return Shots(found if of.size is not None else _of_one_target(found))


def _pictures(folder: Path, pattern: str) -> list[tuple[str, Array]]:
    paths = sorted(folder.glob(pattern))
    if len(paths) == 1:
        return [(str(k), grey) for k, (_, grey) in enumerate(frames(paths[0]))]
    return [(str(int(re.findall(r"\d+", p.stem)[-1])), read_image(p)) for p in paths]


def _board(detector: Detector, grey: Array, of: RigSet) -> Board | None:
    """The whole plain board, or the one whose codes were read, from the front or from behind."""
    found = detector.detect(grey)
    boards = found.boards
    if of.size is not None:
        return next((b for b in boards if b.complete and b.size == of.size), None)
    if any(w.startswith(READ_IN_A_MIRROR) for w in found.warnings):
        boards = [*boards, *from_behind(detector.detect(grey[:, ::-1].copy()).boards)]
    return next((b for b in boards if b.target is not None), None)


def _of_one_target(found: Mapping[str, Mapping[str, Board]]) -> dict[str, dict[str, Board]]:
    """Without boards of another target than most show."""
    kinds = [identity(b.target) for each in found.values() for b in each.values() if b.target is not None]
    majority = max(set(kinds), key=kinds.count)
    return {
        n: {m: b for m, b in each.items() if b.target is not None and identity(b.target) == majority}
        for n, each in found.items()
    }
