"""Checks of the pictures: whether they come from one camera and determine it, sizes, board, number, variety, views left
out. Each returns reasons of a verdict."""

from __future__ import annotations

from collections import Counter

import numpy as np

from rcdn.calibration import one_camera as several
from rcdn.calibration import turned
from rcdn.calibration.facts import Facts
from rcdn.calibration.limits import LIMITS, reason
from rcdn.calibration.observability import undetermined
from rcdn.errors import many, were_left_out
from rcdn.types import Array, Calibration, Reason

THIRDS = (
    ("upper left", "upper middle", "upper right"),
    ("left", "middle", "right"),
    ("lower left", "lower middle", "lower right"),
)


OR_ANOTHER = "If they are of another camera, whose names differ, calibrate each group by itself."
"""what else to do about turned pictures whose file names differ from the others'"""


def one_camera(c: Calibration, facts: Facts) -> list[Reason]:
    """Pictures that are turned or mirrored, or groups from different cameras, zooms or focus settings; no reason if the
    views are too few for the test."""
    found, back = several.one_camera(c), turned.turned_pictures(c)
    by_names = found is not None and found.by == "names"
    if back is not None and (found is None or not by_names or back.explains(found.groups)):
        remedy = f"{back.remedy} {OR_ANOTHER}" if by_names else back.remedy
        return [reason("one_camera", back.difference, "", back.finding, remedy)]
    if found is not None:
        return [reason("one_camera", found.difference, "", found.finding, several.REMEDY)]
    if len(c.used_views) < several.ENOUGH:
        return []
    return [reason("one_camera", 0.0, "All pictures are of one camera, as far as they tell.", "", "")]


def determined(c: Calibration, facts: Facts) -> list[Reason]:
    """Parameters that the views do not determine: focal length, principal point, aspect ratio."""
    found = [reason("unsettled", u.deviation / u.limit, "", u.finding, u.remedy) for u in undetermined(c)]
    return found or [reason("unsettled", 0.0, "The views agree on focal length and principal point.", "", "")]


def spacing(c: Calibration, facts: Facts) -> list[Reason]:
    """A side of a square that is implausible in metres; no reason if it is plausible."""
    found = reason(
        "spacing", c.spacing, "",
        f"A spacing of {c.spacing:g} m makes a board of {c.spacing:g} m squares: "
        "distances will be wrong if these are millimetres.",
        "Give the side of one square in metres (25 mm: 0.025).",
    )  # fmt: skip
    return [] if found.level == "good" else [found]


def picture_size(c: Calibration, facts: Facts) -> list[Reason]:
    """Pictures of another size among those of this camera; no reason if there are none."""
    odd = [v for v in c.views if v.reason.startswith("its picture has ")]
    if not odd:
        return []
    words = odd[0].reason.removeprefix("its picture has ").split(",")[0]
    return [
        reason(
            "picture_size", len(odd) / len(c.views), "",
            f"{many(len(odd), 'picture')} of {len(c.views)} {'has' if len(odd) == 1 else 'have'} another size "
            f"({words}) and {'was' if len(odd) == 1 else 'were'} left out: another camera, "
            "or another setting of this one.",
            "Calibrate pictures of one camera at one resolution.",
        )
    ]  # fmt: skip


def board_size(c: Calibration, facts: Facts) -> list[Reason]:
    """A board whose size was given wrongly, most often in squares instead of inner corners; no reason if a whole board
    was seen, or parts of different sizes."""
    used = c.used_views
    if not used or c.size is None or any(v.settled and (v.target or sorted(box(v.ij)) == sorted(c.size)) for v in used):
        return []
    boxes = Counter(tuple(sorted(box(v.ij))) for v in used)
    squares = tuple(sorted(n - 1 for n in c.size))
    seen, count = boxes.most_common(1)[0]
    if count <= boxes[squares]:
        seen, count = squares, boxes[squares]
    share = count / len(used)
    smaller = all(a <= b for a, b in zip(seen, sorted(c.size), strict=True))
    if seen != squares and not (smaller and share > LIMITS["board_size"].fair):
        return []
    cols, rows = seen if c.size[0] < c.size[1] else seen[::-1]
    question = "was the board named by its squares?" if seen == squares else "was another board named?"
    return [
        reason(
            "board_size", share, "",
            f"No view shows the whole {c.size[0]}×{c.size[1]} board, and {share:.0%} show exactly "
            f"{max(seen)}×{min(seen)} corners: {question}",
            f"Name its inner corners: {cols}×{rows}.",
        )
    ]  # fmt: skip


def views(c: Calibration, facts: Facts) -> list[Reason]:
    """The number of views, near-duplicates counted once."""
    views, distinct = facts.views.many, facts.views.distinct
    need = f"{LIMITS['views'].good:g}"
    wrong = f"Only {many(views, 'view')}: one bad picture can bend the result."
    if distinct < views:
        places = "always in the same place" if distinct == 1 else f"in only {distinct} different places"
        wrong = f"{many(views, 'view')}, but the board stands {places}: near-duplicates tell nothing new."
    return [
        reason(
            "views", distinct, "Enough different boards for chance to average out.", wrong,
            f"Take {need} to 30, of the board in different places, distances and tilts.",
        )
    ]  # fmt: skip


def tilt(c: Calibration, facts: Facts) -> list[Reason]:
    """The tilts of the boards, and whether they have more than one direction."""
    how = "Tilt it by 30° to 45°, to different sides."
    found = [
        reason(
            "tilt", facts.views.tilt, "The boards are tilted enough to tell focal length from distance.",
            f"The board nearly faces the camera in all pictures (tilt at most {facts.views.tilt:.0f}°): that doesn't "
            "tell focal length from distance.",
            how,
        )
    ]  # fmt: skip
    if found[0].level == "good":
        found += [
            reason(
                "tilt_spread", facts.views.spread, "The boards are tilted in several directions.",
                "The board is tilted in nearly one direction in all pictures (its tilts vary by "
                f"{facts.views.spread:.1f}° across it): focal length and principal point can make up for each other.",
                how,
            )
        ]  # fmt: skip
    return found


def left_out(c: Calibration, facts: Facts) -> list[Reason]:
    """Views that have a pose but are outliers."""
    out = [v for v in c.left_out if v.pose is not None]
    of = len(out) + len(c.used_views)
    some = ", ".join(dict.fromkeys(v.name for v in out[:3])) + (", …" if len(out) > 3 else "")
    return [
        reason(
            "left_out", len(out) / max(of, 1),
            "Hardly any view disagrees with the others." if out else "No view disagrees with the others.",
            f"{len(out)} of {many(of, 'view')} {were_left_out(len(out))} ({some}): another camera, zoom or board, "
            "wrong corners, or a board that moved.",
            "Look at them in the report, and take out what doesn't belong to this camera.",
        )
    ]  # fmt: skip


def coverage(c: Calibration, facts: Facts) -> list[Reason]:
    """The part of the sensor that corners cover."""
    empty = int((facts.in_view & (facts.coverage == 0)).sum())
    where = _thirds(c)
    none = f", none in the {where}" if where else ""
    wrong = (
        f"{empty} of {int(facts.in_view.sum())} cells of the sensor {'has' if empty == 1 else 'have'} no corner{none}: "
        "there the lens is guessed."
    )
    return [
        reason(
            "coverage", facts.covered, f"Corners cover {facts.covered:.0%} of the sensor.", wrong,
            "Hold the board there, too, tilted." if where
            else "Bring the board to the edges and corners of the picture.",
        )
    ]  # fmt: skip


def _thirds(c: Calibration) -> str:
    """The thirds of the frame without a corner, in words; "" if there are none."""
    (w, h), xy = c.camera.image_size, np.concatenate([v.xy[v.used] for v in c.used_views] or [np.zeros((0, 2))])
    col, row = (np.clip((xy[:, a] + 0.5) * 3 // n, 0, 2).astype(int) for a, n in ((0, w), (1, h)))
    seen = Counter(zip(row.tolist(), col.tolist(), strict=True))
    empty = [THIRDS[j][i] for j in range(3) for i in range(3) if not seen[j, i]]
    if not empty:
        return ""
    return f"{empty[0]} third" if len(empty) == 1 else f"{', '.join(empty[:-1])} and {empty[-1]} thirds"


def box(ij: Array) -> tuple[int, int]:
    """Columns and rows that the labels (M, 2) span."""
    cols, rows = ij.max(axis=0) - ij.min(axis=0) + 1
    return int(cols), int(rows)
