"""Figures 4 and 5: distance of the highest response from the corner, over noise and rotation or tilt (section 4.2).

Choices that the paper leaves open: pictures have 81 × 81 px, grey levels are clipped and rounded, the answer is the
highest response of the central 41 × 41 px. If several pixels have it, the mean of their distances counts; if there is
no response, that of the whole region, as for a blind guess. The pre-blurred pictures have the same noise as the others.
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
"""No training and no other test uses this seed."""
RCDN, MATE, CHESS = "RCDN", "MATE", "ChESS"
ANGLES = {"fig4": "rotation", "fig5": "tilt"}
LARGEST = {"fig4": 90, "fig5": 70}

Respond = Callable[[Array], Array]
"""A picture (SIZE, SIZE) uint8 → responses (REGION, REGION) of its central part, 0 where there are none."""
Row = dict[str, Any]

_loaded: dict[str, Respond] = {}
"""The methods of this process, each made once."""


@dataclass(frozen=True)
class Grid:
    """The cells of a figure: degrees, grey levels, and pictures per cell."""

    figure: str
    angles: tuple[int, ...]
    noises: tuple[int, ...]
    trials: int


@dataclass(frozen=True)
class Cell:
    """One angle and noise, the number of pictures, and the methods to evaluate."""

    figure: str
    angle: int
    noise: int
    trials: int
    methods: tuple[str, ...]


def grid(figure: str, full: bool = False, trials: int | None = None) -> Grid:
    """The grid of `fig4` or `fig5`; `full`: with steps of 1 and 1000 pictures per cell, as in the paper. Raises
    ConfigError for other names."""
    if figure not in ANGLES:
        raise ConfigError(f"figure must be one of {', '.join(ANGLES)}, not {figure!r}")
    angle, noise, count = (1, 1, 1000) if full else (5, 10, 100)
    return Grid(
        figure, tuple(range(0, LARGEST[figure] + 1, angle)), tuple(range(0, 101, noise)), trials or count
    )  # fmt: skip


def view(figure: str, angle: float) -> View:
    """View of the corner of a cell."""
    return View(rotation=angle, gap=GAP) if figure == "fig4" else View(tilt=angle, gap=GAP)


def pictures(cell: Cell, trial: int, clean: Array) -> Array:
    """Picture `trial` of a cell from the noise-free `clean` (SIZE, SIZE), uint8. The same arguments give the same
    picture."""
    seed = [FIRST, zlib.crc32(cell.figure.encode()), cell.angle, cell.noise, trial]
    return noisy(clean, cell.noise, np.random.default_rng(seed))


def contestants(ours: str = "paper", mate: str = "tables/mate") -> tuple[dict[str, str], dict[str, str]]:
    """Methods that can run here with their weights ("" for ChESS), and for each of the others the reason why it cannot.

    `ours`, `mate`: weights as for `load_network`, of RCDN and MATE. Raises RcdnError if RCDN's do not load.
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
    """The function that computes the response of a method of `contestants`."""
    if method == CHESS:
        from rcdn_lab.peers.chess import chess_response

        return lambda grey: np.asarray(chess_response(grey)[LOW : LOW + REGION, LOW : LOW + REGION])
    model = load_network(weights)
    return lambda grey: middle_response(model, grey, LOW, LOW + REGION)


def judge(response: Array) -> tuple[float, float, float]:
    """Error, px, share within `HIT` and share beyond `MISS` of an answer: responses (REGION, REGION), the corner in the
    centre.

    Shares are 0 or 1 unless several pixels are the highest. No response counts as a miss.
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

    `mean px`, `se px`: mean error and its standard error; `hit`, `miss`: shares within 1 px and beyond 4 px; `worse
    px`, `worse se`: mean and standard error of the difference from RCDN's error, picture by picture. `progress` is
    called with the number of cells done and in total. The same arguments give the same rows, whatever `workers`.
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
        "method": cell.methods[k], "trials": cell.trials, "mean px": float(error.mean()),
        "se px": standard_error(error), "hit": float(hit.mean()), "miss": float(miss.mean()),
        "worse px": float(worse.mean()), "worse se": standard_error(worse),
    }  # fmt: skip


def standard_error(values: Array) -> float:
    """Standard error of a mean; 0 for a single value (pictures without noise are all the same)."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def summary(rows: Sequence[Row]) -> list[Row]:
    """Short rows: for each method, pre-blur and noise the means over all angles."""
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
