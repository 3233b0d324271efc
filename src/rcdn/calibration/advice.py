"""What to tell the person with the camera: plain sentences, the gravest first."""

from __future__ import annotations

from collections import Counter

import numpy as np

from rcdn.calibration.labels import fits
from rcdn.calibration.sight import reach
from rcdn.calibration.uncertainty import coverage, projection_uncertainty
from rcdn.types import Array, Calibration

FEW_VIEWS, LITTLE_TILT = 10, 20.0
"""views; degrees between board and sensor"""
LOOSE_FOCAL, LOOSE_PIXELS = 0.005, 1.0
"""share of the focal length, px of projection in a corner of the picture: standard deviations that are worth a word"""
WHOLE_FRAME = 0.995
"""share of the frame with rays"""
WORSE_HELD_OUT = 1.4
"""× the calibration's RMS"""
MANY_OUTLIERS = 0.05
ROUGH = 0.0015
"""of the picture's width: an RMS that no good detector and flat board give"""
FAR_SPACING = 1.0
"""m"""
THIRDS = (
    ("upper left", "upper middle", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "lower middle", "lower right"),
)


def advise(calibration: Calibration) -> tuple[str, ...]:
    """Sentences on what weakens `calibration` and what to do about it; () if nothing does."""
    checks = (
        _reach,
        _focal,
        _few,
        _tilt,
        _coverage,
        _corners_of_picture,
        _held_out,
        _rough,
        _outliers,
        _sizes,
        _symmetric,
        _spacing,
    )
    return tuple(text for check in checks if (text := check(calibration)))


def tilts(calibration: Calibration) -> Array:
    """(V,) degrees by which each used board is tilted against the sensor."""
    normals = np.array([v.pose.R[2, 2] for v in calibration.used_views if v.pose is not None])
    return np.degrees(np.arccos(np.clip(np.abs(normals), 0, 1)))


def _reach(c: Calibration) -> str:
    share = reach(c.camera)
    if share >= WHOLE_FRAME:
        return ""
    return (
        f"The lens model turns back inside the picture: {1 - share:.0%} of it has no rays. Bring the board into the corners of the picture, "
        "or take another model."
    )


def _focal(c: Calibration) -> str:
    share = float(max(c.std[0] / c.camera.K[0, 0], c.std[1] / c.camera.K[1, 1]))
    if share < LOOSE_FOCAL:
        return ""
    return f"The focal length is known only to ±{share:.1%}: add pictures of the board tilted by 30° to 45°, to different sides."


def _few(c: Calibration) -> str:
    many = len(c.used_views)
    if many >= FEW_VIEWS:
        return ""
    return f"Only {many} views: take {FEW_VIEWS} to 30, of the board in different places, distances and tilts."


def _tilt(c: Calibration) -> str:
    most = float(np.quantile(tilts(c), 0.9)) if c.used_views else 90.0
    if most >= LITTLE_TILT:
        return ""
    return f"The board nearly faces the camera in all pictures (tilt at most {most:.0f}°): tilt it by 30° to 45°, to different sides."


def _coverage(c: Calibration) -> str:
    counts = coverage(c, (3, 3))
    empty = [THIRDS[j][i] for j in range(3) for i in range(3) if counts[j, i] == 0]
    if not empty:
        return ""
    where = empty[0] if len(empty) == 1 else f"{', '.join(empty[:-1])} and {empty[-1]}"
    thirds = "third" if len(empty) == 1 else "thirds"
    return f"No corner in the {where} {thirds} of the picture: hold the board there, too, tilted."


def _corners_of_picture(c: Calibration) -> str:
    w, h = c.camera.image_size
    std = projection_uncertainty(c, np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]))
    worst = float(np.nanmax(std)) if np.isfinite(std).any() else 0.0
    if worst < LOOSE_PIXELS:
        return ""
    return f"Towards the corners of the picture projections are known only to ±{worst:.1f} px: bring the board into the corners."


def _held_out(c: Calibration) -> str:
    if not c.held_out > WORSE_HELD_OUT * c.rms:
        return ""
    return (
        f"Pictures held out of the calibration fit {c.held_out / c.rms:.1f} times worse ({c.held_out:.2f} px) than those in it: "
        "there are too few different views for this lens model."
    )


def _rough(c: Calibration) -> str:
    if not c.rms > ROUGH * c.camera.image_size[0]:
        return ""
    return (
        f"An RMS of {c.rms:.2f} px is much for {c.camera.image_size[0]} px of width: is the board flat and stiff, did zoom, focus "
        "and resolution stay the same, was nothing moving?"
    )


def _outliers(c: Calibration) -> str:
    many, of = c.outliers, sum(len(v) for v in c.used_views)
    if many <= MANY_OUTLIERS * of:
        return ""
    return f"{many} of {of} corners disagree with the others and were left out: look at them in the report."


def _sizes(c: Calibration) -> str:
    if c.size is None:
        return "No view shows a whole board: name its size (inner corners) to settle labels."
    sizes = Counter("{}×{}".format(*_box(v.ij)) for v in c.used_views if not v.settled and not fits(_box(v.ij), c.size))
    if not sizes:
        return ""
    what = ", ".join(f"{s} in {n} views" for s, n in sizes.most_common())
    return (
        f"Boards that aren't part of the {c.size[0]}×{c.size[1]} one were used, too ({what}): distances hold only if their squares are "
        "as large. Name the size to leave them out."
    )


def _symmetric(c: Calibration) -> str:
    if c.orientation in (None, "unique") or c.size is None:
        return ""
    cols, rows = c.size
    turn = "half a turn" if c.orientation == "ambiguous_180" else "quarter turns"
    return (
        f"A {cols}×{rows} board looks the same after {turn}: lens and RMS don't mind, but poses may be turned by that. A board with one odd "
        "and one even side (9×6) has only one way up."
    )


def _spacing(c: Calibration) -> str:
    if c.spacing < FAR_SPACING:
        return ""
    return f"A spacing of {c.spacing:g} m makes large squares: it is the side of one square in metres (25 mm: 0.025)."


def _box(ij: Array) -> tuple[int, int]:
    cols, rows = ij.max(axis=0) - ij.min(axis=0) + 1
    return int(cols), int(rows)
