"""Combines settings, pictures and detectors into rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.types import Array
from rcdn_lab.peers import PEERS, Find, Grid, quiet
from rcdn_lab.share_out import share_out
from rcdn_lab.sweep.bound import bounds
from rcdn_lab.sweep.pictures import FIRST, Picture, picture, seed_of
from rcdn_lab.sweep.score import LARGEST_RADIUS, SHARE, Answers, Score, broken, row, score
from rcdn_lab.sweep.settings import FACTORS
from rcdn_lab.weights import weights_of

OURS = "rcdn"
SIZE = (9, 6)
Task = tuple[str, str, int, tuple[str, ...]]
"""factor, level, index of the picture, names of the detectors"""
Scores = dict[str, Score]
"""detector → its score on one picture"""

_loaded: dict[str, Find] = {}
"""The detectors of this process, each made once."""


def contestants(peers: Sequence[str] = ("auto",)) -> tuple[list[str], dict[str, str]]:
    """Names of the peers that can run here, and for each of the others the reason why it cannot.

    `peers`: names, `auto` for all, `none` or nothing for none. Raises ConfigError for an unknown name.
    """
    wanted = list(PEERS) if "auto" in peers else [name for name in peers if name != "none"]
    unknown = sorted(set(wanted) - set(PEERS))
    if unknown:
        raise ConfigError(f"--peers: no peer is called {', '.join(unknown)}; known: auto, none, {', '.join(PEERS)}")
    reasons = {name: PEERS[name].missing() for name in dict.fromkeys(wanted)}
    return [n for n, why in reasons.items() if why is None], {n: why for n, why in reasons.items() if why is not None}


def settings_of(count: int, preset: str, peers: Sequence[str]) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "count": count, "preset": preset, "weights": weights_of([preset]), "first seed": FIRST, "board": SIZE,
        "hit": f"within {SHARE} of the distance to the nearest neighbour, at most {LARGEST_RADIUS} px",
        "peers": {name: PEERS[name].version() for name in peers},
    }  # fmt: skip


def table(
    count: int = 20,
    factors: Sequence[str] = (),
    peers: Sequence[str] = (),
    preset: str = "auto",
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """One row for each factor, level and detector, of `count` pictures each.

    `factors`: of `FACTORS`, empty: all; `peers`: names from `contestants`; `progress` is called with the number of
    pictures done and in total. The same arguments give the same rows, whatever `workers`. Raises ConfigError for an
    unknown factor.
    """
    unknown = sorted(set(factors) - set(FACTORS))
    if unknown:
        raise ConfigError(f"--factor: nothing is called {', '.join(unknown)}; known: {', '.join(FACTORS)}")
    names = (OURS, *peers)
    levels = [(f, v) for f in (factors or FACTORS) for v in FACTORS[f]]
    tasks = [(factor, level, k, names) for factor, level in levels for k in range(count)]
    found: dict[tuple[str, str, str], list[Score]] = {(f, v, n): [] for f, v in levels for n in names}
    judged = share_out(_one, tasks, workers, _load, (names, preset), progress)
    for (factor, level, _, _), scores in zip(tasks, judged, strict=True):
        for name, value in scores.items():
            found[factor, level, name].append(value)
    return [_named_row(*key, scores) for key, scores in found.items()]


def _named_row(factor: str, level: str, name: str, scores: list[Score]) -> dict[str, Any]:
    peer = PEERS.get(name)
    size: str = "free" if peer is None else peer.size
    if peer is not None and peer.board:
        size += f" {peer.board[0]}x{peer.board[1]}"
    return {"factor": factor, "level": level, "detector": name, "size": size} | row(scores)


def _load(names: tuple[str, ...], preset: str) -> None:
    """Make the detectors of this process."""
    _loaded.clear()
    with quiet():
        _loaded.update({name: _ours(preset) if name == OURS else PEERS[name].load() for name in names})


def _ours(preset: str) -> Find:
    detector = Detector(DetectorConfig.preset(preset, threads=1))

    def find(image: Array, _size: tuple[int, int]) -> list[Grid]:
        return [Grid(b.xy, b.ij, b.sigma) for b in detector.boards(image)]

    return find


def _one(task: Task) -> Scores:
    """All detectors on one picture, or on one for each size of board that they need."""
    factor, level, index, names = task
    sizes = {name: (PEERS[name].board if name in PEERS else None) or SIZE for name in names}
    out: Scores = {}
    for size in dict.fromkeys(sizes.values()):
        made = picture(FACTORS[factor][level], seed_of(factor, level, index), size)
        answers = Answers(made.boards, bounds(made.scene))
        for name in (n for n in names if sizes[n] == size):
            raw = name in PEERS and PEERS[name].raw
            out[name] = _judged(name, made, index, size, answers, raw)
    return {name: out[name] for name in names}


def _judged(name: str, made: Picture, index: int, size: tuple[int, int], answers: Answers, raw: bool) -> Score:
    try:
        with quiet():
            grids = _loaded[name](made.image, size)
    except Exception as error:  # any exception is reported in the detector's row, and the others continue
        return broken(answers, raw, f"#{index} {type(error).__name__}: {error}")
    return score(grids, answers, raw)
