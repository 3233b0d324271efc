"""Figures 4 and 5: how far from the corner the highest response lies, over noise and rotation or tilt (section 4.2).

What the paper leaves open: pictures have 81 × 81 px, grey levels are cut and rounded, the highest response of the central
41 × 41 px is the answer. Where several pixels are the highest, the mean of their distances counts; so does the whole region, as a
blind guess, where nothing answers. The pre-blurred pictures have the noise of those that aren't.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, RcdnError
from rcdn.types import Array
from rcdn_lab.paper.corner_pictures import View, exposure, noisy, pre_blurred
from rcdn_lab.paper.middle_response import middle_response
from rcdn_lab.share_out import share_out
from rcdn_lab.table_weights import load_network

SIZE, REGION = 81, 41
LOW = (SIZE - REGION) // 2
GAP = 1.0
HIT, MISS = 1.0, 4.0
"""px"""
FIRST = 8_100_000_000
"""No training and no other test draws from this seed."""
RCDN, MATE, CHESS = "RCDN", "MATE", "ChESS"
ANGLES = {"fig4": "rotation", "fig5": "tilt"}
LARGEST = {"fig4": 90, "fig5": 70}

Respond = Callable[[Array], Array]
"""A picture (SIZE, SIZE) uint8 → responses (REGION, REGION) of its middle, 0 where there are none."""
Row = dict[str, Any]

_loaded: dict[str, Respond] = {}
"""The methods of this process, each made once."""


@dataclass(frozen=True)
class Grid:
    """The cells of a figure: degrees, grey levels, and pictures a cell."""

    figure: str
    angles: tuple[int, ...]
    noises: tuple[int, ...]
    trials: int


@dataclass(frozen=True)
class Cell:
    """One angle and noise, the pictures to make of it, and the methods to ask."""

    figure: str
    angle: int
    noise: int
    trials: int
    methods: tuple[str, ...]


def grid(figure: str, full: bool = False, trials: int | None = None) -> Grid:
    """The grid of `fig4` or `fig5`; `full`: in steps of 1 and of 1000 pictures, as in the paper. Raises ConfigError for others."""
    if figure not in ANGLES:
        raise ConfigError(f"figure must be one of {', '.join(ANGLES)}, not {figure!r}")
    angle, noise, count = (1, 1, 1000) if full else (5, 10, 100)
    return Grid(
        figure, tuple(range(0, LARGEST[figure] + 1, angle)), tuple(range(0, 101, noise)), trials or count
    )  # fmt: skip


def view(figure: str, angle: float) -> View:
    """How the corner of a cell is seen."""
    return View(rotation=angle, gap=GAP) if figure == "fig4" else View(tilt=angle, gap=GAP)


def pictures(cell: Cell, trial: int, clean: Array) -> Array:
    """Picture `trial` of a cell from the noise-free `clean` (SIZE, SIZE), uint8. The same arguments give the same picture."""
    seed = [FIRST, zlib.crc32(cell.figure.encode()), cell.angle, cell.noise, trial]
    return noisy(clean, cell.noise, np.random.default_rng(seed))


def contestants(ours: str = "paper", mate: str = "tables/mate") -> tuple[dict[str, str], dict[str, str]]:
    """Methods that can run here with their weights (nothing for ChESS), and why each of the others can't.

    `ours`, `mate`: weights as for `load_network`, of RCDN and MATE. Raises RcdnError where RCDN's don't load.
    """
    load_network(ours)
    found, lacking = {RCDN: ours, MATE: mate, CHESS: ""}, {}
    try:
        load_network(mate)
    except RcdnError as error:
        lacking[MATE] = str(error)
    try:
        from rcdn_lab.peers.chess import chess_response  # noqa: F401
    except ImportError as error:
        lacking[CHESS] = str(error)
    return {name: weights for name, weights in found.items() if name not in lacking}, lacking


def responder(method: str, weights: str) -> Respond:
    """What answers for a method of `contestants`."""
    if method == CHESS:
        from rcdn_lab.peers.chess import chess_response

        return lambda grey: np.asarray(chess_response(grey)[LOW : LOW + REGION, LOW : LOW + REGION])
    model = load_network(weights)
    return lambda grey: middle_response(model, grey, LOW, LOW + REGION)


def judge(response: Array) -> tuple[float, float, float]:
    """Error, px, share within `HIT` and share beyond `MISS` of an answer: responses (REGION, REGION), the corner in the middle.

    Shares are 0 or 1 but where several pixels are the highest. Where nothing answers, it is a miss.
    """
    reach = np.arange(REGION) - REGION // 2
    distance = np.hypot(reach[:, None], reach)[response == response.max()]
    if response.max() <= 0:
        return float(distance.mean()), 0.0, 1.0
    return float(distance.mean()), float((distance <= HIT).mean()), float((distance > MISS).mean())


def table(
    cells: Grid, methods: dict[str, str], workers: int = 1, progress: Callable[[int, int], None] | None = None
) -> list[Row]:
    """One row for each angle, noise, pre-blur and method (`contestants`), all methods on the same pictures.

    `mean px`, `se px`: mean error and its standard error; `hit`, `miss`: shares within 1 px and beyond 4 px; `worse px`,
    `worse se`: mean and standard error of the difference to RCDN's error, picture by picture. `progress` is called with
    cells done and all. The same arguments give the same rows, whatever `workers`.
    """
    tasks = [
        Cell(cells.figure, a, s, cells.trials if s else 1, tuple(methods)) for a in cells.angles for s in cells.noises
    ]
    found = share_out(_cell_rows, tasks, workers, _load, (dict(methods),), progress)
    return [row for rows in found for row in rows]


def _load(methods: dict[str, str]) -> None:
    """Make the methods of this process."""
    _loaded.clear()
    _loaded.update({name: responder(name, weights) for name, weights in methods.items()})


def _cell_rows(cell: Cell) -> list[Row]:
    sharp = exposure(view(cell.figure, cell.angle), SIZE)
    out = []
    for blurred, clean in ((False, sharp), (True, pre_blurred(sharp))):
        shots = [pictures(cell, trial, clean) for trial in range(cell.trials)]
        judged = np.array([[judge(_loaded[name](shot)) for shot in shots] for name in cell.methods])
        out += [_row(cell, blurred, k, judged) for k in range(len(cell.methods))]
    return out


def _row(cell: Cell, blurred: bool, k: int, judged: Array) -> Row:
    """Row of method number `k`; `judged` (methods, trials, 3)."""
    error, hit, miss = judged[k].T
    worse = error - judged[0, :, 0]
    return {
        "figure": cell.figure, ANGLES[cell.figure]: cell.angle, "noise": cell.noise, "pre-blur": blurred,
        "method": cell.methods[k], "trials": cell.trials, "mean px": float(error.mean()), "se px": standard_error(error),
        "hit": float(hit.mean()), "miss": float(miss.mean()),
        "worse px": float(worse.mean()), "worse se": standard_error(worse),
    }  # fmt: skip


def standard_error(values: Array) -> float:
    """Of a mean; 0 of one value (pictures without noise are all the same)."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def summary(rows: Sequence[Row]) -> list[Row]:
    """Short rows: one for each method, pre-blur and noise of the means over all angles."""
    out: list[Row] = []
    for method in dict.fromkeys(row["method"] for row in rows):
        for blurred in (False, True):
            mine = [row for row in rows if (row["method"], row["pre-blur"]) == (method, blurred)]
            for noise in dict.fromkeys(row["noise"] for row in mine):
                at = [row for row in mine if row["noise"] == noise]
                figures = {key: float(np.mean([row[key] for row in at])) for key in ("mean px", "hit", "miss")}
                worst = float(max(row["mean px"] for row in at))
                out.append({"method": method, "pre-blur": blurred, "noise": noise, **figures, "worst px": worst})
    return out
