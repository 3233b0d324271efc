"""HTML representation of values in notebooks: boards as drawings, cameras and calibrations as tables. Plain HTML and
SVG, without scripts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from rcdn.types.arrays import Real
from rcdn.types.base import Array

WIDTH = 360
"""width of a drawing, px"""
MOST_CORNERS = 4000
"""largest number of corners in a drawing"""
COLOURS = ("#d1495b", "#00798c", "#edae49", "#30638e", "#6a994e", "#8f5fb5")
"""colours of the boards in a drawing, in turn"""
LEVEL_COLOURS = {"good": "#2e7d32", "fair": "#9e7700", "unsure": "#b35900", "bad": "#b00020"}


def decimals(deviation: float) -> int:
    """Number of decimals for a value with this standard deviation, so that two digits of the deviation are shown."""
    return int(np.clip(1 - np.floor(np.log10(max(deviation, 1e-9))), 1, 8)) if np.isfinite(deviation) else 4


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """An HTML table of texts."""
    cells = ["".join(f"<th>{escape(text)}</th>" for text in head)]
    cells += ["".join(f"<td>{escape(text)}</td>" for text in row) for row in rows]
    return f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"


def deviations(names: Sequence[str], values: Array, std: Array | None = None) -> str:
    """A table of parameters by name, with their standard deviations where they are known."""
    if std is None:
        return table(("parameter", "value"), ((n, f"{v:.7g}") for n, v in zip(names, values, strict=True)))
    rows = ((n, f"{v:z.{decimals(s)}f}", f"{s:.{decimals(s)}f}") for n, v, s in zip(names, values, std, strict=True))
    return table(("parameter", "value", "± deviation"), rows)


def paragraph(text: str, level: str | None = None) -> str:
    """A line of text, in the colour of the verdict `level` if one is given."""
    style = f' style="color:{LEVEL_COLOURS[level]};font-weight:bold"' if level else ""
    return f"<p{style}>{escape(text)}</p>"


def drawing(
    size: tuple[int, int], boards: Sequence[tuple[Array, Array]], others: Real[Array, "n 2"] | None = None
) -> str:
    """An SVG of a picture's frame with its boards, each (positions (M, 2), labels (M, 2)): rows as lines, the corner
    (0, 0) as a ring; and `others` (N, 2), corners without a board."""
    width, height = size
    unit = width / WIDTH
    parts = [f'<rect x="-.5" y="-.5" width="{width}" height="{height}" fill="#8881" stroke="#888" {_stroke(unit)}/>']
    if others is not None:
        parts.append(_dots(others[:MOST_CORNERS], "#888", 1.5 * unit))
    for k, (xy, ij) in enumerate(boards):
        parts.append(_board(xy, ij, COLOURS[k % len(COLOURS)], unit))
    frame = f'viewBox="-.5 -.5 {width} {height}" width="{WIDTH}" height="{max(WIDTH * height // width, 1)}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {frame}>{"".join(parts)}</svg>'


def _board(xy: Array, ij: Array, colour: str, unit: float) -> str:
    if not len(xy):
        return ""
    order = np.lexsort((ij[:, 0], ij[:, 1]))[:MOST_CORNERS]
    xy, ij = xy[order], ij[order]
    rows = np.split(xy, np.flatnonzero(np.diff(ij[:, 1])) + 1)
    lines = "".join(
        f'<polyline points="{_points(row)}" fill="none" stroke="{colour}" {_stroke(unit)}/>' for row in rows
    )
    x, y = xy[0]
    first = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{5 * unit:.2f}" fill="none" stroke="{colour}" {_stroke(2 * unit)}/>'
    return lines + _dots(xy, colour, 2 * unit) + first


def _points(xy: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in xy.tolist())


def _dots(xy: Array, colour: str, radius: float) -> str:
    spots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.2f}"/>' for x, y in xy.tolist())
    return f'<g fill="{colour}">{spots}</g>'


def _stroke(width: float) -> str:
    return f'stroke-width="{width:.2f}"'
