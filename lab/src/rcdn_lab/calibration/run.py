"""Combines sets and detectors into rows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.calibration.usable import FEWEST_CORNERS
from rcdn.errors import CalibrationError, ConfigError, present
from rcdn.types import Array
from rcdn_lab.calibration.detectors import OURS, Contestant
from rcdn_lab.calibration.pictures import Common, Found, common, detect, handedness, whole
from rcdn_lab.calibration.protocol import (
    FEWEST,
    FOLDS,
    SEED,
    SPLITS,
    Errors,
    Task,
    errors,
    task_of,
    weighted,
    without_outliers,
)
from rcdn_lab.calibration.sets import CameraSet
from rcdn_lab.peers import Grid
from rcdn_lab.weights import weights_of

ALL, COMMON, AGREED = "all", "common", "agreed"
"""all that a detector finds; the pictures in which all detectors find the whole board; the same without the outliers of
any detector"""
MANY = 0.6
"""share of the best detector's whole boards that a detector must find to determine the common pictures"""
FIGURES = ("fit", "cal", "pose", "unsteady", "folds", "camera")
Row = dict[str, Any]


def table(
    data: Path,
    sets: Sequence[CameraSet],
    detectors: Sequence[Contestant],
    missing: dict[str, str] | None = None,
    shaped: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> list[Row]:
    """Three rows for each set and detector, further ones weighted by sigma, and rows `ALL` over the sets.

    `on` all: all boards that the detector found, outliers left out and counted. `on` common: the pictures in which all
    detectors found the whole board, with the same corners and equal weights, none left out. `on` agreed: these without
    the corners that are outliers of any detector, the same ones for all. `on` with NAME: pictures in common with a
    detector that finds too few whole boards. `missing`: detectors that cannot run, and the reason: a row each.
    `shaped`: on common pictures the shape of the board is estimated, too. `progress` is called with the number of
    pictures done and in total. Raises ConfigError if a set has no pictures or there is no detector.
    """
    if not detectors:
        raise ConfigError("--detectors: none of them can run here; name one that is installed")
    total = sum(len(s.files(data)) for s in sets)
    done, rows = [0], []

    def step() -> None:
        done[0] += 1
        if progress:
            progress(done[0], total)

    for cameras in sets:
        found = detect(cameras, data, detectors, step)
        rows += _rows_on_all(cameras, found) + _rows_alike(cameras, found, shaped)
    rows += _summary(rows)
    rows += [_row("-", "-", "-", name, note=reason) for name, reason in (missing or {}).items()]
    return rows


def settings_of(sets: Sequence[CameraSet], detectors: Sequence[Contestant], shaped: bool) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "sets": {s.name: f"{s.pattern}, {s.size[0]}x{s.size[1]}, {s.model}" for s in sets},
        "detectors": {d.name: d.version for d in detectors}, "weights": weights_of(d.name for d in detectors),
        "splits": SPLITS, "folds": FOLDS, "seed": SEED, "fewest pictures": FEWEST, "shape": shaped,
        "error": "root of the mean squared length of observed - projected, px",
    }  # fmt: skip


def _row(
    name: str, model: str, on: str, detector: str, counts: dict[str, int] | None = None,
    figures: Errors | None = None, note: str = "",
) -> Row:  # fmt: skip
    """A row of the table; unknown figures are None."""
    columns = dict.fromkeys(("pictures", "whole", "views", "corners", "left out")) | (counts or {})
    numbers = asdict(figures or Errors())
    plain = {k: v if np.isfinite(v) else None for k, v in numbers.items()}
    if figures and any(np.isinf(v) for v in numbers.values()):
        note = "; ".join(filter(None, [note, "a camera couldn't see a corner"]))
    return {"set": name, "model": model, "on": on, "detector": detector, **columns, **plain, "note": note}


# ---- all boards that a detector finds


def _rows_on_all(cameras: CameraSet, found: Found) -> list[Row]:
    rows = []
    for name, pictures in found.grids.items():
        boards = [b for b in map(largest, pictures) if b is not None]
        counts = {"pictures": len(pictures), "whole": sum(whole(g, cameras.size) is not None for g in pictures)}
        note = "; ".join(filter(None, [found.notes[""], found.notes[name]]))
        figures, used = Errors(), {"views": len(boards), "corners": sum(len(b[0]) for b in boards)}
        if len(boards) >= FEWEST:
            try:
                task = without_outliers(task_of(boards, found.image_size, cameras.size, cameras.model))
                figures, used = errors(task), _used(task)
            except (CalibrationError, np.linalg.LinAlgError) as error:
                note = "; ".join(filter(None, [note, f"no calibration: {error}"]))
        rows.append(_row(cameras.name, cameras.model, ALL, name, counts | used, figures, note))
    return rows


def _used(task: Task) -> dict[str, int]:
    return {
        "views": len(np.unique(task.corners.frame[task.used])),
        "corners": int(task.used.sum()),
        "left out": int((~task.used).sum()),
    }


def largest(grids: Sequence[Grid]) -> tuple[Array, Array] | None:
    """Labels (M, 2) from 0 and pixels (M, 2) of the board with most corners; None if none has enough of them."""
    usable = [g for g in grids if g.ij is not None and len(g.xy) >= FEWEST_CORNERS and np.ptp(g.ij, axis=0).min() > 0]
    if not usable:
        return None
    grid = max(usable, key=lambda g: len(g.xy))
    ij = present(grid.ij, "the labels of a grid")
    ij = ij - ij.min(axis=0)
    cols, rows = ij.max(axis=0) + 1
    full = np.full((rows, cols, 2), np.nan)
    full[ij[:, 1], ij[:, 0]] = grid.xy
    return (ij if handedness(full) > 0 else ij[:, ::-1]), grid.xy


# ---- comparisons on the same corners


def _rows_alike(cameras: CameraSet, found: Found, shaped: bool) -> list[Row]:
    """Rows on common and agreed; a detector that finds too few whole boards for that is compared with the first of the
    others only."""
    many = core({n: {k for k, g in enumerate(p) if whole(g, cameras.size) is not None} for n, p in found.grids.items()})
    rows = _rows_on_common(cameras, found.of(many), shaped, COMMON, AGREED)
    for name in found.grids:
        if name not in many:
            rows += _rows_on_common(cameras, found.of([many[0], name]), shaped, f"with {name}")
    return rows


def core(wholes: Mapping[str, set[Any]]) -> list[str]:
    """The detectors that determine the common pictures, given each one's pictures with whole boards: those that find
    many. Of our own variants only `auto` does; the others are added if this excludes no picture."""
    judged = [n for n in wholes if n == "auto" or n not in OURS] or list(wholes)
    most = max(len(wholes[n]) for n in judged)
    judged = [n for n in judged if len(wholes[n]) >= MANY * most]
    shared = set.intersection(*(wholes[n] for n in judged))
    return [n for n in wholes if n in judged or (n in OURS and n != "auto" and wholes[n] >= shared)]


def _rows_on_common(cameras: CameraSet, found: Found, shaped: bool, on: str, agreed_on: str = "") -> list[Row]:
    same = common(found, cameras.size)
    note = f"{same.disputed} pictures disputed" if same.disputed else ""
    counts = {"pictures": len(found.names), "views": len(same.index), "corners": len(same.index) * len(same.ij)}
    counts |= {"left out": 0}
    if len(same.index) < FEWEST:
        note = "; ".join(filter(None, [note, "too few pictures in common"]))
        return [_row(cameras.name, cameras.model, on, n, counts, note=note) for n in found.grids]
    tasks = _tasks(cameras, found.image_size, same, shaped)
    rows = _judged(cameras, tasks, on, counts, note)
    if not agreed_on:
        return rows
    used = np.logical_and.reduce([without_outliers(tasks[n]).used for n in found.grids])
    frame = np.repeat(np.arange(len(same.index)), len(same.ij))
    used &= np.bincount(frame, used)[frame] >= FEWEST_CORNERS
    agreed = {n: replace(t, used=used) for n, t in tasks.items()}
    return rows + _judged(cameras, agreed, agreed_on, counts, note)


def _judged(cameras: CameraSet, tasks: dict[str, Task], on: str, counts: dict[str, int], note: str) -> list[Row]:
    """A row for each task; the corners of the peers among them evaluate all cameras."""
    judges = [t for n, t in tasks.items() if n not in OURS and n != WEIGHTED]
    return [
        _row(cameras.name, cameras.model, on, n, counts | _used(t), errors(t, judges), note) for n, t in tasks.items()
    ]


def _tasks(cameras: CameraSet, image_size: tuple[int, int], same: Common, shaped: bool) -> dict[str, Task]:
    """By detector, the common corners with equal weights; ours also weighted by sigma."""
    tasks = {}
    for name, xy in same.xy.items():
        boards = [(same.ij, spots) for spots in xy]
        tasks[name] = task_of(boards, image_size, cameras.size, cameras.model, shaped)
        if name == "auto" and name in same.sigma:
            tasks[WEIGHTED] = weighted(tasks[name], same.sigma[name].ravel())
    return tasks


WEIGHTED = "auto, by sigma"


def _summary(rows: Sequence[Row]) -> list[Row]:
    """Over the sets in which all have figures: number of boards found, and the geometric mean of each error.

    All: the detectors compared on common pictures in more than half of the sets.
    """
    alike = [r for r in rows if r["on"] == COMMON and r["pose"] is not None]
    done: dict[str, set[str]] = {}
    for row in alike:
        done.setdefault(row["detector"], set()).add(row["set"])
    many = len({r["set"] for r in alike})
    frequent = [n for n, of in done.items() if 2 * len(of) > many]
    sets = set.intersection(*(done[n] for n in frequent)) if frequent else set()
    out = []
    for on in (ALL, COMMON, AGREED):
        for name in dict.fromkeys(r["detector"] for r in rows if r["on"] == on):
            mine = [r for r in rows if r["on"] == on and r["detector"] == name]
            counts = {k: _sum(mine, k) for k in ("pictures", "whole", "views", "corners", "left out")}
            of = [r for r in mine if r["set"] in sets] if on == ALL or name in frequent else []
            figures = Errors(**{f: _geometric([r[f] for r in of]) for f in FIGURES})
            out.append(_row("ALL", "-", on, name, counts, figures, f"geometric means of {len(of)} sets" if of else ""))
    return out


def _sum(rows: Sequence[Row], key: str) -> Any:
    values = [r[key] for r in rows if r[key] is not None]
    return sum(values) if values else None


def _geometric(values: Sequence[float | None]) -> float:
    if not values or any(v is None for v in values):
        return float("nan")
    return float(np.exp(np.mean(np.log(np.array(values, float)))))


def markdown(rows: Sequence[Row]) -> str:
    """The rows as Markdown tables: boards found, then the held-out error on common pictures, the lowest of each set in
    bold."""
    errors_of = [(COMMON, "pose"), (AGREED, "pose"), (AGREED, "camera")]
    return "\n\n".join([_counts_table(rows), *(_errors_table(rows, on, figure) for on, figure in errors_of)]) + "\n"


def _counts_table(rows: Sequence[Row]) -> str:
    every = [r for r in rows if r["on"] == ALL]
    names = list(dict.fromkeys(r["detector"] for r in every))
    lines = ["| set | pictures | " + " | ".join(names) + " |", "|---|---|" + "---|" * len(names)]
    for name in dict.fromkeys(r["set"] for r in every):
        mine = {r["detector"]: r for r in every if r["set"] == name}
        cells = [f"{mine[n]['whole']} ({mine[n]['left out'] or 0})" for n in names]
        lines.append(f"| {name} | {mine[names[0]]['pictures']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _errors_table(rows: Sequence[Row], on: str, figure: str) -> str:
    alike = [r for r in rows if r["on"] == on]
    names = list(dict.fromkeys(r["detector"] for r in alike))
    lines = [f"| {figure} on {on} | model | views | " + " | ".join(names) + " |", "|---|---|---|" + "---|" * len(names)]
    for name in dict.fromkeys(r["set"] for r in alike):
        mine = {r["detector"]: r for r in alike if r["set"] == name}
        values = {n: mine[n][figure] for n in names if n in mine}
        known = [v for v in values.values() if v is not None]
        cells = [
            "–" if (v := values.get(n)) is None else f"**{v:.4f}**" if v == min(known) else f"{v:.4f}" for n in names
        ]
        first = next(iter(mine.values()))
        lines.append(f"| {name} | {first['model']} | {first['views']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
