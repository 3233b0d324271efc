"""The relative pose of two cameras: in numbers, and as a view from above."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from rcdn.calibration.board_points import flat_points
from rcdn.calibration.stereo_verdict import baseline_std
from rcdn.errors import many, present
from rcdn.geometry import transform, unproject
from rcdn.geometry.rigid import rotation_angle, rotation_vector
from rcdn.report.calibration import charts
from rcdn.report.calibration.formats import coordinate, number, value_and_std
from rcdn.report.calibration.svg import Drawing, dots, each, polyline, segments, tag
from rcdn.types import Array, BoardView, Calibration, StereoCalibration, pose_std


@dataclass(frozen=True)
class RelativePose:
    """(name, value, standard deviation, unit) of each number (`rows`), the matrix as a block of `code`, and a view from
    above."""

    rows: list[tuple[str, str, str, str]]
    code: str
    drawing: Drawing


def turn_angle(stereo: StereoCalibration) -> float:
    """Rotation angle between the left and the right camera, degrees."""
    return rotation_angle(stereo.T_right_left[:3, :3])


def places(stereo: StereoCalibration) -> RelativePose:
    """The relative pose of the two cameras."""
    T, spread = stereo.T_right_left, pose_std(stereo.T_right_left, stereo.cov)
    rows = [("baseline", *value_and_std(1000 * stereo.baseline, 1000 * baseline_std(stereo)), "mm")]
    rows += [(f"t{n}", *value_and_std(1000 * T[k, 3], 1000 * spread[3 + k]), "mm") for k, n in enumerate("xyz")]
    turns = np.degrees(rotation_vector(T[:3, :3]))
    rows += [(f"rotation {n}", *value_and_std(turns[k], np.degrees(spread[k])), "°") for k, n in enumerate("xyz")]
    lines = "".join(f"    [{a:.9g}, {b:.9g},\n     {c:.9g}, {d:.9g}],\n" for a, b, c, d in T)
    return RelativePose(rows, f"T_right_left = [\n{lines}]", _from_above(stereo))


def _from_above(stereo: StereoCalibration) -> Drawing:
    """The cameras and boards seen from above: x to the right, z upwards, with the same scale."""
    T = np.linalg.inv(stereo.T_right_left)
    boards = [_board_line(stereo.left, v) for v in stereo.left.views if not v.reason and v.pose is not None]
    lines = np.array(boards).reshape(-1, 2, 2)
    spots = np.concatenate([lines.reshape(-1, 2), [[0, 0], T[[0, 2], 3]]])
    low, high = spots.min(axis=0), spots.max(axis=0)
    size, height = 400.0, 300.0
    scale = min(size / max(high[0] - low[0], 1e-9), height / max(high[1] - low[1], 1e-9))
    middle = (low + high) / 2
    to = lambda p: (np.asarray(p, float) - middle) * [scale, -scale] + [charts.WIDTH / 2, 170.0]  # noqa: E731
    reach = max(0.35 * (high[1] - low[1]), 0.5 * stereo.baseline)
    cameras = [_wedge(to, np.eye(4), stereo.left, reach, "left"), _wedge(to, T, stereo.right, reach, "right")]
    at = to(lines.reshape(-1, 2)).reshape(-1, 2, 2)
    bar = charts.nice(60 / scale)
    ruler = tag("path", class_="mean", d=f"M1 352v8m0-4H{coordinate(1 + bar * scale)}m0-4v8")
    words = tag("text", f"{coordinate(bar, 6)} m", class_="strong", x=8 + bar * scale, y=360)
    label = f"{many(len(boards), 'board')} and two cameras {number(stereo.baseline)} m apart, from above."
    drawn = tag("path", class_="line", stroke_width=1.6, stroke_opacity=0.75, d=segments(at[:, 0], at[:, 1]))
    return Drawing(charts.plot(label, drawn, *cameras, ruler, words, height=364))


def _board_line(calibration: Calibration, view: BoardView) -> Array:
    """The longer centre line of the board seen from above, (2, 2): (x, z) of its ends, m."""
    low, high = view.ij.min(axis=0), view.ij.max(axis=0)
    middle = (low + high) / 2
    across = high - low
    ends = (
        [[low[0], middle[1]], [high[0], middle[1]]]
        if across[0] >= across[1]
        else [[middle[0], low[1]], [middle[0], high[1]]]
    )
    flat = np.column_stack([flat_points(calibration, view, np.array(ends)), np.zeros(2)])
    return np.asarray(transform(present(view.pose, "the pose of a view"), flat)[:, [0, 2]])


def _wedge(to: Callable[[Array], Array], T: Array, calibration: Calibration, reach: float, name: str) -> Markup:
    """A camera as a dot with the two edges of its horizontal field of view."""
    camera = calibration.camera
    cy = camera.K[1, 2]
    rays = unproject(camera, np.array([[-0.5, cy], [camera.image_size[0] - 0.5, cy]]))
    rays = np.where(np.isfinite(rays), rays, [[-1.0, 0, 0], [1.0, 0, 0]]) @ T[:3, :3].T
    ends = rays[:, [0, 2]] / np.maximum(np.hypot(rays[:, 0], rays[:, 2]), 1e-9)[:, None] * reach
    centre = T[[0, 2], 3]
    c = to(centre)
    edges = polyline(np.array([to(centre + ends[0]), c, to(centre + ends[1])]))
    dot = tag("path", class_="mean", style="stroke-width:7;stroke-linecap:round", d=dots(c[None]))
    anchor, step = ("end", -9) if name == "left" else ("start", 9)
    word = tag("text", name, class_="strong halo", x=float(c[0] + step), y=float(c[1] + 4), text_anchor=anchor)
    return each([tag("path", class_="heatline", stroke_width=1.4, d=edges), dot, word])
