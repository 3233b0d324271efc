"""The rendered sweep: kinds × conditions × readers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ConfigError
from rcdn.io import write_image
from rcdn_lab.coded.readers import OURS, can_read, judged, load
from rcdn_lab.coded.scenes import CONDITIONS, FIRST, KINDS, made
from rcdn_lab.coded.score import Count, row
from rcdn_lab.share_out import share_out

PART = "rendered"
Task = tuple[str, str, int]
"""kind, condition, index of the picture"""
Progress = Callable[[int, int], None] | None


def settings_of(count: int) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {"count": count, "first seed": FIRST, "size": [640, 480]}


def chosen(kinds: Sequence[str] = (), conditions: Sequence[str] = ()) -> tuple[list[str], list[str]]:
    """The kinds whose names begin with one of `kinds`, and the named `conditions`; empty: all. Raises ConfigError for
    names that match nothing."""
    some = [kind for kind in KINDS if not kinds or kind.startswith(tuple(kinds))]
    if lost := [name for name in kinds if not any(kind.startswith(name) for kind in KINDS)]:
        raise ConfigError(f"--kind: nothing is called {', '.join(lost)}; known: {', '.join(KINDS)}")
    if unknown := [name for name in conditions if name not in CONDITIONS]:
        raise ConfigError(f"--condition: nothing is called {', '.join(unknown)}; known: {', '.join(CONDITIONS)}")
    return some, list(conditions) or list(CONDITIONS)


def table(
    count: int,
    kinds: Sequence[str] = (),
    conditions: Sequence[str] = (),
    peers: Sequence[str] = (),
    workers: int = 1,
    progress: Progress = None,
    pictures: Path | None = None,
) -> list[dict[str, Any]]:
    """One row for each kind, condition and reader that supports the kind. `pictures`: a folder for all rendered
    pictures, as PNG.

    `weak` lists the indices of the pictures with missing or wrong corners. The same arguments give the same rows,
    whatever `workers`.
    """
    some, under = chosen(kinds, conditions)
    tasks = [(kind, condition, k) for kind in some for condition in under for k in range(count)]
    names = (OURS, *peers)
    sums: dict[tuple[str, str, str], Count] = {}
    pitch: dict[tuple[str, str], list[float]] = {}
    weak: dict[tuple[str, str, str], list[int]] = {}
    work = share_out(partial(_one, names=names, pictures=pictures), tasks, workers, load, (names,), progress)
    for (kind, condition, index), (apart, counts) in zip(tasks, work, strict=True):
        pitch.setdefault((kind, condition), []).append(apart)
        for name, one in counts.items():
            key = kind, condition, name
            sums[key] = sums.get(key, Count()) + one
            if one.right < one.corners or one.wrong or one.other or one.failed:
                weak.setdefault(key, []).append(index)
    return [_row(*key, total, pitch[key[:2]], weak.get(key, [])) for key, total in sums.items()]


def _row(kind: str, condition: str, name: str, total: Count, pitch: list[float], weak: list[int]) -> dict[str, Any]:
    return {
        "part": PART, "set": kind, "condition": condition, "reader": name, **row(total),
        "goal": CONDITIONS[condition].goal, "pitch": round(float(np.median(pitch)), 1), "weak": weak,
    }  # fmt: skip


def _one(task: Task, names: Sequence[str], pictures: Path | None) -> tuple[float, dict[str, Count]]:
    """The distance between corners, and every reader's score on one picture."""
    picture = made(*task)
    if pictures is not None:
        kind, condition, index = task
        write_image(pictures / f"{kind}, {condition}, {index}.png".replace(" ", "_"), picture.image)
    scores = {n: judged(n, picture.image, [picture.board]) for n in names if can_read(n, picture.board.target)}
    return picture.pitch, scores


def by_kind(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """One row for each kind and reader, with the recall under each condition, from `table`'s rows, and one over all
    kinds that a reader supports."""
    under = list(dict.fromkeys(r["condition"] for r in rows))
    readers = list(dict.fromkeys(r["reader"] for r in rows))
    out = []
    for reader in readers:
        own = [r for r in rows if r["reader"] == reader]
        for kind in [*dict.fromkeys(r["set"] for r in own), "ALL"]:
            some = [r for r in own if kind in (r["set"], "ALL")]
            recalls = {c: _recall([r for r in some if r["condition"] == c]) for c in under}
            counts = {k: sum(r[k] for r in some) for k in ("wrong", "other kind")}
            out.append({"rendered": kind, "reader": reader, **recalls, **counts})
    return out


def _recall(rows: Sequence[dict[str, Any]]) -> float | None:
    corners = sum(r["corners"] for r in rows)
    return round(sum(r["right"] for r in rows) / corners, 3) if corners else None
