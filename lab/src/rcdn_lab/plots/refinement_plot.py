"""The paper's second Fig. 5: mean error of refinements over four factors. The caller makes the (matplotlib) figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Row = dict[str, Any]
LABELS = {
    "noise": "noise, grey levels", "blur": "Gaussian blur, px", "rotation": "rotation, degrees",
    "tilt": "tilt, degrees",
}  # fmt: skip
STYLES = {
    "seed": ("0.6", ":", "", 1.2), "CoM": ("C9", "--", "v", 1.2), "Gauss": ("C0", "--", "o", 1.2),
    "parabola": ("C4", "--", "^", 1.2), "OpenCV": ("C1", "-", "s", 1.2), "ROCHADE": ("C2", "-", "D", 1.2),
    "mixed": ("C3", "-", "*", 2.0), "ours, first": ("black", "-", "P", 2.0), "ours, fit": ("0.35", "-.", "X", 1.2),
}  # fmt: skip
"""method → colour, line (dashed: on the response), mark, width"""


def draw_refinements(figure: Any, rows: Sequence[Row]) -> None:
    """A panel for each factor, a curve for each method, errors on a log scale. `rows`: those of `rcdn evaluate
    fig6`."""
    factors = [factor for factor in LABELS if any(row["factor"] == factor for row in rows)]
    columns = min(2, len(factors))
    figure.set_size_inches(5 * columns, 3.6 * -(-len(factors) // columns) + 0.6)
    panels = figure.subplots(-(-len(factors) // columns), columns, squeeze=False).ravel()
    for axes, factor in zip(panels, factors, strict=False):
        _panel(axes, factor, [row for row in rows if row["factor"] == factor])
    for axes in panels[len(factors) :]:
        axes.remove()
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5, fontsize=9, frameon=False)


def _panel(axes: Any, factor: str, rows: Sequence[Row]) -> None:
    for name in dict.fromkeys(row["method"] for row in rows):
        colour, line, mark, width = STYLES[name]
        mine = [row for row in rows if row["method"] == name and row["mean px"] is not None]
        axes.plot(
            [row["level"] for row in mine], [row["mean px"] for row in mine], color=colour, linestyle=line, marker=mark,
            markersize=6 if mark == "*" else 4, linewidth=width, zorder=3 if width > 1.5 else 2, label=name,
        )  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlabel(LABELS[factor])
    axes.set_ylabel("mean error, px")
    axes.grid(alpha=0.3, which="both", linewidth=0.5)
