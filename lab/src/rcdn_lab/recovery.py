"""The paper's board recovery compared with ours: the same rendered pictures, the same corners, exact truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.boards import find_boards
from rcdn.boards.paper import find_boards_paper
from rcdn.config import DetectorConfig
from rcdn.corners import Candidates, find_candidates
from rcdn.corners.response import load_model
from rcdn.types import Array, Board
from rcdn_lab.peers import Grid
from rcdn_lab.sweep.pictures import FIRST, Picture, picture, seed_of
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import Setting

__all__ = ["FIRST", "KINDS", "Case", "cases", "table"]

KINDS: dict[str, Setting] = {
    "planar": Setting(),
    "tilt 60": Setting(tilt=60),
    "tilt 75": Setting(tilt=75, square=30),
    "barrel": Setting(barrel=2.5, square=30),
    "fisheye 180": Setting(fisheye=180, tilt=45, square=30),
    "cylinder": Setting(bend="cylinder 4", tilt=30, square=30),
    "wave": Setting(bend="wave 0.9", tilt=30, square=30),
    "occluded": Setting(cover="quadrant"),
    "cut": Setting(cut=0.33),
    "several": Setting(boards=4),
    "small squares": Setting(square=8),
    "no board": Setting(boards=0, clutter="tiles"),
}
"""What is shown: boards of 9 × 6 corners; squares of 20 px, 30 where a lens or a bend changes them much; `several`:
four of them."""
PRESETS = ("auto", "paper")
"""Presets whose corners are used."""
COUNTS = ("growth", "graph")


@dataclass(frozen=True, eq=False)
class Case:
    """One picture (H, W), the corners that `preset` finds in it, and the boards of both recoveries."""

    kind: str
    preset: str
    image: Array
    found: Candidates
    growth: list[Board]
    graph: list[Board]

    @property
    def differ(self) -> bool:
        """Whether the recoveries differ in the corners of any board."""
        one, other = ({frozenset(map(tuple, b.xy.tolist())) for b in boards} for boards in (self.growth, self.graph))
        return one != other


def table(
    count: int = 4,
    least: int = 9,
    progress: Callable[[int, int], None] | None = None,
    show: Callable[[Case], None] | None = None,
) -> list[dict[str, Any]]:
    """One row for each kind of picture and preset, of `count` pictures each, and one of all pictures for each preset.

    `least`: fewest corners of a board, for both. `show` is called with every case; `progress` with the number of
    pictures done and in total. `whole`: true boards for which one recovered board has all visible corners, no other,
    and correct labels; `recall`: share of the visible corners that are in a board; `wrong`: corners of boards that
    match no true one; `labels`: boards with a wrong label; `false`: boards without a true corner. Labels are compared
    up to one symmetry of the lattice and one translation for each board. The same arguments give the same rows.
    """
    total = {(kind, preset): _Tally() for kind in (*KINDS, "ALL") for preset in PRESETS}
    done = 0
    for kind, setting in KINDS.items():
        for index in range(count):
            made = picture(setting, seed_of("recovery", kind, index))
            for case in cases(kind, made.image, least):
                for name in (kind, "ALL"):
                    total[name, case.preset].add(made, case)
                if show:
                    show(case)
            done += 1
            if progress:
                progress(done, count * len(KINDS))
    return [{"kind": kind, "corners of": preset} | tally.row() for (kind, preset), tally in total.items()]


def cases(kind: str, image: Array, least: int) -> Iterator[Case]:
    """Both recoveries of one picture, from the corners of each preset."""
    for preset in PRESETS:
        config = DetectorConfig.preset(preset, threads=1)
        found = find_candidates(image, load_model(config.model)(image, 1), config)
        growth, graph = find_boards_paper(image, found, least), find_boards(image, found, least)
        yield Case(kind, preset, image, found, growth, graph)


class _Tally:
    """Sums over pictures."""

    def __init__(self) -> None:
        self.pictures = self.boards = self.corners = self.raw = 0
        self.by: dict[str, Array] = {name: np.zeros(5, int) for name in COUNTS}

    def add(self, made: Picture, case: Case) -> None:
        truth = _answers(made.boards)
        self.pictures += 1
        self.boards += len(made.boards)
        self.corners += len(truth.xy)
        self.raw += len(case.found.corners)
        for name, boards in (("growth", case.growth), ("graph", case.graph)):
            grids = [Grid(b.xy, b.ij) for b in boards]
            seen = score(grids, truth)
            whole = sum(any(score([g], _answers([b])).success for g in grids) for b in made.boards)
            self.by[name] += [whole, seen.hits, seen.wrong, seen.mislabelled, seen.false]

    def row(self) -> dict[str, Any]:
        out: dict[str, Any] = {"pictures": self.pictures, "boards": self.boards, "corners seen": self.raw}
        names = ("whole", "recall", "wrong", "labels", "false")
        for k, what in enumerate(names):
            for name in COUNTS:
                value = int(self.by[name][k])
                shown = round(value / self.corners, 4) if what == "recall" and self.corners else value
                out[f"{what} {name}"] = None if what == "recall" and not self.corners else shown
        return out


def _answers(boards: list[Any]) -> Answers:
    return Answers(boards, [np.zeros(len(b.xy)) for b in boards])
