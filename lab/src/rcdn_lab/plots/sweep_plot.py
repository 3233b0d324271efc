"""Plots of a sweep: one figure for each factor, success above, error below. The caller makes the (matplotlib)
figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]
PANELS = (("success", "success"), ("recall", "recall"), ("mean px", "mean error, px"))
MARKS = "osv^D<>pX*"


def draw_factor(figure: Any, factor: str, rows: Sequence[Row]) -> None:
    """Success, recall and mean error of every detector over the levels of `factor`, on a matplotlib `figure`.

    `rows`: those of `rcdn evaluate sweep`, of any factors. The dashed line is the mean error of an efficient estimator
    on the corners that the first detector found. Levels are evenly spaced, in the order of the rows.
    """
    mine = [row for row in rows if row["factor"] == factor]
    levels = list(dict.fromkeys(row["level"] for row in mine))
    names = list(dict.fromkeys(row["detector"] for row in mine))
    line = (
        "-" if all(level.replace(".", "").isdigit() for level in levels) else "none"
    )  # kinds have no values in between
    panels = figure.subplots(len(PANELS), 1, sharex=True)
    for axes, (key, title) in zip(panels, PANELS, strict=True):
        for number, name in enumerate(names):
            at = {row["level"]: row[key] for row in mine if row["detector"] == name}
            width, front = (2.5, 3) if number == 0 else (1.0, 2)
            axes.plot(
                range(len(levels)), _gaps(at, levels), marker=MARKS[number % len(MARKS)], markersize=4,
                linewidth=width, linestyle=line, zorder=front, label=name,
            )  # fmt: skip
        axes.set_ylabel(title)
        axes.grid(alpha=0.3)
        if key != "mean px":
            axes.set_ylim(-0.05, 1.05)
    bound = {row["level"]: row["bound px"] for row in mine if row["detector"] == names[0]}
    panels[-1].plot(range(len(levels)), _gaps(bound, levels), "k--", linewidth=1, label="bound")
    if any(row["mean px"] for row in mine):
        panels[-1].set_yscale("log")
    turned = sum(map(len, levels)) > 60
    panels[-1].set_xticks(range(len(levels)), levels, rotation=30 if turned else 0, ha="right" if turned else "center")
    panels[-1].legend(fontsize=7, ncols=2)
    panels[0].set_title(factor)


def _gaps(at: dict[str, float | None], levels: Sequence[str]) -> list[float]:
    """Values in the order of `levels`, NaN where there is none, which gives a gap in the line."""
    values = [at.get(level) for level in levels]
    return [float("nan") if v is None else v for v in values]
