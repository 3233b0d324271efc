"""Good, fair, or not to be trusted yet: the thresholds, and the reasons in words.

The verdict is the worst of its checks. The thresholds are habits of people who calibrate, not laws: they are all here, and the
report prints them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rcdn.report.calibration.facts import Facts
from rcdn.report.calibration.markup import counted, number, percent, pixels
from rcdn.types import Calibration, StereoCalibration

Level = Literal["good", "fair", "poor"]
LEVELS: tuple[Level, ...] = ("good", "fair", "poor")
HEADLINE = {"good": "Good", "fair": "Fair", "poor": "Don’t trust it yet"}
MEANING = {
    "good": "Use this camera. Nothing in the measurements speaks against it.",
    "fair": "Usable, with care: read the points marked below before you rely on the last tenths of a pixel.",
    "poor": "Something is missing or wrong. Take the points marked below to heart, take more pictures, and calibrate again.",
}
FINE = 0.01
"""px; an RMS below counts as this, for then held-out pictures needn't do as well"""
UNMEASURED = "not measured"
REFERENCE = 1600.0
"""px; limits in pixels grow in proportion for a picture whose longer side is longer than this"""


@dataclass(frozen=True)
class Limit:
    """A value is good up to `good` and fair up to `fair` (`rising`: from there on up)."""

    good: float
    fair: float
    unit: str
    what: str
    rising: bool = False

    def level(self, value: float, factor: float = 1.0) -> Level:
        """How `value` does; limits are multiplied by `factor`. NaN is poor: what can't be measured can't be trusted."""
        if self.rising:
            return "good" if value >= self.good * factor else "fair" if value >= self.fair * factor else "poor"
        return "good" if value <= self.good * factor else "fair" if value <= self.fair * factor else "poor"

    def words(self, level: Level) -> str:
        """`≤ 0.5 px`, as the report prints it."""
        sign, edge = ("≥", "<") if self.rising else ("≤", ">")
        value = self.good if level == "good" else self.fair
        return f"{edge if level == 'poor' else sign} {value * (100 if self.unit == '%' else 1):g} {self.unit}".rstrip()


LIMITS = {
    "views": Limit(10, 5, "", "Boards used", rising=True),
    "rms": Limit(0.5, 1.0, "px", "Reprojection error (RMS)"),
    "held_out": Limit(1.25, 1.75, "× the RMS", "RMS in held-out pictures"),
    "reach": Limit(0.995, 0.97, "%", "Frame that the lens model covers", rising=True),
    "coverage": Limit(0.75, 0.4, "%", "Sensor covered by corners", rising=True),
    "focal": Limit(0.0025, 0.01, "%", "Standard deviation of the focal length"),
    "typical": Limit(0.3, 1.0, "px", "Projection uncertainty, median over the picture"),
    "corners": Limit(1.0, 10.0, "px", "Projection uncertainty in the picture’s corners"),
    "dropped": Limit(0.2, 0.4, "%", "Corners left out"),
}
"""every threshold of one camera's verdict"""
STEREO_LIMITS = {
    "pairs": Limit(10, 5, "", "Pairs used", rising=True),
    "rms": LIMITS["rms"],
    "epipolar": Limit(0.5, 1.0, "px", "Distance from epipolar lines (RMS)"),
    "baseline": Limit(0.0025, 0.01, "%", "Standard deviation of the baseline"),
}
"""and what a pair of cameras must meet besides"""
GROWING = ("rms", "typical", "corners", "epipolar")
"""limits that grow with the picture"""


@dataclass(frozen=True)
class Check:
    """One reason: its level, what was looked at, its value, and a sentence."""

    level: Level
    what: str
    value: str
    why: str


def growth(image_size: tuple[int, int]) -> float:
    """The factor of limits in pixels."""
    return max(1.0, max(image_size) / REFERENCE)


def checks(calibration: Calibration, facts: Facts) -> list[Check]:
    """The reasons, in the order of the report."""
    factor = growth(calibration.camera.image_size)
    ratio = calibration.held_out / max(calibration.rms, FINE) if np.isfinite(calibration.rms) else float("nan")
    found = {
        "views": (len(calibration.used_views), f"{len(calibration.used_views)} of {len(calibration.views)}"),
        "rms": (calibration.rms, pixels(calibration.rms)),
        "held_out": (ratio, pixels(calibration.held_out)),
        "reach": (facts.reach, percent(facts.reach)),
        "coverage": (facts.covered, percent(facts.covered)),
        "focal": (facts.focal_std, percent(facts.focal_std)),
        "typical": (facts.typical, pixels(facts.typical)),
        "corners": (facts.at_corners, pixels(facts.at_corners)),
        "dropped": (facts.dropped, percent(facts.dropped)),
    }
    out = []
    for key, (value, shown) in found.items():
        limit = LIMITS[key]
        level = limit.level(value, factor if key in GROWING else 1.0)
        if key == "held_out" and not np.isfinite(calibration.held_out):
            level, shown = "fair", UNMEASURED
        out.append(Check(level, limit.what, shown, _why(key, level, value, facts)))
    return out


def stereo_checks(
    stereo: StereoCalibration, cameras: Sequence[tuple[str, Calibration, Facts]], share: float
) -> list[Check]:
    """The reasons for a pair of cameras: the pair's own, then each camera's in a line. `share`: standard deviation ÷ baseline."""
    used = sum(not a.reason and not b.reason for a, b in zip(stereo.left.views, stereo.right.views, strict=True))
    factor = growth(stereo.left.camera.image_size)
    found = {
        "pairs": (used, f"{used} of {len(stereo.left.views)}"),
        "rms": (stereo.rms, pixels(stereo.rms)),
        "epipolar": (stereo.epipolar, pixels(stereo.epipolar)),
        "baseline": (share, percent(share)),
    }
    out = []
    for key, (value, shown) in found.items():
        limit = STEREO_LIMITS[key]
        level = limit.level(value, factor if key in GROWING else 1.0)
        out.append(Check(level, limit.what, shown, _why(key, level, value, cameras[0][2])))
    return out + [_camera_check(*camera) for camera in cameras]


def _camera_check(name: str, calibration: Calibration, facts: Facts) -> Check:
    """One camera's checks in a line; what was not measured doesn't count against it here."""
    found = [c for c in checks(calibration, facts) if c.value != UNMEASURED]
    level = verdict(found)
    marked = [
        f"{c.what[0].lower() + c.what[1:] if c.what[1].islower() else c.what}: {c.value}"
        for c in found
        if c.level != "good"
    ]
    why = f"Marked: {'; '.join(marked)}." if marked else f"All its {len(found)} checks are good."
    return Check(level, name, HEADLINE[level], why)


def verdict(found: list[Check]) -> Level:
    """The worst of the checks."""
    return max((c.level for c in found), key=LEVELS.index, default="poor")


def _why(key: str, level: Level, value: float, facts: Facts) -> str:
    if key == "held_out" and not np.isfinite(value):
        return "Too few pictures to hold some back, so nothing shows how it does in new ones."
    if not np.isfinite(value):
        return (
            "The lens model has no ray there."
            if key == "corners"
            else "It can’t be measured: the pictures don’t settle it."
        )
    empty = int((facts.in_view & (facts.coverage == 0)).sum())
    return _SENTENCES[key][LEVELS.index(level)].format(
        ratio=number(value, 3), empty=counted(empty, "cell") if empty else "no cell", cells=int(facts.in_view.sum())
    )


_SENTENCES = {
    "pairs": (
        "Enough pairs for chance to average out.",
        "It works, but a few more pairs would make it firmer.",
        "Too few: one bad pair can bend the whole result.",
    ),
    "epipolar": (
        "Matching points lie on one row of the rectified pictures.",
        "Somewhat high: were the cameras triggered together, with the board held still?",
        "High: the cameras moved against each other, or weren’t triggered together.",
    ),
    "baseline": (
        "The pairs settle how far the cameras stand apart.",
        "The baseline is loose: add pairs with the board near and tilted.",
        "The baseline is hardly settled: add pairs with the board near and tilted.",
    ),
    "views": (
        "Enough boards for chance to average out.",
        "It works, but a few more pictures would make it firmer.",
        "Too few: one bad picture can bend the whole result.",
    ),
    "rms": (
        "The camera explains the corners about as well as they can be found.",
        "Somewhat high: blur, a bent board, or a lens that the model doesn’t quite follow.",
        "High: wrong corners, a bent board, or a lens model that doesn’t fit.",
    ),
    "held_out": (
        "{ratio} × the RMS: it does as well in pictures that it never saw.",
        "{ratio} × the RMS: it does worse in pictures that it never saw; more pictures would help.",
        "{ratio} × the RMS: it fits its own pictures only. Take more, with more variety.",
    ),
    "reach": (
        "Every pixel that the lens can fill has a ray.",
        "In a small part of the frame the lens model folds back: there it can’t be used.",
        "The lens model folds back inside the frame: pixels beyond have no ray. Choose another model (fisheye for a wide lens), or bring the board "
        "out to the edges.",
    ),
    "coverage": (
        "Corners were seen nearly everywhere ({empty} of {cells} without).",
        "{empty} of {cells} have no corner: there the lens is guessed from its neighbours.",
        "{empty} of {cells} have no corner: much of the lens was never measured.",
    ),
    "focal": (
        "The pictures settle the focal length.",
        "The focal length is loose: tilt the board more, and bring it nearer.",
        "The focal length is hardly settled: tilt the board by 30–45°, in several directions.",
    ),
    "typical": (
        "In most of the picture a ray is known that well.",
        "Rays are loose in much of the picture: add pictures, with more variety.",
        "Rays are loose in most of the picture: add pictures, with more variety.",
    ),
    "corners": (
        "The projection is firm out to the picture’s corners.",
        "The picture’s corners are loose: bring the board into them.",
        "The picture’s corners are guesswork: bring the board into them.",
    ),
    "dropped": (
        "Nearly all that was seen agrees.",
        "A good part disagreed; look at the pictures left out.",
        "Much of what was seen disagreed; look at the pictures left out before you trust the rest.",
    ),
}
