"""The graph of a rig: which cameras saw which boards at the same moment, which of them agree on how they stand, and the
connected components."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rcdn.calibration.fixed_boards import FixedBoards, placed_boards
from rcdn.calibration.joint_pairs import JointPairs
from rcdn.calibration.rig_start import Edge, Key, Sights, components_of, edges_of
from rcdn.types import Calibration


@dataclass(frozen=True, eq=False)
class RigGraph:
    """Cameras (nodes) and pairs of them that agree (`edges`): `when`, the moment of each camera's views; `sights`, its
    view of each board; `pairs`, the joint solutions of pairs; `fixed`, boards that are fixed to each other; `parts`,
    the connected components by the cameras' numbers, the largest first."""

    when: Sequence[Sequence[str]]
    sights: Sights
    pairs: JointPairs
    edges: list[Edge]
    fixed: FixedBoards
    parts: list[list[int]]

    @classmethod
    def of(
        cls, alone: Sequence[Calibration], when: Sequence[Sequence[str]], known: Sequence[bool], fixed_boards: bool
    ) -> RigGraph:
        """The graph of cameras that were calibrated alone; `known`: for each, whether its lens is held constant."""
        sights = sights_of(alone, when)
        pairs = JointPairs(alone, sights, known)
        edges = pairs.connected(edges_of(alone, sights))
        fixed = placed_boards(alone, sights, edges) if fixed_boards else FixedBoards()
        edges = [*edges, *fixed.edges]
        return cls(when, sights, pairs, edges, fixed, components_of(len(alone), edges))

    def shared(self, camera: int) -> set[Key]:
        """The boards that a camera saw together with others that agree with it."""
        return {key for e in self.edges if camera in (e.a, e.b) for key in e.keys}

    def most_shared(self) -> tuple[int, int, int]:
        """The two cameras that share most boards, and how many."""
        every = range(len(self.sights))
        found = {(a, b): len(self.sights[a].keys() & self.sights[b].keys()) for a in every for b in every if a < b}
        (a, b), most = max(found.items(), key=lambda item: item[1])
        return a, b, most


def sights_of(cameras: Sequence[Calibration], when: Sequence[Sequence[str]]) -> list[Mapping[Key, int]]:
    """For each camera, the view of each board with settled labels that was not left out; of several plain boards of one
    moment, the largest."""
    return [_sights(calibration, moments) for calibration, moments in zip(cameras, when, strict=True)]


def _sights(calibration: Calibration, when: Sequence[str]) -> dict[Key, int]:
    out: dict[Key, int] = {}
    for k, view in enumerate(calibration.views):
        if not view.settled or view.reason or view.pose is None:
            continue
        key = (when[k], _number(view.target))
        if key not in out or len(view) > len(calibration.views[out[key]]):
            out[key] = k
    return out


def _number(target: object) -> int:
    """A number that identifies a target in all cameras."""
    return 0 if target is None else 1 + zlib.crc32(repr(target).encode())
