"""Plots of a benchmark: time against quality, and memory while processing a folder. The caller makes the (matplotlib)
figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Row = dict[str, Any]
MARKS = "osv^D<>pX*"
WIDE, HIGH = 4.6, 4.2
"""size of a panel, inches"""


def draw(figure: Any, rows: Sequence[Row], quality: Mapping[str, float], samples: Sequence[Row] = ()) -> None:
    """A panel for each size, of pictures with a board and the fewest threads, and one for memory if there are
    `samples`.

    `rows`: the table `speed` of `rcdn bench`; `quality`: detector → mean success, 0..1. A detector without a time, a
    ratio or a quality is not drawn. Better detectors are higher and further left.
    """
    least = min((row["threads"] for row in rows), default=1)
    mine = [row for row in rows if row["picture"] == "board" and row["threads"] == least]
    names = list(dict.fromkeys(row["detector"] for row in mine if row["detector"] in quality))
    sizes = list(dict.fromkeys(row["size"] for row in mine))
    count = max(1, len(sizes) + bool(samples))
    figure.set_size_inches(WIDE * count, HIGH)
    panels = figure.subplots(1, count, squeeze=False)[0]
    for axes, size in zip(panels, sizes, strict=False):
        draw_size(axes, [row for row in _once(mine) if row["size"] == size], quality, names)
        axes.set_title(f"{size}, {least} thread{'' if least == 1 else 's'}")
    if sizes and names:
        panels[0].legend(fontsize=7, loc="lower left")
    if samples:
        draw_memory(panels[-1], samples)


def _once(rows: Sequence[Row]) -> list[Row]:
    """The first row of each size and detector: the yardstick is also timed on other boards."""
    first: dict[tuple[str, str], Row] = {}
    for row in rows:
        first.setdefault((row["size"], row["detector"]), row)
    return list(first.values())


def draw_size(axes: Any, rows: Sequence[Row], quality: Mapping[str, float], names: Sequence[str]) -> None:
    """Time as a multiple of the yardstick's, on a log scale, against quality. Each detector has the same mark in all
    panels."""
    for row in rows:
        name = row["detector"]
        if name in names and row["ratio"] is not None:
            number, ours = names.index(name), name.startswith("rcdn")
            axes.plot(
                [row["ratio"]], [quality[name]], linestyle="none", marker=MARKS[number % len(MARKS)],
                markersize=10 if ours else 6, color=f"C{number % 10}", label=name, zorder=3,
            )  # fmt: skip
    axes.axvline(1, color="0.6", linewidth=1)
    axes.set_xscale("log")
    axes.set_ylim(-0.05, 1.05)
    axes.set_xlabel("time ÷ findChessboardCornersSB's")
    axes.set_ylabel("mean success in the sweep")
    axes.grid(alpha=0.3)


def draw_folder(figure: Any, samples: Sequence[Row]) -> None:
    """Time and memory side by side, over the number of pictures processed."""
    figure.set_size_inches(WIDE * 2, HIGH)
    left, right = figure.subplots(1, 2)
    _along(left, samples, "seconds")
    left.set_ylabel("time, s")
    left.set_title("rcdn detect over a folder")
    draw_memory(right, samples)
    right.set_title("all processes together")


def draw_memory(axes: Any, samples: Sequence[Row]) -> None:
    """Memory of all processes together over the number of pictures processed, a line for each number of jobs."""
    _along(axes, samples, "now MB")
    axes.set_ylabel("memory, MB")
    axes.set_title("rcdn detect over a folder")


def _along(axes: Any, samples: Sequence[Row], what: str) -> None:
    for jobs in dict.fromkeys(s["jobs"] for s in samples):
        mine = [s for s in samples if s["jobs"] == jobs and s[what] is not None]
        axes.plot([s["pictures"] for s in mine], [s[what] for s in mine], label=f"{jobs} job{'' if jobs == 1 else 's'}")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("pictures done")
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
