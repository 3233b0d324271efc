"""Times detectors alternately on the same pictures → times and ratios."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError
from rcdn.types import Array
from rcdn_lab import sweep
from rcdn_lab.bench.child import Broken, Child, Timing
from rcdn_lab.bench.pictures import Cell, rendered
from rcdn_lab.peers import PEERS, Find, Grid

SB = "opencv-sb"
"""the yardstick: findChessboardCornersSB, given the board's size"""
PRESETS = {"auto": "rcdn", "paper": "rcdn-paper"}
THREADS_SET = {"opencv-sb", "opencv", *PRESETS.values()}
"""detectors whose number of threads is set; the others are limited by the number of cores only"""
PROGRAMS = {"mrgingham"}
"""peers that run as external programs: their start and a picture file are included in the time, and their memory is not
measured"""
Size = tuple[int, int]
Row = dict[str, Any]


class Runner(Protocol):
    """Times a detector on a picture; a `Child`, or a substitute for one."""

    def time(self, image: Array, size: Size) -> Timing: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Contestant:
    """A detector by name; `start(threads)` returns its runner; `board`: the only board size it supports, None: any."""

    name: str
    start: Callable[[int], Runner]
    board: Size | None = None


def contestants(presets: Sequence[str], peers: Sequence[str]) -> tuple[list[Contestant], dict[str, str]]:
    """The detectors that are timed, ours first, and for each of the other peers the reason why it is not.

    `presets`: of `auto`, `paper`; `peers`: names, `auto` for all, `none` for none. The yardstick is added to any peer.
    Raises ConfigError for unknown names.
    """
    unknown = sorted(set(presets) - set(PRESETS))
    if unknown or not presets:
        raise ConfigError(f"--preset must be {' or '.join(PRESETS)}, not {', '.join(unknown) or 'nothing'}")
    names, missing = sweep.contestants(peers)
    if set(peers) - {"none"}:
        names = [SB, *(name for name in names if name != SB)]
    out = [Contestant(PRESETS[p], partial(_child, partial(_ours, p))) for p in dict.fromkeys(presets)]
    return out + [Contestant(n, partial(_child, partial(_peer, n)), PEERS[n].board) for n in names], missing


def _child(load: Callable[[int], Find], threads: int) -> Child:
    return Child(partial(load, threads), threads)


def _peer(name: str, _threads: int) -> Find:
    return PEERS[name].load()


def _ours(preset: str, threads: int) -> Find:
    from rcdn.detector import Detector

    detector = Detector(DetectorConfig.preset(preset, threads=threads))

    def find(image: Array, _size: Size) -> list[Grid]:
        return [Grid(board.xy, board.ij) for board in detector.boards(image)]

    return find


def cells_of(sizes: Sequence[Size], board: Size, who: Sequence[Contestant]) -> Iterator[Cell]:
    """The pictures, size by size. A peer that needs boards of another size gets them, together with the yardstick."""
    rest = tuple(c.name for c in who if c.board in (None, board))
    others = {c.board for c in who if c.board not in (None, board)}
    for size in sizes:
        yield Cell("board", size, board, (rendered("board", size, board),), rest)
        for other in sorted(o for o in others if o is not None):
            only = (SB, *(c.name for c in who if c.board == other))
            yield Cell("board", size, other, (rendered("board", size, other),), only)
        for kind in ("clutter", "texture"):
            yield Cell(kind, size, board, (rendered(kind, size, board),))


def table(
    cells: Iterable[Cell],
    who: Sequence[Contestant],
    threads: Sequence[int],
    count: int,
    budget: float,
    describe: Callable[[str], None] | None = None,
) -> list[Row]:
    """One row for each cell, thread count and detector.

    `count`: repetitions, or the number of pictures of a cell if larger; `budget`: s that a detector may take in a cell,
    which limits its repetitions; `describe`: called with a description of the present step.
    """
    rows = []
    with ExitStack() as stack:
        runners = {(c.name, n): c.start(n) for n in threads for c in who}
        for runner in runners.values():
            stack.callback(runner.close)
        for cell in cells:
            selected = [c for c in who if not cell.only or c.name in cell.only]
            for n in threads:
                if describe:
                    describe(f"{cell.kind} {cell.size[0]}x{cell.size[1]}, {n} threads")
                found = in_turn(
                    cell, {c.name: runners[c.name, n] for c in selected}, count, budget, _board_of(selected)
                )
                rows += [_row(cell, n, name, found) for name in found]
    return rows


def _board_of(who: Sequence[Contestant]) -> dict[str, Size]:
    return {c.name: c.board for c in who if c.board}


@dataclass(eq=False)
class Times:
    """Times of one detector in a cell: `timings` by round; `failure`: the reason of a failure; `cold`: timed without a
    warm-up.

    `spent`: s, including the warm-up; `skipped`: rounds that did not fit the budget.
    """

    timings: dict[int, Timing] = field(default_factory=dict)
    spent: float = 0.0
    failure: str = ""
    cold: bool = False
    skipped: int = 0


def in_turn(
    cell: Cell, runners: dict[str, Runner], count: int, budget: float, boards: dict[str, Size] | None = None
) -> dict[str, Times]:
    """Warm up all detectors, then run each round on one picture, in a new order.

    A detector that has used up the `budget`, s, skips the remaining rounds; if the warm-up alone used it up, the
    detector is not run again, and the warm-up's time counts. `boards`: board sizes given to detectors instead of the
    cell's.
    """
    out = {name: Times() for name in runners}
    sizes = {name: (boards or {}).get(name, cell.board) for name in runners}
    rng = np.random.default_rng(0)
    for name, runner in runners.items():
        warm = time_once(runner, cell.pictures[0], sizes[name], out[name])
        if warm is not None and out[name].spent >= budget:
            out[name].timings[0], out[name].cold = warm, True
    for number in range(max(count, len(cell.pictures))):
        image = cell.pictures[number % len(cell.pictures)]
        for name in rng.permutation(list(runners)).tolist():
            mine = out[name]
            if mine.failure:
                continue
            if mine.skipped or (mine.timings and mine.spent + median_time(mine) > budget):
                mine.skipped += 1
                continue
            timing = time_once(runners[name], image, sizes[name], mine)
            if timing is not None:
                mine.timings[number] = timing
    return out


def median_time(mine: Times) -> float:
    """Median of its times so far, s."""
    return float(np.median([t.seconds for t in mine.timings.values()]))


def time_once(runner: Runner, image: Array, size: Size, mine: Times) -> Timing | None:
    """Time one picture, and record the result in `mine`; None, with the reason in `mine`, if the detector failed."""
    try:
        timing = runner.time(image, size)
    except Broken as error:
        mine.failure = str(error)
        return None
    mine.spent += timing.seconds
    return timing


def _row(cell: Cell, threads: int, name: str, found: dict[str, Times]) -> Row:
    """The figures of one detector. `ratio`: median over the rounds that it and the yardstick both ran of its time ÷ the
    yardstick's."""
    mine, base = found[name], found.get(SB)
    pairs = [] if base is None else sorted(set(mine.timings) & set(base.timings))
    ratio = None
    if base is not None and pairs and not (mine.failure or base.failure):
        ratio = float(np.median([mine.timings[k].seconds / base.timings[k].seconds for k in pairs]))
    done = [] if mine.failure else list(mine.timings.values())
    wall = [1e3 * t.seconds for t in done]
    peer = PEERS.get(name)
    return {
        "picture": cell.kind, "size": f"{cell.size[0]}x{cell.size[1]}", "board": f"{cell.board[0]}x{cell.board[1]}",
        "threads": threads, "detector": name, "ms": _round(np.median(wall) if wall else None),
        "iqr ms": _round(np.subtract(*np.percentile(wall, [75, 25])) if wall else None),
        "cpu ms": _round(np.median([1e3 * t.cpu for t in done]) if done else None),
        "ratio": None if ratio is None else round(ratio, 3),
        "corners": float(np.median([t.corners for t in done])) if done else None,
        "repeats": len(done), "pairs": len(pairs) if ratio is not None else 0,
        "note": _note(mine, name, raw=peer is not None and peer.raw),
    }  # fmt: skip


def _note(mine: Times, name: str, raw: bool) -> str:
    if mine.failure:
        return f"failed: {mine.failure}"
    words = [] if name in THREADS_SET else ["own threads"]
    if raw:
        words.append("corners only")
    if name in PROGRAMS:
        words.append("starts a program")
    if mine.cold:
        words.append("over budget, not warmed up")
    elif mine.skipped:
        words.append(f"budget: {len(mine.timings)} of {len(mine.timings) + mine.skipped}")
    return ", ".join(words)


def _round(value: Any) -> float | None:
    return None if value is None else round(float(value), 3)
