"""Times detectors alternately on photographs, with several numbers of threads → figures for each picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from rcdn_lab.bench.chosen import Photograph
from rcdn_lab.bench.run import PRESETS, Contestant, Runner, Times, median_time, time_once
from rcdn_lab.peers import PEERS

Key = tuple[str, int]
"""a detector's name and its number of threads"""
PATIENCE = 0.8
"""s, time budget of a detector for one photograph, which limits its repetitions"""


@dataclass(frozen=True)
class Figure:
    """Time of a detector for one picture, on `threads` threads.

    `cpu`, `wall`: ms per megapixel, medians over its `rounds`; `cpu_ratio`, `wall_ratio`: ours ÷ its own, medians over
    the rounds that both completed, None if there are none; `whole`: whether the picture's board was found whole, None
    if it has no known board, or the detector returns no boards; `alarm`: whether a board was found in a picture without
    one, None for other pictures.
    """

    set: str
    megapixels: float
    empty: bool
    detector: str
    threads: int
    rounds: int
    cpu: float
    wall: float
    cpu_ratio: float | None
    wall_ratio: float | None
    whole: bool | None
    alarm: bool | None


def figures(
    pictures: Sequence[Photograph],
    who: Sequence[Contestant],
    threads: Sequence[int],
    rounds: int,
    budget: float,
    describe: Callable[[str], None] | None = None,
) -> tuple[list[Figure], dict[str, str]]:
    """All detectors on each picture, in a new random order in each round, with all numbers of threads mixed; each
    detector is warmed up once.

    `budget`: s that a detector may take for one picture; it limits the repetitions. A detector restricted to another
    board size is left out. Also returns how detectors failed, by name: on these pictures they have no figure.
    """
    out: list[Figure] = []
    failures: dict[str, str] = {}
    rng = np.random.default_rng(0)
    with ExitStack() as stack:
        runners = {(c.name, n): c.start(n) for n in threads for c in who}
        for runner in runners.values():
            stack.callback(runner.close)
        boards = {c.name: c.board for c in who}
        for number, picture in enumerate(pictures):
            if describe:
                describe(f"{picture.set}/{picture.file}")
            selected = {key: r for key, r in runners.items() if boards[key[0]] in (None, picture.board)}
            times = _in_turn(picture, selected, rounds, budget, rng, warm=number == 0)
            failures |= {key[0]: mine.failure for key, mine in times.items() if mine.failure}
            out += _figures(picture, times)
    return out, failures


def _in_turn(
    picture: Photograph, runners: dict[Key, Runner], rounds: int, budget: float, rng: np.random.Generator, warm: bool
) -> dict[Key, Times]:
    keys, times = list(runners), {key: Times() for key in runners}
    if warm:
        for key in keys:
            time_once(runners[key], picture.image, picture.board, Times())
    for number in range(rounds):
        for k in rng.permutation(len(keys)):
            mine = times[keys[k]]
            if mine.failure or (mine.timings and mine.spent + median_time(mine) > budget):
                continue
            timing = time_once(runners[keys[k]], picture.image, picture.board, mine)
            if timing is not None:
                mine.timings[number] = timing
    return times


def _figures(picture: Photograph, times: dict[Key, Times]) -> Iterator[Figure]:
    ours = next((name for name, _ in times if name in PRESETS.values()), None)
    for (name, threads), mine in times.items():
        if mine.failure or not mine.timings:
            continue
        base = Times() if ours is None else times[ours, threads]
        pairs = [] if base.failure else [(base.timings[k], t) for k, t in mine.timings.items() if k in base.timings]
        done = list(mine.timings.values())
        raw = name in PEERS and PEERS[name].raw
        yield Figure(
            picture.set, picture.megapixels, picture.is_empty, name, threads, len(done),
            1e3 * float(np.median([t.cpu for t in done])) / picture.megapixels,
            1e3 * float(np.median([t.seconds for t in done])) / picture.megapixels,
            float(np.median([a.cpu / b.cpu for a, b in pairs])) if pairs else None,
            float(np.median([a.seconds / b.seconds for a, b in pairs])) if pairs else None,
            None if raw else picture.is_whole(done[0].grids),
            bool(done[0].grids) if picture.is_empty and not raw else None,
        )  # fmt: skip
