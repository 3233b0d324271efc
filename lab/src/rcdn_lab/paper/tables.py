"""Tables 2 and 3: thresholds, losses and networks on the sets of section 4.1.

One response map for each network and picture; every rule is scored on it.
"""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from rcdn.config import Adaptive, DetectorConfig, Fixed, MaxFraction, Std, Threshold
from rcdn.errors import ConfigError, RcdnError, present
from rcdn.types import Array
from rcdn_lab.paper.cache import TableCache, digest, open_cache
from rcdn_lab.paper.networks import NETWORKS, TWICE
from rcdn_lab.paper.published import CROSS_ENTROPY, SQUARED, TABLE2, TABLE3
from rcdn_lab.paper.score import BORDER, CHESS, RADIUS, Counts, chess_detections, count, detections, rules
from rcdn_lab.paper.sets import FIRST, SETS, SIZE, PictureSet, Shot, missing, shots
from rcdn_lab.peers import chess, maxima
from rcdn_lab.share_out import share_out
from rcdn_lab.table_weights import load_network

Name = Literal["table2", "table3", "seeds"]
Row = dict[str, Any]
Respond = Callable[[Array], Array]
"""(H, W) uint8 → response map (H, W) float32"""
Load = Callable[[str], Respond]
"""row of a network → the function that computes its response"""
CHESS_ROW = "ChESS"
METHODS = ("0.5", "std", "max", "adaptive")


@dataclass(frozen=True)
class Line:
    """A line of a table: the network `row` under a threshold `method`; `label`: its name in the table."""

    row: str
    label: str
    method: str

    def rule(self, column: str) -> Threshold | float:
        """The threshold on a data set of the paper; for ChESS its share of the largest response."""
        return CHESS[column] if self.row == CHESS_ROW else rules(NETWORKS[self.row])[self.method]

    def paper(self, column: str) -> tuple[float, float]:
        """The paper's precision and recall on its data set."""
        again = NETWORKS[self.row].again if self.row in NETWORKS else ""
        known = TABLE2.get((self.label, self.method)) or TABLE3[again or self.row]
        return known[column]


LINES: dict[Name, tuple[Line, ...]] = {
    "table2": tuple(Line(row, label, m) for row, label in (("A", CROSS_ENTROPY), ("MATE", SQUARED)) for m in METHODS),
    "table3": (
        *(Line(row, row, "adaptive") for row, network in NETWORKS.items() if not network.again),
        Line(CHESS_ROW, CHESS_ROW, "max"),
    ),
    "seeds": tuple(Line(row, row, "adaptive") for pair in TWICE.values() for row in pair),
}


@dataclass(frozen=True, eq=False)
class Plan:
    """The measurements to make: lines of a table on pictures; `skipped`: name of a network or set → the reason why it
    is left out."""

    name: Name
    lines: tuple[Line, ...]
    sets: dict[str, list[Shot]]
    skipped: dict[str, str]


def plan(
    name: Name, data: Path | None = None, full: bool = False, sets: Sequence[str] = (), most: int | None = None
) -> Plan:
    """The available lines and pictures. `sets`: names of `SETS`, empty: all; `most`: pictures of each set.

    Raises ConfigError for an unknown set or a missing data folder.
    """
    if unknown := [s for s in sets if s not in SETS]:
        raise ConfigError(f"--set: nothing is called {unknown[0]!r}; known: {', '.join(SETS)}")
    if data is not None and not data.is_dir():
        raise ConfigError(f"--data {data}: no such folder; name the one that holds the sets' folders, or leave it out")
    rows = dict.fromkeys(line.row for line in LINES[name])
    absent = {row: why for row in rows if (why := lacking(row)) is not None}
    wanted = [SETS[s] for s in dict.fromkeys(sets or SETS)]
    absent |= {s.name: why for s in wanted if (why := missing(s, data)) is not None}
    counts = {s.name: min(s.total if full else s.default, most or s.total) for s in wanted}
    found = {s.name: shots(s, data, counts[s.name]) for s in wanted if s.name not in absent}
    return Plan(name, tuple(line for line in LINES[name] if line.row not in absent), found, absent)


# ---- networks


def lacking(row: str) -> str | None:
    """The reason why a network cannot run, or None."""
    if row != CHESS_ROW:
        try:
            load_network(NETWORKS[row].model)
        except RcdnError as error:
            return str(error).partition(": [Errno")[0]
    return None


@functools.cache
def load(row: str) -> Respond:
    """The function that computes the response of a network, made once per process."""
    if row == CHESS_ROW:
        return chess.chess_response
    model = load_network(NETWORKS[row].model)
    return lambda grey: model(grey, 1)


def checksum(row: str) -> str:
    """sha256 of what determines a network's response: its weights and their use; of ChESS, its source."""
    if row == CHESS_ROW:
        return "".join(digest(Path(module.__file__ or "")) for module in (chess, maxima))
    model = load_network(NETWORKS[row].model)
    how = json.dumps([model.normalisation, model.margins, model.cell]).encode()
    return hashlib.sha256(model.onnx + how).hexdigest()


# ---- pictures


def counts_of(shot: Shot, lines: Sequence[Line], load: Load, cache: TableCache | None = None) -> dict[Line, Counts]:
    """Counts of each line on one picture, from the cache if they are there; the picture is made only if they are
    not."""
    column = SETS[shot.set].column
    found = {line: None if cache is None else cache.get(line.row, shot, repr(line.rule(column))) for line in lines}
    image = shot.image() if any(xy is None for xy in found.values()) else None
    for row in dict.fromkeys(line.row for line, xy in found.items() if xy is None):
        response = load(row)(present(image, "the picture"))
        mine = [line for line, xy in found.items() if line.row == row and xy is None]
        new = {line: _found(response, line.rule(column)) for line in mine}
        found |= new
        if cache is not None:
            cache.put(row, shot, {repr(line.rule(column)): xy for line, xy in new.items()})
    return {line: count(xy, shot.xy, shot.ignore) for line, xy in found.items() if xy is not None}


def _found(response: Array, rule: Threshold | float) -> Array:
    return chess_detections(response, rule) if isinstance(rule, float) else detections(response, rule)


def table(
    what: Plan, workers: int = 1, cache: Path | None = None, progress: Callable[[int, int], None] | None = None,
    load: Load = load,
) -> list[Row]:  # fmt: skip
    """The rows: each line on each set, and those that are skipped. The same whatever `workers`.

    `cache`: folder in which detections are kept; `progress` is called with the number of pictures done and in total;
    `load`: returns the networks. Raises ConfigError if the cache was made with another configuration.
    """
    opened = None
    if cache is not None:
        opened = open_cache(cache, {row: checksum(row) for row in dict.fromkeys(line.row for line in what.lines)})
    every = [shot for pictures in what.sets.values() for shot in pictures]
    every.sort(key=lambda shot: -shot.size[0] * shot.size[1])  # the longest first: all processes end together
    total = {(line, name): Counts() for line in what.lines for name in what.sets}
    results = share_out(_one, every, workers, _start, (what.lines, load, opened), progress)
    for shot, counts in zip(every, results, strict=True):
        for line, value in counts.items():
            total[line, shot.set] += value
    return rows_of(what, total)


_process: dict[str, Any] = {}
"""The arguments of `counts_of` in this process, except the picture."""


def _start(lines: tuple[Line, ...], load: Load, cache: TableCache | None) -> None:
    _process.update(lines=lines, load=load, cache=cache)


def _one(shot: Shot) -> dict[Line, Counts]:
    return counts_of(shot, **_process)


# ---- rows


def rows_of(what: Plan, total: Mapping[tuple[Line, str], Counts]) -> list[Row]:
    """Rows in the table's order: one for each line and set, one for each network or set that is skipped."""
    out: list[Row] = []
    for line in LINES[what.name]:
        if line.row in what.skipped:
            if all(line.row != r["row"] for r in out):
                out.append(_row(line.row, line.label, note=f"skipped: {what.skipped[line.row]}"))
            continue
        out += [_measured(line, SETS[name], total[line, name]) for name in what.sets]
    return out + [_row("-", "-", name, note=f"skipped: {why}") for name, why in what.skipped.items() if name in SETS]


def _measured(line: Line, on: PictureSet, counts: Counts) -> Row:
    precision, recall = counts.rates
    strict = counts.strict
    paper = line.paper(on.column)
    figures = {
        "precision": precision, "recall": recall, "strict precision": strict[0], "strict recall": strict[1],
        "paper precision": paper[0], "paper recall": paper[1],
        "precision difference": precision - paper[0], "recall difference": recall - paper[1],
        "mean precision": counts.precisions / max(counts.pictures, 1),
        "mean recall": counts.recalls / max(counts.pictures, 1),
    }  # fmt: skip
    whole = {name: getattr(counts, name) for name in ("corners", "found", "near", "reached", "pairs")}
    threshold = _threshold(line.rule(on.column))
    return _row(line.row, line.label, on.name, line.method, threshold, f"{counts.pictures}/{on.total}", figures | whole)


FIGURES = (
    "precision", "recall", "strict precision", "strict recall", "paper precision", "paper recall",
    "precision difference", "recall difference", "mean precision", "mean recall", "corners", "found", "near", "reached",
    "pairs",
)  # fmt: skip


def _row(
    row: str, label: str, on: str = "-", method: str = "-", threshold: str = "-", pictures: str = "-",
    figures: Mapping[str, float | int] | None = None, note: str = "",
) -> Row:  # fmt: skip
    """A row of the table; unknown figures are None."""
    plain = {name: None if figures is None else figures[name] for name in FIGURES}
    rounded = {name: round(v, 5) if isinstance(v, float) else v for name, v in plain.items()}
    head = {"network": label, "row": row, "method": method, "threshold": threshold, "set": on, "pictures": pictures}
    return head | rounded | {"note": note}


def _threshold(rule: Threshold | float) -> str:
    match rule:
        case Fixed(value):
            return f"{value:g}"
        case Std(factor):
            return f"std {factor:g}"
        case MaxFraction(fraction) | float(fraction):
            return f"{fraction:g} max"
        case Adaptive():
            return "adaptive"
    raise AssertionError(rule)


def settings_of(what: Plan) -> dict[str, Any]:
    """Settings recorded with the figures."""
    paper = DetectorConfig.paper()
    networks = {}
    for row in dict.fromkeys(line.row for line in what.lines if line.row != CHESS_ROW):
        model = load_network(NETWORKS[row].model)
        networks[row] = {key: model.facts.get(key) for key in ("architecture", "sha256", "commit", "training")}
        networks[row]["model"] = NETWORKS[row].model
    return {
        "sets": {name: {**_facts(SETS[name]), "looked at": len(found)} for name, found in what.sets.items()},
        "board": SIZE, "first seed": FIRST, "radius": RADIUS, "border": BORDER, "refinement": None,
        "nms": asdict(paper.nms), "cluster": asdict(paper.cluster) if paper.cluster else None,
        "ChESS": {"share of the maximum": CHESS, "window": 5, "cluster": None},
        "networks": networks, "skipped": what.skipped,
    }  # fmt: skip


def _facts(on: PictureSet) -> dict[str, Any]:
    kind = "photographs" if on.recipe is None else "rendered"
    return {"stands for": on.column, "kind": kind, "pictures": on.total}
