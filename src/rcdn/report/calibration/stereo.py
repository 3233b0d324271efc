"""The report of a pair of cameras."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rcdn.calibration.facts import Facts, measure
from rcdn.calibration.limits import LIMITS, STEREO_LIMITS
from rcdn.calibration.stereo_verdict import baseline_std, judge_stereo
from rcdn.io import write_text
from rcdn.report.calibration import charts, numbers, page, relative, sections, verdict
from rcdn.report.calibration.formats import pixels, value_and_std
from rcdn.report.calibration.gallery import Gallery, gallery
from rcdn.report.calibration.pictures import Pictures
from rcdn.report.calibration.rectified import beside, rectified_pair, row_gaps
from rcdn.report.calibration.svg import Drawing
from rcdn.types import Array, BoardView, StereoCalibration


@dataclass(frozen=True)
class PairFacts:
    """The figures at the head of the page: the `lenses` in words; the baseline with its standard
    deviation, mm; `turn` between the cameras, degrees; `beside`: they are side by side."""

    lenses: list[str]
    pairs: int
    used: int
    pictures: int
    rms: float
    epipolar: float
    baseline: tuple[str, str]
    turn: float
    view_angles: tuple[str, str]
    beside: bool


@dataclass(frozen=True)
class PairRow:
    """A pair of pictures: their RMS and the difference of their rows, px, and why it was left out."""

    names: tuple[str, str]
    values: tuple[float, float, float]
    reason: str


def write_stereo_report(
    path: str | Path,
    stereo: StereoCalibration,
    left_pictures: Pictures | None = None,
    right_pictures: Pictures | None = None,
    title: str = "Stereo calibration",
) -> None:
    """Write the report of a pair of cameras to `path`: as `write_report`, with the pictures of both cameras by the
    names of their views."""
    write_text(path, report(stereo, left_pictures, right_pictures, title))


def report(stereo: StereoCalibration, left: Pictures | None, right: Pictures | None, title: str) -> str:
    """The text of the page that `write_stereo_report` writes."""
    both = ("Left", stereo.left, left, measure(stereo.left)), ("Right", stereo.right, right, measure(stereo.right))
    judged = stereo.verdict if stereo.verdict.judged else judge_stereo(stereo)
    limits = [*STEREO_LIMITS.values(), *LIMITS.values()]
    gaps = row_gaps(stereo)
    payload = {
        "title": title,
        "pair": _facts(stereo, both[0][3]),
        "verdict": verdict.shown(judged, limits, stereo.left.camera.image_size, _advice(stereo), several=True),
        "places": relative.places(stereo),
        "pairs": {"drawing": _bars(stereo, gaps), "rows": _rows(stereo, gaps)},
        "rectified": rectified_pair(stereo, gaps, left, right),
        "lenses": [numbers.lens(c, name[0], f"{name} camera", name.lower() in stereo.given) for name, c, _, _ in both],
        "cameras": [sections.drawings(c, facts, name[0], f", {name.lower()}") for name, c, _, facts in both],
    }

    def galleries(budget: int | None) -> list[Gallery]:
        half = None if budget is None else budget // 2
        return [gallery(c, shown, half, name[0], f"{name} camera") for name, c, shown, _ in both]

    return page.filled("stereo", payload, galleries)


def _facts(stereo: StereoCalibration, left: Facts) -> PairFacts:
    views = stereo.view_pairs
    return PairFacts(
        lenses=[sections.lens_in_words(c.camera) for c in (stereo.left, stereo.right)],
        pairs=len(views),
        used=sum(not a.reason and not b.reason for a, b in views),
        pictures=len({v.name for pair in views for v in pair}),
        rms=stereo.rms,
        epipolar=stereo.epipolar,
        baseline=value_and_std(1000 * stereo.baseline, 1000 * baseline_std(stereo)),
        turn=relative.turn_angle(stereo),
        view_angles=sections.view_angles(left.fov),
        beside=beside(stereo),
    )


def _bars(stereo: StereoCalibration, gaps: Array) -> Drawing:
    """The difference of each pair as a bar."""
    views = stereo.view_pairs
    bars = [
        charts.Bar(
            float(gap), bool(a.reason or b.reason), f"pair {k}: {a.name}, {b.name}, {pixels(gap)}", f"#view-L{k}"
        )
        for k, ((a, b), gap) in enumerate(zip(views, gaps, strict=True), start=1)
    ]
    what = "row" if beside(stereo) else "column"
    return charts.bar_chart(bars, _used_gap(gaps, views), f"{what} difference (RMS), px", "pair")


def _used_gap(gaps: Array, views: list[tuple[BoardView, BoardView]]) -> float:
    used = gaps[[not a.reason and not b.reason for a, b in views]]
    used = used[np.isfinite(used)]
    return float(np.sqrt((used**2).mean())) if len(used) else float("nan")


def _rows(stereo: StereoCalibration, gaps: Array) -> list[PairRow]:
    rows = []
    for (a, b), gap in zip(stereo.view_pairs, gaps, strict=True):
        reason = "; ".join(dict.fromkeys(r for r in (a.reason, b.reason) if r))
        rows.append(PairRow((a.name, b.name), (a.rms, b.rms, float(gap)), reason))
    return rows


def _advice(stereo: StereoCalibration) -> list[str]:
    """The advice for the pair, and the further advice for each camera."""
    of_cameras = (f"{n}: {line}" for n, c in (("Left", stereo.left), ("Right", stereo.right)) for line in c.advice)
    return list(dict.fromkeys([*stereo.advice, *of_cameras]))
