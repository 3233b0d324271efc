"""Checks of what the pictures say together: whether they are of one camera, and whether they settle it. Each gives reasons of a verdict."""

from __future__ import annotations

from rcdn.calibration import one_camera as several
from rcdn.calibration.facts import Facts
from rcdn.calibration.limits import reason
from rcdn.calibration.observability import unsettled
from rcdn.types import Calibration, Reason


def one_camera(c: Calibration, facts: Facts) -> list[Reason]:
    """Groups of pictures of different cameras, zooms or focus; nothing is said of too few views to tell."""
    found = several.one_camera(c)
    if found is not None:
        return [reason("one_camera", found.difference, "", found.finding, several.REMEDY)]
    if len(c.used_views) < several.ENOUGH:
        return []
    return [reason("one_camera", 0.0, "All pictures are of one camera, as far as they tell.", "", "")]


def settled(c: Calibration, facts: Facts) -> list[Reason]:
    """What views contradict each other on, or can't tell: focal length, principal point, aspect ratio."""
    found = [reason("unsettled", u.deviation / u.limit, "", u.finding, u.remedy) for u in unsettled(c)]
    return found or [reason("unsettled", 0.0, "The views agree on focal length and principal point.", "", "")]
