"""Figures of many photographs → one row for each detector, and one for each set. Means are geometric: over the pictures
of a set, then over the sets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import exp, log
from statistics import fmean
from typing import Any

from rcdn_lab.bench.photographs import Figure
from rcdn_lab.bench.run import SB

SMALL = 0.1
"""megapixels below which a picture is small"""
GROUPS: dict[str, Callable[[Figure], bool]] = {
    "boards": lambda f: not f.empty,
    "boards, under 0.1 MP": lambda f: not f.empty and f.megapixels < SMALL,
    "no board": lambda f: f.empty,
    "no board, under 0.1 MP": lambda f: f.empty and f.megapixels < SMALL,
}
RATIO = "rcdn ÷ it"
HEAD = f"rcdn ÷ {SB}"
Row = dict[str, Any]


def geometric(values: Iterable[float]) -> float | None:
    """The geometric mean of positive values; None if there are none."""
    logs = [log(value) for value in values]
    return exp(fmean(logs)) if logs else None


def by_set(figures: Sequence[Figure], value: Callable[[Figure], float | None]) -> dict[str, float]:
    """Set → geometric mean of `value` over its pictures, without those whose value is None."""
    found: dict[str, list[float]] = {}
    for figure in figures:
        if (number := value(figure)) is not None:
            found.setdefault(figure.set, []).append(number)
    return {name: exp(fmean(map(log, numbers))) for name, numbers in found.items()}


def summary(figures: Sequence[Figure]) -> list[Row]:
    """A row for each group of pictures, number of threads and detector.

    `cpu ms/MP`, `ms/MP`, and ours ÷ its own of both: geometric means over the `sets`; `where found`: the ratio of
    processor time over the pictures whose boards it found whole; `worst`: the set with the largest ratio; `whole`,
    `false`: boards found whole, and pictures without a board in which it found one.
    """
    rows = []
    for group, belongs in GROUPS.items():
        mine = [f for f in figures if belongs(f)]
        for threads, detector in dict.fromkeys((f.threads, f.detector) for f in mine):
            rows.append({"pictures": group} | _row([f for f in mine if (f.threads, f.detector) == (threads, detector)]))
    return rows


def _row(mine: Sequence[Figure]) -> Row:
    ratios = by_set(mine, lambda f: f.cpu_ratio)
    worst = max(ratios, key=lambda name: ratios[name], default=None)
    return {
        "threads": mine[0].threads, "detector": mine[0].detector, "sets": len({f.set for f in mine}),
        "count": len(mine), "cpu ms/MP": _mean(by_set(mine, lambda f: f.cpu)),
        "ms/MP": _mean(by_set(mine, lambda f: f.wall)), RATIO: _mean(ratios),
        f"{RATIO}, wall": _mean(by_set(mine, lambda f: f.wall_ratio)),
        "where found": _mean(by_set([f for f in mine if f.whole], lambda f: f.cpu_ratio)),
        "worst": _rounded(None if worst is None else ratios[worst]), "worst set": worst or "-",
        "whole": share([f.whole for f in mine]), "false": share([f.alarm for f in mine]),
    }  # fmt: skip


def share(answers: Sequence[bool | None]) -> str:
    """`yes/known` of the answers that are not None; `-` if there are none."""
    known = [answer for answer in answers if answer is not None]
    return f"{sum(known)}/{len(known)}" if known else "-"


def sets(figures: Sequence[Figure]) -> list[Row]:
    """A row for each set, number of threads and kind of time: ms per megapixel by detector (None: not run, or failed),
    and ours ÷ the yardstick's."""
    rows = []
    names = list(dict.fromkeys(f.detector for f in figures))
    for name, threads in dict.fromkeys((f.set, f.threads) for f in figures):
        mine = [f for f in figures if (f.set, f.threads) == (name, threads)]
        for kind in ("cpu", "wall"):
            row: Row = {"set": name, "threads": threads, "time": kind}
            for detector in names:
                its = [f for f in mine if f.detector == detector]
                row[detector] = _mean(by_set(its, lambda f, kind=kind: getattr(f, kind)))  # type: ignore[misc]
            base = [f for f in mine if f.detector == SB]
            row[HEAD] = _mean(by_set(base, lambda f, kind=kind: getattr(f, f"{kind}_ratio")))  # type: ignore[misc]
            rows.append(row)
    return rows


def found(figures: Sequence[Figure]) -> list[Row]:
    """A row for each set: boards found whole by each detector or, for pictures without a board, those in which it found
    one (`false`)."""
    rows = []
    least = min((f.threads for f in figures), default=1)
    names = list(dict.fromkeys(f.detector for f in figures))
    for name in dict.fromkeys(f.set for f in figures):
        mine = [f for f in figures if f.set == name and f.threads == least]
        first = [f for f in mine if f.detector == mine[0].detector]
        row: Row = {"set": name, "MP": round(fmean(f.megapixels for f in first), 3), "what": _what(first)}
        row |= {d: share([f.alarm if f.empty else f.whole for f in mine if f.detector == d]) for d in names}
        rows.append(row)
    return rows


def _what(figures: Sequence[Figure]) -> str:
    if all(f.empty for f in figures):
        return "false"
    return "whole" if any(f.whole is not None for f in figures) else "not judged"


def _mean(values: dict[str, float]) -> float | None:
    return _rounded(geometric(values.values()))


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


# ---- for the documentation


def text(tables: Mapping[str, Sequence[Row]]) -> list[str]:
    """The tables of docs/speed.md, each as one string; none if no photographs were timed."""
    rows = tables.get("photographs", ())
    out = [_summary_text(rows, threads) for threads in dict.fromkeys(r["threads"] for r in rows)]
    if tables.get("sets") and tables.get("found"):
        out.append(_sets_text(tables["sets"], tables["found"]))
    return out


def _summary_text(rows: Sequence[Row], threads: int) -> str:
    at = {(r["pictures"], r["detector"]): r for r in rows if r["threads"] == threads}
    groups = [group for group in GROUPS if any(name == group for name, _ in at)]
    title = f"photographs, {threads} thread{'' if threads == 1 else 's'}: CPU ms a megapixel (rcdn ÷ it)"
    lines = [[title, *groups, "boards that it finds", "wall ms (rcdn ÷ it)", "whole", "false alarms"]]
    for name in dict.fromkeys(detector for _, detector in at):
        boards, empty = at.get(("boards", name), {}), at.get(("no board", name), {})
        times = [_both(at.get((g, name), {}), "cpu ms/MP", RATIO) for g in groups]
        more = [_number(boards.get("where found")), _both(boards, "ms/MP", f"{RATIO}, wall")]
        lines.append([name, *times, *more, boards.get("whole", ""), empty.get("false", "")])
    return _table(lines)


def _sets_text(rows: Sequence[Row], finds: Sequence[Row]) -> str:
    at = {(r["set"], r["threads"], r["time"]): r for r in rows}
    counts = list(dict.fromkeys(r["threads"] for r in rows))
    kinds = [(n, kind) for n in counts for kind in ("cpu", "wall")]
    ours = next((name for name in rows[0] if name.startswith("rcdn")), "rcdn")
    heads = [f"÷, {kind}, {n} thread{'' if n == 1 else 's'}" for n, kind in kinds]
    lines = [["set", "MP", "rcdn, CPU ms a MP", f"{SB}", *heads, "found: rcdn", SB]]
    for row in finds:
        first = at[row["set"], counts[0], "cpu"]
        ratios = [_number(at[row["set"], n, kind].get(HEAD)) for n, kind in kinds]
        lines.append(
            [row["set"], f"{row['MP']:.2f}", _number(first.get(ours), 0), _number(first.get(SB), 0), *ratios,
             str(row.get(ours, "-")), str(row.get(SB, "-")) + (" (false)" if row["what"] == "false" else "")]
        )  # fmt: skip
    return _table(lines)


def _both(row: Row, value: str, ratio: str) -> str:
    if row.get(value) is None:
        return ""
    return _number(row[value], 0 if row[value] >= 10 else 1) + ("" if row[ratio] is None else f" ({row[ratio]:.2f})")


def _number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _table(lines: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in [lines[0], ["---"] * len(lines[0]), *lines[1:]])
