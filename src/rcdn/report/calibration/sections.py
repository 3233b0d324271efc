"""What the page of a camera shows of a calibration: its facts, and the drawings over its sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.facts import Facts
from rcdn.report.calibration import charts, maps
from rcdn.report.calibration.formats import number
from rcdn.report.calibration.svg import Drawing
from rcdn.types import Calibration, Camera


@dataclass(frozen=True)
class CameraFacts:
    """The figures at the head of the page: numbers of boards, pictures and corners; lengths in px; `has_corners`:
    whether the lens model has rays in a corner of the frame."""

    model: str
    size: str
    pictures: int
    boards: int
    used_pictures: int
    used_boards: int
    seen: int
    used: int
    rms: float
    held_ratio: float
    typical: float
    at_corners: float
    has_corners: bool
    focal: float
    focal_std: float
    view_angles: tuple[str, str]


@dataclass(frozen=True)
class LeftOut:
    """A view that was left out: its number (from 1), its picture, and why."""

    number: int
    name: str
    reason: str


@dataclass(frozen=True)
class Charts:
    """The RMS of each view as `bars` and of all, px; the views left out; residuals against the `radius`."""

    bars: Drawing
    rms: float
    left_out: list[LeftOut]
    radius: Drawing


@dataclass(frozen=True)
class CameraDrawings:
    """The drawings of one camera; `key` is part of its anchors, `whose` ends the titles. `covered`: the fraction of the
    cells with a corner."""

    key: str
    whose: str
    covered: float
    coverage: Drawing
    uncertainty: Drawing
    residuals: Drawing
    means: Drawing
    charts: Charts | None


def camera_facts(calibration: Calibration, facts: Facts) -> CameraFacts:
    """The figures of a calibration."""
    camera, used = calibration.camera, calibration.used_views
    return CameraFacts(
        model=camera.model,
        size="{} × {}".format(*camera.image_size),
        pictures=len({v.name for v in calibration.views}),
        boards=len(calibration.views),
        used_pictures=len({v.name for v in used}),
        used_boards=len(used),
        seen=facts.seen,
        used=facts.used,
        rms=calibration.rms,
        held_ratio=facts.held_ratio,
        typical=facts.typical,
        at_corners=facts.at_corners,
        has_corners=bool(np.isfinite(facts.corners).any()),
        focal=float(np.sqrt(camera.K[0, 0] * camera.K[1, 1])),
        focal_std=facts.focal_std,
        view_angles=view_angles(facts.fov),
    )


def lens_in_words(camera: Camera) -> str:
    """The lens model and the size of the pictures."""
    return "{} {} × {} px".format(camera.model, *camera.image_size)


def view_angles(fov: tuple[float, float, float]) -> tuple[str, str]:
    """The horizontal × vertical field of view, and the diagonal one, as text."""
    if not np.isfinite(fov[:2]).all():
        return "unknown", "the lens model ends inside the frame"
    return f"{number(fov[0])}° × {number(fov[1])}°", f"{number(fov[2])}° diagonal" if np.isfinite(fov[2]) else ""


def drawings(
    calibration: Calibration, facts: Facts, key: str = "", whose: str = "", with_charts: bool = True
) -> CameraDrawings:
    """The drawings of a camera."""
    return CameraDrawings(
        key=key,
        whose=whose,
        covered=facts.covered,
        coverage=maps.coverage_map(calibration, facts),
        uncertainty=maps.uncertainty_map(calibration, facts),
        residuals=maps.residual_map(calibration),
        means=maps.mean_map(calibration, facts.residuals.cells),
        charts=_charts(calibration, key) if with_charts else None,
    )


def _charts(calibration: Calibration, key: str) -> Charts:
    left_out = [LeftOut(k, v.name, v.reason) for k, v in enumerate(calibration.views, start=1) if v.reason]
    bars = charts.view_bars(calibration, key)
    return Charts(bars, calibration.rms, left_out, charts.radius_chart(calibration))
