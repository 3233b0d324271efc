"""Goals for reading codes, and whether they are reached."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rcdn_lab.coded import real, rendered, videos, without
from rcdn_lab.coded.readers import GIVEN, OURS

REAL_RECALL = 0.98
RATIO = 1.5
"""least ratio of our correct corners to those of OpenCV given the complete target, on degraded photographs"""
BESIDE = "opencv"
Rows = Sequence[dict[str, Any]]


@dataclass(frozen=True)
class Goal:
    """A goal of a `part`: the quantity `what`, the `wanted` value and the measured one, `got`."""

    part: str
    what: str
    wanted: str
    got: str
    passed: bool

    def __str__(self) -> str:
        return f"{'pass' if self.passed else 'MISS'}  {self.part}: {self.what} {self.wanted}: {self.got}"


def record(goal: Goal) -> dict[str, Any]:
    """The goal as plain values."""
    return asdict(goal)


def goals(rows: Rows) -> list[Goal]:
    """The goals of all parts contained in `rows`."""
    parts = {part: [r for r in rows if r["part"] == part] for part in dict.fromkeys(r["part"] for r in rows)}
    judge = {
        real.PART: _real,
        real.DEGRADED: _degraded,
        videos.PART: _videos,
        rendered.PART: _rendered,
        without.PART: _without,
    }
    return [goal for part, own in parts.items() for goal in judge[part](own)]


def _nothing(part: str, what: str, count: int, where: str = "") -> Goal:
    return Goal(part, what, "0", f"{count}{where}", count == 0)


def _least(part: str, what: str, wanted: float, got: float | None, where: str = "") -> Goal:
    return Goal(part, what, f"≥ {wanted:g}", f"{'none' if got is None else f'{got:.4g}'}{where}", (got or 0) >= wanted)


def _real(rows: Rows) -> Iterator[Goal]:
    (total,) = (r for r in rows if r["set"] == real.ALL and r["reader"] == OURS)
    named, boards = total["named"], total["boards"]
    yield Goal(real.PART, "boards with kind, dictionary and legacy right", str(boards), str(named), named == boards)
    yield _least(real.PART, "recall", REAL_RECALL, total["recall"])
    yield _nothing(real.PART, "wrong numbers", total["wrong"])
    yield _nothing(real.PART, "boards of another kind", total["other kind"])


def _degraded(rows: Rows) -> Iterator[Goal]:
    beside = [r for r in rows if r["set"] == real.ALL and r["reader"] == BESIDE]
    if beside:
        ours, theirs, most = (sum(r[k] for r in beside) for k in ("ours", "right", "corners"))
        where = f" (all corners would be {most / theirs:.4g})" if theirs else ""
        ratio = ours / theirs if theirs else float("inf")
        yield _least(real.DEGRADED, f"our corners over {BESIDE}'s", RATIO, ratio, where)
    yield _nothing(real.DEGRADED, "wrong numbers", _sum(rows, "wrong", real.ALL))
    yield _nothing(real.DEGRADED, "boards of another kind", _sum(rows, "other kind", real.ALL))


def _videos(rows: Rows) -> Iterator[Goal]:
    total = {r["reader"]: r for r in rows if r["set"] == videos.ALL}
    for name, theirs in total.items():
        if name not in (OURS, GIVEN):
            yield _least(videos.PART, f"frames labelled, {name}'s", theirs["labelled"], total[OURS]["labelled"])
            yield _nothing(videos.PART, f"numbers elsewhere than {name}'s", theirs["conflicts"])
    for name in total.keys() & {OURS, GIVEN}:
        yield _nothing(videos.PART, f"boards of another kind, {name}", total[name]["other kind"])


def _rendered(rows: Rows) -> Iterator[Goal]:
    ours = [r for r in rows if r["reader"] == OURS]
    for condition in dict.fromkeys(r["condition"] for r in ours if r["goal"] is not None):
        own = [r for r in ours if r["condition"] == condition and r["recall"] is not None]
        worst = min(own, key=lambda r: float(r["recall"]))
        short = sum(r["recall"] < r["goal"] for r in own)
        where = f" ({worst['set']}; {short} of {len(own)} kinds fall short)"
        yield _least(rendered.PART, f"{condition}: least recall", worst["goal"], worst["recall"], where)
    yield _nothing(rendered.PART, "wrong numbers", _sum(ours, "wrong"))
    yield _nothing(rendered.PART, "boards of another kind", _sum(ours, "other kind"))


def _without(rows: Rows) -> Iterator[Goal]:
    alarms = [name for r in rows for name in r["of"]]
    yield _nothing(without.PART, "boards with numbers", len(alarms), f": {', '.join(alarms[:4])}" if alarms else "")


def _sum(rows: Rows, column: str, group: str | None = None) -> int:
    return sum(r[column] for r in rows if r["reader"] == OURS and group in (None, r["set"]))
