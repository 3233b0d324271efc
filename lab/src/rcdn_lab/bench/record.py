"""Conditions recorded with the figures, and the tables for the documentation."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from rcdn.errors import ConfigError
from rcdn_lab.bench import yardstick

Row = dict[str, Any]
BUSY = 0.3
"""load per core above which timings are unreliable"""


def machine() -> dict[str, Any]:
    """The processor, the number of usable cores, and the present `load` (runnable processes)."""
    return {"processor": _processor(), "cores": _cores(), "memory GB": _memory(), "load": load()}


def load() -> float | None:
    """Runnable processes, mean of the last minute; None if the operating system does not report it."""
    return round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None


def busy(value: float | None) -> bool:
    """Whether the load is too high for timing."""
    return value is not None and value > BUSY * _cores()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _memory() -> float | None:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None


def quality(paths: Sequence[Path]) -> dict[str, float]:
    """Detector → mean success over all levels of the sweeps in these files (`rcdn evaluate sweep --json`).

    Our detector is `rcdn` with the preset `auto` and `rcdn-paper` with `paper`. Raises ConfigError for other files.
    """
    found: dict[str, list[float]] = {}
    for path in paths:
        try:
            record = json.loads(path.read_text())
            ours = "rcdn" if record["settings"]["preset"] == "auto" else f"rcdn-{record['settings']['preset']}"
            for row in record["rows"]:
                if row["success"] is not None:
                    name = ours if row["detector"] == "rcdn" else row["detector"]
                    found.setdefault(name, []).append(float(row["success"]))
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"--sweep {path}: no result of rcdn evaluate sweep: {error!r}") from error
    return {name: fmean(values) for name, values in found.items()}


def markdown(tables: Mapping[str, Sequence[Row]]) -> str:
    """The tables by name, as made by `rcdn bench`, for docs/speed.md."""
    out = yardstick.text(tables)
    speed = tables.get("speed", ())
    for kind, threads in dict.fromkeys((r["picture"], r["threads"]) for r in speed):
        mine = [r for r in speed if (r["picture"], r["threads"]) == (kind, threads)]
        title = f"{kind}, {threads} thread{'' if threads == 1 else 's'}: ms (ratio)"
        board = mine[0]["board"]
        out.append(_pivot(title, [(_label(r, board), r["size"], _timing(r)) for r in mine]))
    stages = tables.get("stages", ())
    for preset in dict.fromkeys(r["preset"] for r in stages):
        mine = [r for r in stages if r["preset"] == preset]
        title = f"stages of {preset}: ms (share)"
        out.append(_pivot(title, [(r["stage"], f"{r['picture']} {r['size']}", _share(r)) for r in mine]))
    classes = tables.get("photograph stages", ())
    if classes:
        cells = [(r["stage"], f"{r['pictures']} ({r['count']})", _part(r)) for r in classes]
        out.append(_pivot("stages on photographs: CPU ms a megapixel (share)", cells))
    if tables.get("memory"):
        cells = [(r["detector"], r["size"], _taken(r)) for r in tables["memory"]]
        out.append(_pivot("memory: MB at most (more than before the picture)", cells))
    for name in ("first", "rate", "folder"):
        if rows := tables.get(name, ()):
            lines = [list(rows[0]), ["---"] * len(rows[0]), *[[_text(v) for v in row.values()] for row in rows]]
            out.append("\n".join(f"| {' | '.join(line)} |" for line in lines))
    return "\n\n".join(out) + "\n"


def _pivot(title: str, cells: Sequence[tuple[str, str, str]]) -> str:
    """A table from (row, column, text), rows and columns in order of appearance."""
    columns = list(dict.fromkeys(column for _, column, _ in cells))
    lines = [[title, *columns], ["---"] * (1 + len(columns))]
    for line in dict.fromkeys(name for name, _, _ in cells):
        at = {column: text for name, column, text in cells if name == line}
        lines.append([line, *[at.get(column, "") for column in columns]])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _label(row: Row, board: str) -> str:
    return str(row["detector"]) if row["board"] == board else f"{row['detector']}, {row['board']}"


def _timing(row: Row) -> str:
    return (
        "failed" if row["ms"] is None else _ms(row["ms"]) + ("" if row["ratio"] is None else f" ({row['ratio']:.2f})")
    )


def _share(row: Row) -> str:
    return f"{_ms(row['ms'])} ({100 * row['share']:.0f} %)"


def _part(row: Row) -> str:
    return f"{_ms(row['ms/MP'])} ({100 * row['share']:.0f} %)"


def _taken(row: Row) -> str:
    return row["note"] or "-" if row["peak MB"] is None else f"{row['peak MB']:.0f} ({row['more MB']:.0f})"


def _ms(value: float) -> str:
    return f"{value:.{0 if value >= 100 else 1 if value >= 10 else 2}f}"


def _text(value: Any) -> str:
    return "-" if value is None else str(value)
