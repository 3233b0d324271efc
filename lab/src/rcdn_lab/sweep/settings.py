"""Settings of the sweep: a setting is one row of the table, a factor a list of settings that differ from the base in
one respect."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Setting:
    """Parameters of the pictures of one row. The defaults are the base: a plain picture of one 9×6 board, 25-px
    squares.

    `noise`: σ, grey levels; `blur`: σ, px; `motion`: length, px; `tilt`: degrees between the board's normal and the
    line of sight to its centre, None: 0 to 20 at random; `barrel`: k of x ÷ (1 − k r²), r in widths of the picture (a
    lens of 180° from corner to corner has 2.56); `fisheye`: degrees across the picture's width, equidistant;
    `contrast`: grey levels from black to white; `falloff`: brightest ÷ darkest light across the picture; `shadow`:
    share of light in the half of the board that lies in shadow; `penumbra`: width of its edge, px; `jpeg`: quality, 0:
    none; `square`: px, seen frontally; `cover`: an object over the board; `bar`: width of the bar, squares; `cut`:
    share of the corners beyond the frame; `bend`: how the sheet bends; `boards`: number of boards; `clutter`: the
    background.
    """

    noise: float = 3.0
    blur: float = 0.7
    motion: float = 0.0
    tilt: float | None = None
    barrel: float = 0.0
    fisheye: float = 0.0
    contrast: float = 170.0
    falloff: float = 1.0
    shadow: float = 1.0
    penumbra: float = 1.0
    jpeg: int = 0
    square: float = 25.0
    cover: str = ""
    """`quadrant`, `bar` or nothing"""
    bar: float = 1.0
    cut: float = 0.0
    bend: str = ""
    """`cylinder R` (radius), `wave A` (height over the plane), both in squares, or nothing"""
    boards: int = 1
    clutter: str = ""
    """a kind of `rcdn.synthetic.background`; empty: noise, shapes and text in turn"""


BASE = Setting()
Factor = dict[str, Setting]
"""Name of a level → its setting."""


def _levels(name: str, *values: Any, **fixed: Any) -> Factor:
    return {str(v): replace(BASE, **{name: v}, **fixed) for v in values}


def _singles() -> dict[str, Factor]:
    out = {
        name: _levels(name, *values)
        for name, values in {
            "noise": (0, 3, 5, 10, 20, 30, 40, 50, 60),
            "blur": (0, 1, 2, 3, 4, 5, 6),
            "motion": (3, 6, 9, 15),
            "tilt": (0, 15, 30, 45, 60, 70, 75),
            "barrel": (0.5, 1.5, 2.5),
            "fisheye": (120, 150, 180),
            "contrast": (100, 50, 30, 20, 12),
            "falloff": (2, 5, 20),
            "jpeg": (80, 50, 30, 20, 10),
            "square": (6, 8, 10, 14, 20, 25, 40, 60),
            "cut": (0.2, 0.33, 0.5),
            "bend": ("cylinder 12", "cylinder 6", "wave 0.3", "wave 0.6"),
            "boards": (2, 3, 4, 6),
        }.items()
    }
    out["shadow"] = {
        "hard 0.5": replace(BASE, shadow=0.5),
        "hard 0.25": replace(BASE, shadow=0.25),
        "soft 0.25": replace(BASE, shadow=0.25, penumbra=40),
    }
    out["cover"] = {
        "quadrant": replace(BASE, cover="quadrant"),
        "bar 1": replace(BASE, cover="bar"),
        "bar 2": replace(BASE, cover="bar", bar=2),
    }
    out["empty"] = _levels("clutter", "plain", "noise", "shapes", "text", "tiles", "blocks", boards=0)
    return out


FACTORS: dict[str, Factor] = {
    **_singles(),
    "two": {
        "noise 20, tilt 60": replace(BASE, noise=20, tilt=60),
        "noise 20, blur 3": replace(BASE, noise=20, blur=3),
        "noise 20, square 10": replace(BASE, noise=20, square=10),
        "noise 20, quadrant": replace(BASE, noise=20, cover="quadrant"),
        "noise 20, shadow 0.25": replace(BASE, noise=20, shadow=0.25),
        "noise 10, contrast 50": replace(BASE, noise=10, contrast=50),
        "noise 20, tiles": replace(BASE, noise=20, clutter="tiles"),
        "blur 3, tilt 60": replace(BASE, blur=3, tilt=60),
        "blur 3, cut 0.33": replace(BASE, blur=3, cut=0.33),
        "blur 3, jpeg 20": replace(BASE, blur=3, jpeg=20),
        "blur 2, square 10": replace(BASE, blur=2, square=10),
        "barrel 1.5, tilt 45": replace(BASE, barrel=1.5, tilt=45),
        "fisheye 150, tilt 60": replace(BASE, fisheye=150, tilt=60),
        "cylinder 6, quadrant": replace(BASE, bend="cylinder 6", cover="quadrant"),
    },
}
"""Factor → level → setting: everything measured by `rcdn evaluate sweep`."""
