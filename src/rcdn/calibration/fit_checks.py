"""Checks of the solution: residuals, corners left out, uncertainty, the lens model. Each returns reasons of a
verdict."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.choose import SIMPLER
from rcdn.calibration.facts import Facts
from rcdn.calibration.limits import growth, reason
from rcdn.errors import two_digits, were_left_out
from rcdn.types import Array, Calibration, Level, Reason

UNEVEN_FROM = 0.25
"""px, RMS of the half of the views with the larger residuals, below which unevenness is negligible"""
SIGMAS = 3.0
"""standard deviations by which fy ÷ fx must differ from 1 to be significant"""


def board(c: Calibration, facts: Facts) -> list[Reason]:
    """A print that is stretched, and a board that is bent in all views: both are estimated, but reported; none if the
    shape is unknown."""
    b = facts.board
    if not np.isfinite(b.stretch):
        return []
    way = "wider" if b.stretch > 0 else "less wide"
    bend = 1e3 * b.bend * (max(c.size or (1, 1)) - 1) * c.spacing
    return [
        reason(
            "stretched", abs(b.stretch), f"The print's squares are square, to {max(abs(b.stretch), 1e-4):.2%}.",
            f"The board's squares aren't square: {abs(b.stretch):.1%} {way} than high. The lens is right, "
            "lengths in poses may be off by that.",
            "Measure the print both ways, and print it again without scaling.",
        ),
        reason(
            "bent", b.bend, f"The board is flat, to {bend:.2g} mm.",
            f"The board is bent by {bend:.2g} mm. The camera takes that into account.",
            "A board on something flat and stiff makes a better camera.",
        ),
    ]  # fmt: skip


def dropped(c: Calibration, facts: Facts) -> list[Reason]:
    """Corners left out of views that were used: their number, and whether they are concentrated in one region."""
    r = facts.residuals
    seen = sum(len(v) for v in c.used_views)
    found = [
        reason(
            "dropped", r.dropped,
            f"Nearly all corners agree ({r.dropped:.1%} left out)." if c.outliers else "All corners agree.",
            f"{c.outliers} of {seen} corners ({r.dropped:.0%}) {were_left_out(c.outliers)}: "
            "the figures are of the rest.",
            "Look at them in the report: wrong corners, motion, a bent board, or a lens that the model doesn't follow.",
        )
    ]  # fmt: skip
    where = _place(r.crowd)
    found += [
        reason(
            "crowded", r.crowded, "Corners left out lie scattered." if c.outliers else "No region was left out.",
            f"The corners left out sit together: {r.crowded:.0%} of those seen {where}. There the lens model or the "
            "board is wrong, not the corners.",
            "Try another lens model, and look whether the board is flat and lit there.",
        )
    ]  # fmt: skip
    return found


def rms(c: Calibration, facts: Facts) -> list[Reason]:
    """The reprojection error."""
    width = c.camera.image_size[0]
    return [
        reason(
            "rms", c.rms, "The camera explains the corners about as well as they can be found.",
            f"An RMS of {c.rms:.2f} px is much for {width} px of width: a board that isn't flat and stiff, zoom or "
            "focus that changed, something that moved, or a lens model that doesn't fit.",
            "Look at the worst views in the report.", factor=growth(c.camera.image_size),
        )
    ]  # fmt: skip


def held_out(c: Calibration, facts: Facts) -> list[Reason]:
    """The error in pictures from which the camera was not calibrated."""
    ratio = facts.held_ratio
    if not np.isfinite(ratio):
        return [
            reason(
                "held_out", ratio, "",
                "Too few pictures to hold some back: nothing shows how the camera does in new ones.",
                "Take more pictures.",
                level="fair",
            )
        ]  # fmt: skip
    others = [m.held_out for m in c.models[1:] if np.isfinite(m.held_out)]
    chosen = bool(others) and c.models[0].held_out <= SIMPLER * min(others)
    simpler = "" if chosen else ", or a simpler lens model"
    return [
        reason(
            "held_out", ratio,
            f"Pictures held out of the calibration fit {ratio:.2f} times the RMS: it does as well in new ones.",
            f"Pictures held out of the calibration fit {ratio:.1f} times worse than those in it: there are too few "
            "different views for this lens model.",
            f"Take more pictures, with more variety{simpler}.",
        )
    ]  # fmt: skip


def systematic(c: Calibration, facts: Facts) -> list[Reason]:
    """Mean residuals that are significant in a region of the sensor."""
    cells = facts.residuals.cells
    odd, of = int(cells.systematic.sum()), len(cells.systematic)
    if not of:
        return []
    return [
        reason(
            "systematic", cells.rms,
            f"Hardly anything stands out from chance ({odd} of {of} cells of the sensor)." if odd
            else "Nothing stands out from chance.",
            f"In {odd} of {of} cells of the sensor corners are systematically off, by up to {cells.largest:.2f} px: "
            "the lens isn't followed there.",
            "Try another lens model, or a flatter board.", factor=growth(c.camera.image_size),
        )
    ]  # fmt: skip


def smooth(c: Calibration, facts: Facts) -> list[Reason]:
    """Residuals that neighbours on the board have in common."""
    r = facts.residuals
    return [
        reason(
            "smooth", r.smooth, f"Neighbouring corners share {r.smooth:.2f} px of their residuals: little enough.",
            f"Neighbouring corners err alike, by {r.smooth:.2f} px (correlation {r.correlation:.2f}): a board that "
            "isn't flat or evenly printed, or that moved while the picture was taken.",
            "Put the board on something flat and stiff, and hold it still.", factor=growth(c.camera.image_size),
        )
    ]  # fmt: skip


def uneven(c: Calibration, facts: Facts) -> list[Reason]:
    """Views with a much larger scatter than the others."""
    r = facts.residuals
    if not np.isfinite(r.uneven):
        return []
    level: Level | None = "good" if r.rough <= UNEVEN_FROM * growth(c.camera.image_size) else None
    return [
        reason(
            "uneven", r.uneven, "The views scatter alike.",
            f"Half of the views scatter {r.uneven:.1f} times as much as the others ({r.rough:.2f} px): blurred or "
            "moving pictures, another board, or another camera.",
            "Look at the worst views in the report, and take them out.", level=level,
        )
    ]  # fmt: skip


def reach(c: Calibration, facts: Facts) -> list[Reason]:
    """Pixels for which the lens model has no ray."""
    other = "" if c.camera.model == "fisheye" else ", or take another model (fisheye for a wide lens)"
    return [
        reason(
            "reach", facts.reach, "Every pixel that the lens can fill has a ray.",
            f"The lens model breaks down inside the picture: {1 - facts.reach:.1%} of it has no rays.",
            f"Bring the board into the corners of the picture{other}.",
        )
    ]  # fmt: skip


def parameters(c: Calibration, facts: Facts) -> list[Reason]:
    """Uncertainty of focal length and principal point, and whether pixels are square."""
    how = "Add pictures of the board tilted by 30° to 45°, to different sides, near and far."
    width = c.camera.image_size[0]
    beyond = max(abs(facts.aspect - 1) - SIGMAS * facts.aspect_std, 0.0)
    return [
        reason(
            "focal", facts.focal_std, "The pictures settle the focal length.",
            f"The focal length is known only to ±{facts.focal_std:.1%}.", how
        ),
        reason(
            "centre", facts.centre_std / width, "The pictures settle the principal point.",
            f"The principal point is known only to ±{two_digits(facts.centre_std)} px.", how,
        ),
        reason(
            "aspect", beyond, "Pixels are square, as far as the pictures tell.",
            f"fy is {facts.aspect:.3f} × fx (±{facts.aspect_std:.3f}): pixels are hardly ever that far from square. "
            "The print may be stretched, or the picture.",
            "Measure the printed board both ways: its squares must be square.",
        ),
    ]  # fmt: skip


def projections(c: Calibration, facts: Facts) -> list[Reason]:
    """Projection uncertainty, typical and in the corners of the frame."""
    factor = growth(c.camera.image_size)
    rim = f"known only to ±{two_digits(facts.at_corners)} px"
    if not np.isfinite(facts.at_corners):
        rim = "not known at all" + ": the lens model has no rays there" * bool(np.isinf(facts.at_corners))
    typical = two_digits(facts.typical)
    return [
        reason(
            "typical", facts.typical, f"In half of the picture projections are known to ±{typical} px.",
            f"In half of the picture projections are known only to ±{typical} px or worse.",
            "Add pictures, with more variety: tilted, near and far, all over the picture.", factor=factor,
        ),
        reason(
            "corners", facts.at_corners, "Projections are firm out to the corners of the picture.",
            f"Towards the corners of the picture projections are {rim}.", "Bring the board into the corners.",
            factor=factor,
        ),
    ]  # fmt: skip


def _place(at: Array) -> str:
    """`around (320, 240) px`, or `in one region` if the position is unknown."""
    return f"around ({at[0]:.0f}, {at[1]:.0f}) px" if np.isfinite(at).all() else "in one region"
