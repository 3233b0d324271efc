"""The report of a rig of many cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.calibration.facts import measure
from rcdn.calibration.limits import LIMITS, RIG_LIMITS, growth
from rcdn.calibration.rig_facts import judged_rig, least_known
from rcdn.geometry.rigid import rotation_angle
from rcdn.io import write_text
from rcdn.report.calibration import numbers, page, sections, verdict
from rcdn.report.calibration.environment import render
from rcdn.report.calibration.formats import DASH, bare_pixels, number, value_and_std
from rcdn.report.calibration.gallery import Gallery, gallery
from rcdn.report.calibration.pictures import Pictures
from rcdn.report.calibration.rig_space import rig_in_space
from rcdn.types import Array, RigCalibration, RigPair, pose_std

OVERLAYS = 2_000_000
"""maximum size of the drawings of all views, bytes; above it they are left out with a note"""
HIGH = 1.5
"""multiple of the overall RMS above which a pair's RMS is highlighted"""


@dataclass(frozen=True)
class RigNumbers:
    """The figures at the head of the page: each kind of lens in words; numbers of cameras, boards
    and views; the epipolar distances of the pairs, px; the camera that is known least, and how far, mm."""

    lenses: list[str]
    cameras: int
    connected: int
    boards: int
    views: int
    given: int
    rms: float
    worst_gap: float
    median_gap: float
    weakest: str
    weakest_std: str


@dataclass(frozen=True)
class Row:
    """A row of a table: a name, perhaps with a `mark`, and numbers."""

    name: str
    cells: tuple[str, ...]
    mark: str = ""


def write_rig_report(
    path: str | Path,
    found: RigCalibration,
    shown: Mapping[str, Pictures] | None = None,
    title: str = "Calibration of a rig",
) -> None:
    """Write the report of a rig to `path`: as `write_report`; `shown`: the pictures of each camera, by its name."""
    write_text(path, report(found, shown, title))


def report(
    found: RigCalibration, shown: Mapping[str, Pictures] | None = None, title: str = "Calibration of a rig"
) -> str:
    """The text of the page that `write_rig_report` writes."""
    judged = (found if found.verdict.judged else judged_rig(found)).verdict
    weakest, partner = least_known(found) or ("", "")
    largest = max((c.image_size for c in found.rig.cameras), key=growth)
    cameras = [(name, found.cameras[name], f"{k}-") for k, name in enumerate(found.rig.names)]
    payload = {
        "title": title,
        "rig": _numbers(found, weakest),
        "verdict": verdict.shown(judged, [*RIG_LIMITS.values(), *LIMITS.values()], largest, several=True),
        "places": _places(found, weakest, partner),
        "pairs": _pairs(found),
        "boards": _boards(found),
        "lenses": [numbers.lens(c, f"-{k}", name, name in found.given) for k, (name, c, _) in enumerate(cameras)],
        "cameras": [sections.drawings(c, measure(c), key, f", {name}", with_charts=False) for name, c, key in cameras],
    }

    def galleries(budget: int | None) -> list[Gallery]:
        share = None if budget is None else budget // len(cameras)
        return [gallery(c, (shown or {}).get(name), share, key, name) for name, c, key in cameras]

    drawn = len(render("views", galleries=galleries(None)).encode()) <= OVERLAYS
    return page.filled("rig", payload, lambda budget: galleries(budget) if drawn and (budget or 0) >= 0 else [])


def _numbers(found: RigCalibration, weakest: str) -> RigNumbers:
    gaps = [p.epipolar for p in found.pairs if np.isfinite(p.epipolar)] or [float("nan")]
    return RigNumbers(
        lenses=list(dict.fromkeys(sections.lens_in_words(c) for c in found.rig.cameras)),
        cameras=len(found.cameras),
        connected=len(found.rig),
        boards=len(found.boards),
        views=sum(len(found.cameras[name].views) for name in found.rig.names),
        given=len(found.given),
        rms=found.rms,
        worst_gap=max(gaps),
        median_gap=float(np.median(gaps)),
        weakest=weakest,
        weakest_std=_millimetres(found, weakest) if weakest else "",
    )


def _millimetres(found: RigCalibration, name: str) -> str:
    """How far the centre of a camera is known."""
    cov = found.rig.centre_covariance(name)
    return DASH if cov is None else number(1000 * float(np.sqrt(np.trace(cov))), 2)


def _places(found: RigCalibration, weakest: str, partner: str) -> dict[str, Any]:
    """The drawing, a row for each camera, the cameras that stand `apart`, and the `partner` of the weakest one."""
    rig = found.rig
    rows = [Row(rig.names[0], ("0", "0", "0", DASH, DASH), "least" if rig.names[0] == weakest else "")]
    for k, name in enumerate(rig.names[1:], start=1):
        place = rig.centre_covariance(name)
        spread = np.full(3, np.nan) if place is None else 1000 * np.sqrt(np.diag(place))
        xyz = (value_and_std(v, s)[0] for v, s in zip(1000 * rig.centre(name), spread, strict=True))
        turn = DASH if rig.covariance is None else _degrees(rig.covariance[6 * k : 6 * k + 3, 6 * k : 6 * k + 3])
        rows.append(Row(name, (*xyz, _millimetres(found, name), turn), "least" if name == weakest else ""))
    apart = [name for name in found.cameras if name not in rig.names]
    return {
        "drawing": rig_in_space(found, weakest), "rows": rows, "first": rig.names[0], "apart": apart, "partner": partner
    }  # fmt: skip


def _degrees(cov: Array) -> str:
    """How far a rotation with covariance `cov` (3, 3), rad², is known."""
    return number(float(np.degrees(np.sqrt(np.trace(cov)))), 2)


def _pairs(found: RigCalibration) -> dict[str, Any]:
    """A row for each pair of cameras that share boards, the worst first, and the number of all pairs."""
    order = sorted(found.pairs, key=lambda p: -p.epipolar if np.isfinite(p.epipolar) else 0)
    rows = [
        Row(f"{p.first} – {p.second}", _pair_cells(found, p), "high" if p.rms > HIGH * found.rms else "") for p in order
    ]
    return {"rows": rows, "every": len(found.rig) * (len(found.rig) - 1) // 2}


def _pair_cells(found: RigCalibration, p: RigPair) -> tuple[str, ...]:
    known = str(p.shared), str(p.used), bare_pixels(p.rms), bare_pixels(p.epipolar)
    if not {p.first, p.second} <= set(found.rig.names):
        return (*known, DASH, DASH)
    T, cov = found.rig.relative(p.first, p.second)
    far = float(np.linalg.norm(T[:3, 3]))
    along = T[:3, 3] / max(far, 1e-12)
    # a small rotation of the second camera changes t by ω × t, which doesn't change its length
    spread = float("nan") if cov is None else float(np.sqrt(max(float(along @ cov[3:, 3:] @ along), 0.0)))
    return (*known, *value_and_std(1000 * far, 1000 * spread))


def _boards(found: RigCalibration) -> list[Row]:
    """The places of boards that are fixed to each other."""
    rows, names = [], {b.target: b.name for b in found.fixed_boards}
    for board in found.fixed_boards:
        if board.target == board.first:
            rows.append(Row(board.name, (DASH,) * 6, "first"))
            continue
        spread = 1000 * pose_std(board.T_first_board, board.cov)[3:]
        place = (value_and_std(v, s)[0] for v, s in zip(1000 * board.T_first_board[:3, 3], spread, strict=True))
        turn = rotation_angle(board.T_first_board[:3, :3])
        sure = float(np.degrees(np.sqrt(np.trace(board.cov[:3, :3]))))
        cells = (*place, number(float(np.sqrt((spread**2).sum())), 2), *value_and_std(turn, sure))
        rows.append(Row(f"{board.name}, to {names[board.first]}", cells))
    return rows
