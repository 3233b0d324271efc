"""Figs. 4 and 5: a heat map for each method and pre-blur, with a common colour scale. The caller makes the (matplotlib)
figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Row = dict[str, Any]
RANGE = (0.02, 10.0)
"""px; errors outside are drawn like its ends"""
TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10)
WIDE, HIGH = 3.1, 2.6
"""size of a panel, inches"""


def draw_pixel_error(figure: Any, rows: Sequence[Row]) -> None:
    """Mean error of every method over angle and noise, without pre-blur above and with it below; colours are
    logarithmic.

    `rows`: those of `rcdn evaluate fig4` or `fig5`.
    """
    angle = "rotation" if "rotation" in rows[0] else "tilt"
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure.set_size_inches(WIDE * len(methods) + 1, 2 * HIGH + 0.3)
    panels = figure.subplots(2, len(methods), sharex=True, sharey=True, squeeze=False)
    for line, blurred in zip(panels, (False, True), strict=True):
        for axes, method in zip(line, methods, strict=True):
            mine = [row for row in rows if (row["method"], row["pre-blur"]) == (method, blurred)]
            mesh = _heat(axes, mine, angle)
            axes.set_title(method + (", pre-blur" if blurred else ""), fontsize=10)
        line[0].set_ylabel("noise, grey levels")
    for axes in panels[-1]:
        axes.set_xlabel(f"{angle}, degrees")
    scale = figure.colorbar(mesh, ax=panels, label="mean error, px", extend="both", fraction=0.05, pad=0.02)
    scale.set_ticks(TICKS, labels=[f"{tick:g}" for tick in TICKS])
    scale.minorticks_off()


def _heat(axes: Any, rows: Sequence[Row], angle: str) -> Any:
    """One map; a cell extends half a step around its angle and noise."""
    across, up = (sorted({row[key] for row in rows}) for key in (angle, "noise"))
    value = np.full((len(up), len(across)), np.nan)
    for row in rows:
        value[up.index(row["noise"]), across.index(row[angle])] = max(row["mean px"], RANGE[0])
    mesh = axes.pcolormesh(
        across, up, value, cmap="viridis", norm="log", vmin=RANGE[0], vmax=RANGE[1], shading="nearest"
    )
    axes.set_xticks([a for a in across if a % (30 if across[-1] > 70 else 20) == 0])
    return mesh
