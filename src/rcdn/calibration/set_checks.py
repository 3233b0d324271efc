"""Checks of the pictures as a set: whether they come from one camera, and whether they determine it. Each returns
reasons of a verdict."""

from __future__ import annotations

from rcdn.calibration import one_camera as several
from rcdn.calibration.facts import Facts
from rcdn.calibration.limits import reason
from rcdn.calibration.observability import unsettled
from rcdn.types import Calibration, Reason


def one_camera(c: Calibration, facts: Facts) -> list[Reason]:
    """Groups of pictures from different cameras, zooms or focus settings; no reason if the views are too few for the
    test."""
    found = several.one_camera(c)
    if found is not None:
        return [reason("one_camera", found.difference, "", found.finding, several.REMEDY)]
    if len(c.used_views) < several.ENOUGH:
        return []
    return [reason("one_camera", 0.0, "All pictures are of one camera, as far as they tell.", "", "")]


def settled(c: Calibration, facts: Facts) -> list[Reason]:
    """Parameters that the views do not determine: focal length, principal point, aspect ratio."""
    found = [reason("unsettled", u.deviation / u.limit, "", u.finding, u.remedy) for u in unsettled(c)]
    return found or [reason("unsettled", 0.0, "The views agree on focal length and principal point.", "", "")]
