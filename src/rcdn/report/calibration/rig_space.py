"""A rig in space: the cameras' poses with the uncertainty of their positions, and the boards, in the frame of the first
camera."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from rcdn.errors import present
from rcdn.geometry import transform
from rcdn.report.calibration.charts import nice, plot, thinned
from rcdn.report.calibration.formats import counted, number
from rcdn.report.calibration.space import (
    BELOW,
    HEIGHT,
    PYRAMID,
    Projection,
    board_rim,
    fitted_projection,
    frustum,
    polygon,
    pyramid,
    scale_bar,
)
from rcdn.report.calibration.svg import Drawing, each, tag
from rcdn.types import Array, Pose, Rig, RigCalibration

SIGMAS = 3.0
"""semi-axes of an ellipsoid, in standard deviations"""
SEEN = 0.05
"""smallest drawn semi-axis of the largest ellipsoid, relative to the rig's size: smaller ellipsoids are enlarged by a
round factor, which the caption states"""
LENGTH = 0.25
"""length of the frusta, relative to the larger of the median distances of the boards and of neighbouring cameras"""
BOARDS = 150
"""largest number of boards drawn, evenly selected"""
AROUND = 24
"""points of an ellipse"""


def rig_in_space(found: RigCalibration, weakest: str = "") -> Drawing:
    """The drawing; the frustum of the `weakest` camera is highlighted."""
    rig = found.rig
    boards, every = _boards(found)
    length = _length(rig, boards)
    rims = {name: _in_rig(rig, name, frustum(rig.cameras[k], length)) for k, name in enumerate(rig.names)}
    centres = np.array([rig.centre(name) for name in rig.names])
    projection = fitted_projection(np.concatenate([centres, *rims.values(), *boards]))
    factor, ellipsoids = _ellipsoids(rig, float(np.ptp(centres, axis=0).max()))
    drawn = [polygon(projection, corners, "board faint") for corners in boards]
    for k, name in enumerate(rig.names):
        drawn.append(
            tag(
                "g",
                tag("title", _tooltip(rig, name)),
                pyramid(projection, rims[name], centres[k], _kind(name, weakest)),
            )
        )
        drawn += [polygon(projection, ring, "unsure") for ring in ellipsoids.get(name, [])]
    drawn += [_name(projection, name, centres[k]) for k, name in enumerate(rig.names)]
    sentence = _sentence(factor, len(boards), every)
    art = plot(
        f"{counted(len(rig), 'camera')} and {counted(len(boards), 'board')} in space. {sentence}",
        each(drawn),
        scale_bar(projection),
        height=HEIGHT + BELOW,
        projection=projection.numbers,
    )
    return Drawing(art, _marks(bool(ellipsoids), weakest), sentence, turns=True)


def _kind(name: str, weakest: str) -> str:
    return "ray weak" if name == weakest else "ray"


def _boards(found: RigCalibration) -> tuple[list[Array], int]:
    """The outlines (4, 3) of boards, m, in the rig's frame, each from the view with the most corners; and the total
    number of boards."""
    largest: dict[bytes, tuple[int, Array]] = {}
    for name in found.rig.names:
        back = np.linalg.inv(found.rig.T_cam_rig[found.rig.index(name)])
        for view in found.cameras[name].used_views:
            if view.pose is None:
                continue
            where = back @ view.pose.T_cam_board
            key = np.round(where, 6).tobytes()
            if key not in largest or len(view) > largest[key][0]:
                largest[key] = len(view), transform(Pose(back), board_rim(found.cameras[name], view))
    every = [corners for _, corners in largest.values()]
    return [every[k] for k in thinned(len(every), BOARDS)], len(every)


def _in_rig(rig: Rig, name: str, points: Array) -> Array:
    """Points (N, 3), given in a camera's coordinates, in the rig's frame."""
    return transform(Pose(np.linalg.inv(rig.T_cam_rig[rig.index(name)])), points)


def _length(rig: Rig, boards: list[Array]) -> float:
    """The length of the frusta, m."""
    centres = np.array([rig.centre(name) for name in rig.names])
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2) + np.diag(np.full(len(rig), np.inf))
    near = float(np.median(apart.min(axis=1)))
    if not boards:
        return near / 2
    middle = np.array([corners.mean(axis=0) for corners in boards])
    away = np.linalg.norm(middle[:, None] - centres[None], axis=2).min(axis=1)
    return LENGTH * max(float(np.median(away)), near)


def _ellipsoids(rig: Rig, size: float) -> tuple[float, dict[str, list[Array]]]:
    """The factor by which ellipsoids of SIGMAS standard deviations are enlarged, and for each camera but the first the
    three ellipses (AROUND, 3) in the principal planes of its ellipsoid."""
    if rig.covariance is None:
        return 1.0, {}
    axes = {}
    for name in rig.names[1:]:
        values, vectors = np.linalg.eigh(present(rig.centre_covariance(name), "covariance"))
        axes[name] = SIGMAS * np.sqrt(np.maximum(values, 0)) * vectors
    largest = max(float(np.linalg.norm(a, axis=0).max()) for a in axes.values()) if axes else 0.0
    if not largest > 0:
        return 1.0, {}
    wanted = SEEN * max(size, 1e-9) / largest
    factor = nice(wanted) if wanted > 1 else 1.0
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return factor, {
        name: [rig.centre(name) + factor * (a[:, list(pair)] @ circle).T for pair in ((0, 1), (0, 2), (1, 2))]
        for name, a in axes.items()
    }


def _tooltip(rig: Rig, name: str) -> str:
    place = ", ".join(number(v, 4) for v in rig.centre(name))
    cov = rig.centre_covariance(name)
    spread = "" if cov is None or name == rig.names[0] else f", ± {number(1000 * float(np.sqrt(np.trace(cov))), 2)} mm"
    return f"{name}: at ({place}) m{spread}"


def _name(projection: Projection, name: str, centre: Array) -> Markup:
    x, y = projection.to(centre)[0]
    numbers = " ".join(f"{v:.4g}" for v in centre)
    return tag("text", name, class_="strong halo", x=float(x), y=float(y), dx=6, dy=-6, data_p=numbers)


def _sentence(factor: float, shown: int, every: int) -> str:
    size = f"{SIGMAS:g} standard deviations of a camera’s centre in the frame of the first one"
    larger = f", drawn {factor:g} times larger than the rest" if factor > 1 else ", true to scale"
    some = f" {shown} of {every:,} boards are drawn." if shown < every else ""
    return f"Ellipsoids: {size}{larger}.{some}"


def _marks(unsure: bool, weakest: str) -> tuple[tuple[str, Markup], ...]:
    marks = [("a camera and the rim of its frame", tag("path", class_="ray", d=PYRAMID))]
    if weakest:
        marks.append((f"{weakest}, known least", tag("path", class_="ray weak", d=PYRAMID)))
    if unsure:
        marks.append(("where it may stand", tag("path", class_="unsure", d="M2 7a7 4 0 1 0 14 0a7 4 0 1 0-14 0")))
    marks.append(("a board", tag("path", class_="board faint", d="M2 3l12-1 2 9-13 1z")))
    return tuple(marks)
