"""Draws the pictures of docs/paper-results.md from the files of benchmarks/results into docs/images/paper:
`python docs/images/draw_paper.py`.

Table by table our figures beside the paper's. Figures 4 to 6 are drawn by
`rcdn evaluate fig4 --plots docs/images/paper`, and so on.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from draw import main, svg, text

OUT = Path(__file__).parent / "paper"
RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
WEIGHTS = Path(__file__).parents[2] / "lab" / "src" / "rcdn_lab" / "table_weights"
OURS, PAPER, GRID, FAINT = "#0072b2", "#d55e00", "#dddddd", "#f4f4f4"
Row = Mapping[str, Any]
PICTURES: dict[str, Callable[[], str]] = {}

LABELS, TOP, LINE, WIDE, GAP = 118, 62, 17, 148, 14
"""px: width of the names of lines, height above them, of a line, of a panel, between panels"""
LEAST, MOST = 1e-4, 1.0
"""shares that the logarithmic scale of errors ends at; less than the least is drawn on the left border"""
Z = 1.96
SETS = ("mesa-like", "ueye-like", "ueye", "gopro-like", "gopro")
PHOTOGRAPHS = ("ueye", "gopro")


def picture(draw: Callable[[], str]) -> Callable[[], str]:
    """Registers what draws the file of the function's name."""
    PICTURES[f"{draw.__name__}.svg"] = draw
    return draw


def rows_of(name: str) -> list[Row]:
    rows: list[Row] = json.loads((RESULTS / f"{name}.json").read_text("utf-8"))["rows"]
    return rows


def interval(bad: int, all_: int) -> tuple[float, float]:
    """Wilson's interval of 95 % for the share of `bad` among `all_`."""
    share, more = bad / all_, Z * Z / all_
    middle, half = share + more / 2, Z * math.sqrt(share * (1 - share) / all_ + more / all_ / 4)
    return max(0.0, (middle - half) / (1 + more)), (middle + half) / (1 + more)


def place(x: float, share: float) -> float:
    """Where a share is drawn in a panel that begins at `x`."""
    part = (math.log(max(share, LEAST)) - math.log(LEAST)) / (math.log(MOST) - math.log(LEAST))
    return x + WIDE * min(part, 1.0)


def line(x0: float, y0: float, x1: float, y1: float, colour: str, width: float = 1) -> str:
    return f"<line x1='{x0:.1f}' y1='{y0:.1f}' x2='{x1:.1f}' y2='{y1:.1f}' stroke='{colour}' stroke-width='{width:g}'/>"


def dot(x: float, y: float) -> str:
    return f"<circle cx='{x:.1f}' cy='{y:.1f}' r='4' fill='{OURS}'/>"


def diamond(x: float, y: float) -> str:
    return f"<path d='M{x:.1f} {y - 5:.1f}l5 5l-5 5l-5 -5z' fill='none' stroke='{PAPER}' stroke-width='1.8'/>"


def small(x: float, y: float, words: str, more: str = "") -> str:
    return text(x, y, words, f"font-size='11' {more}")


def key(y: float, ours: str) -> str:
    """What dots and diamonds are, at the left."""
    left = "text-anchor='start'"
    return dot(14, y - 4) + small(24, y, ours, left) + diamond(14, y + 13) + small(24, y + 17, "the paper", left)


def frame(x: float, y: float, count: int, title: str, ticks: Sequence[tuple[float, str]]) -> list[str]:
    """A panel for `count` lines below its title, with a rule at each tick (x, words)."""
    height = LINE * count + 8
    shape = f"<rect x='{x:g}' y='{y:g}' width='{WIDE}' height='{height}' fill='{FAINT}'/>"
    rules = [line(at, y, at, y + height, GRID) + small(at, y + height + 14, words) for at, words in ticks]
    return [shape, *rules, text(x + WIDE / 2, y - 8, title)]


def rates(lines: Sequence[tuple[str, Callable[[Row], bool]]], rows: Sequence[Row]) -> str:
    """Two rows of panels, false detections and missed corners, a column a set;
    `lines`: name and which rows belong to it."""
    parts, high = [key(20, "here, with 95 %")], LINE * len(lines) + 72
    titles = ("false, of all detections (1 − precision)", "missed, of all corners (1 − recall)")
    for k, (title, error) in enumerate(zip(titles, (_false, _missed), strict=True)):
        y = TOP + 22 + k * high
        parts.append(text(LABELS, y - 28, title, "text-anchor='start' font-weight='bold'"))
        parts += [text(LABELS - 8, y + LINE * n + 16, name, "text-anchor='end'") for n, (name, _) in enumerate(lines)]
        for column, name in enumerate(SETS):
            x = LABELS + column * (WIDE + GAP)
            ticks = [(place(x, v), words) for v, words in ((LEAST, "0"), (1e-3, ".1 %"), (1e-2, "1 %"), (1e-1, "10 %"))]
            parts += frame(x, y, len(lines), f"{name}{' (photos)' * (name in PHOTOGRAPHS)}", ticks)
            for n, (_, mine) in enumerate(lines):
                for row in rows:
                    if row["set"] == name and mine(row) and row["precision"] is not None:
                        parts += _mark(x, y + LINE * n + 12, *error(row))
    return svg(LABELS + len(SETS) * (WIDE + GAP), TOP + 22 + 2 * high - 40, *parts)


def _false(row: Row) -> tuple[int, int, float]:
    return row["found"] - row["near"], row["found"], 1 - row["paper precision"]


def _missed(row: Row) -> tuple[int, int, float]:
    return row["corners"] - row["reached"], row["corners"], 1 - row["paper recall"]


def _mark(x: float, y: float, bad: int, all_: int, paper: float) -> list[str]:
    low, high = interval(bad, all_)
    ours = line(place(x, low), y, place(x, high), y, OURS, 2) + dot(place(x, bad / all_), y)
    return [ours, diamond(place(x, paper), y)]


@picture
def table2() -> str:
    keys = [(net, method) for net in ("A", "MATE") for method in ("0.5", "std", "max", "adaptive")]
    lines = [(", ".join(key), lambda r, key=key: (r["row"], r["method"]) == key) for key in keys]
    return rates(lines, rows_of("table2"))


@picture
def table3() -> str:
    rows = rows_of("table3")
    names = list(dict.fromkeys(row["row"] for row in rows if row["precision"] is not None))
    return rates([(name, lambda r, name=name: r["row"] == name) for name in names], rows)


CURVES = {
    "E-32": ("e",), "A": ("a",), "C, D-1, D-3, E-16, G, H": ("c", "d", "d3", "e16", "g", "h"), "MATE": ("mate",),
}  # fmt: skip
COLOURS = (OURS, PAPER, "#999999", "#009e73")
LOW, HIGH = 0.55, 0.75


@picture
def curves() -> str:
    """F1 on the validation set over the steps of training, from the files beside the weights."""
    x0, y0, wide, high = 60.0, 20.0, 520.0, 240.0

    def at(step: float, f1: float) -> tuple[float, float]:
        return x0 + wide * step / 8000, y0 + high * (HIGH - f1) / (HIGH - LOW)

    parts = [f"<rect x='{x0:g}' y='{y0:g}' width='{wide:g}' height='{high:g}' fill='{FAINT}'/>"]
    for f1 in (0.55, 0.6, 0.65, 0.7, 0.75):
        parts += [line(x0, at(0, f1)[1], x0 + wide, at(0, f1)[1], GRID), small(x0 - 18, at(0, f1)[1] + 4, f"{f1:g}")]
    for step in (2000, 4000, 6000, 8000):
        parts.append(small(at(step, 0)[0], y0 + high + 16, f"{step:,}"))
    axes = "steps of 64 windows, two seeds a network; at the left F1 on the hard validation set"
    parts.append(small(x0 + wide / 2, y0 + high + 34, axes))
    for k, (title, names) in enumerate(CURVES.items()):
        parts.append(small(x0 + wide + 14, y0 + 16 + 20 * k, title, f"text-anchor='start' fill='{COLOURS[k]}'"))
        for run in [name + seed for name in names for seed in ("", "-2")]:
            curve = json.loads((WEIGHTS / f"{run}.json").read_text("utf-8"))["curve"]
            points = [at(step, f1) for step, _, f1 in curve]
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
            parts.append(f"<polyline points='{path}' fill='none' stroke='{COLOURS[k]}' stroke-width='1.6'/>")
    return svg(int(x0 + wide) + 190, int(y0 + high) + 50, *parts)


RATIOS = (0.0, 1.5)
"""÷ OpenCV, linear"""


@picture
def table4() -> str:
    """Errors of all detectors ÷ OpenCV's on the same pictures, and whole boards."""
    rows = [r for r in rows_of("table4") if not r["set"].startswith("paper: ") and r["set"] != "ALL"]
    sets = list(dict.fromkeys(r["set"] for r in rows if r["on"] != "-"))
    names = list(dict.fromkeys(r["detector"] for r in rows if r["on"] == "all"))
    parts, high = [key(20, "here")], LINE * len(names) + 62
    titles = ("calibration error ÷ OpenCV's", "pose error ÷ OpenCV's", "boards found whole")
    for k, (title, figure) in enumerate(zip(titles, ("cal", "pose", "whole"), strict=True)):
        y = TOP + 22 + k * (high + 10)
        parts.append(text(LABELS, y - 28, title, "text-anchor='start' font-weight='bold'"))
        parts += [text(LABELS - 8, y + LINE * n + 16, name, "text-anchor='end'") for n, name in enumerate(names)]
        for column, one in enumerate(sets):
            x = LABELS + column * (WIDE + GAP)
            mine = {name: _row(rows, one, name, figure) for name in names}
            parts += _shares(x, y, one, mine) if figure == "whole" else _ratios(x, y, one, figure, mine)
    return svg(LABELS + len(sets) * (WIDE + GAP), TOP + 22 + 3 * (high + 10) - 40, *parts)


def _row(rows: Sequence[Row], one: str, name: str, figure: str) -> Row | None:
    """The row of a detector on the pictures that it is compared on: those in common,
    or those that it shares with the others."""
    groups = ["all"] if figure == "whole" else ["common", f"with {name}"]
    return next((r for g in groups for r in rows if (r["set"], r["on"], r["detector"]) == (one, g, name)), None)


def _ratios(x: float, y: float, one: str, figure: str, rows: Mapping[str, Row | None]) -> list[str]:
    def at(value: float) -> float:
        return x + WIDE * min(max(value - RATIOS[0], 0) / (RATIOS[1] - RATIOS[0]), 1)

    parts = frame(x, y, len(rows), one, [(at(v), f"{v:g}") for v in (0.5, 1.0)])
    for n, row in enumerate(rows.values()):
        middle = y + LINE * n + 12
        if row is None or row[f"{figure} ÷ opencv"] is None:
            parts.append(small(x + 6, middle + 4, "too few boards in common", "text-anchor='start' fill='#777'"))
            continue
        parts.append(dot(at(row[f"{figure} ÷ opencv"]), middle))
        if row[f"paper's {figure}"] is not None:
            parts.append(diamond(at(row[f"paper's {figure}"]), middle))
    return parts


def _shares(x: float, y: float, one: str, rows: Mapping[str, Row | None]) -> list[str]:
    parts = frame(x, y, len(rows), one, [])
    for n, row in enumerate(rows.values()):
        if row is not None:
            length = (WIDE - 48) * row["whole"] / row["pictures"]
            top = y + LINE * n + 6
            parts.append(f"<rect x='{x:g}' y='{top:g}' width='{length:.1f}' height='12' fill='{OURS}' opacity='0.6'/>")
            parts.append(small(x + WIDE - 22, top + 10, f"{row['whole']}/{row['pictures']}"))
    return parts


if __name__ == "__main__":
    main(sys.argv[1:], OUT, PICTURES)
