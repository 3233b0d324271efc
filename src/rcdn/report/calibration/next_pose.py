"""The suggested pose of the board for the next picture, drawn over the frame."""

from __future__ import annotations

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.calibration.next_view import NextView, sentence
from rcdn.calibration.residual_facts import used_residuals
from rcdn.calibration.sight import cell_centres, off_axis
from rcdn.geometry import project, transform
from rcdn.report.calibration.charts import MOST_DOTS, thinned
from rcdn.report.calibration.maps import Sensor
from rcdn.report.calibration.svg import Drawing, dots, outline, tag
from rcdn.types import Array, Calibration, Plane

STEPS = 3
"""segments per edge of a square, which lens distortion bends"""
CELLS = (32, 24)


def suggested_pose(calibration: Calibration, found: NextView) -> Drawing:
    """The suggested board as the camera would see it, with the corners seen so far; and an instruction in words."""
    sensor = Sensor(calibration.camera.image_size)
    xy, _ = used_residuals(calibration)
    seen = dots(sensor.to(xy[thinned(len(xy), MOST_DOTS // 2)]))
    dark, light = _squares(calibration, found)
    words = sentence(found, calibration.camera.image_size)
    art = sensor.draw(
        f"The suggested board over the frame. {words}",
        tag("path", class_="dot", stroke_width=2.2, stroke_opacity=0.3, d=seen),
        sensor.clipped(
            tag("path", class_="suggested light", d=_path(sensor, light)),
            tag("path", class_="suggested dark", d=_path(sensor, dark)),
        ),
    )
    marks = (
        ("the board, next", tag("path", class_="suggested dark", d="M1 1h8v6h-8zM9 7h8v6h-8z")),
        ("corners so far", tag("path", class_="dot", stroke_width=5, stroke_opacity=0.5, d="M9 7h0")),
    )
    if not found.worth_saying:
        words = f"Little is left to gain. The best picture would be this: {words[0].lower()}{words[1:]}"
    return Drawing(art, marks, words)


def _squares(calibration: Calibration, found: NextView) -> tuple[list[Array], list[Array]]:
    """Outlines (K, 2), px, of the dark and of the light squares that the camera sees; a deltille's cells are all
    light."""
    cols, rows = found.size
    plane = plane_of(calibration)
    edge = np.linspace(0, 1, STEPS, endpoint=False)
    zero, one = np.zeros(STEPS), np.ones(STEPS)
    around = np.concatenate([
        np.stack(side, axis=-1) for side in ((edge, zero), (one, edge), (1 - edge, one), (zero, 1 - edge))
    ])  # fmt: skip
    starts = np.array([(i, j) for j in range(-1, rows) for i in range(-1, cols)])
    drawn = _seen(calibration, found, starts[:, None] + around, plane)
    whole = np.isfinite(drawn).all(axis=(1, 2))
    odd = (starts.sum(axis=1) % 2 == 0) & (plane.pattern == "checker")
    return list(drawn[whole & odd]), list(drawn[whole & ~odd])


def _seen(calibration: Calibration, found: NextView, ij: Array, plane: Plane) -> Array:
    """Pixels (..., 2) of labels `ij` (..., 2) on the board; NaN at larger angles off the axis than any ray of the
    frame."""
    flat = plane.points(ij) * calibration.spacing
    points = transform(found.pose, np.concatenate([flat, np.zeros((*flat.shape[:-1], 1))], axis=-1))
    camera = calibration.camera
    widest = float(np.nanmax(off_axis(camera, cell_centres(camera.image_size, CELLS)), initial=0.0)) * 1.1
    angle = np.degrees(np.arctan2(np.hypot(points[..., 0], points[..., 1]), points[..., 2]))
    return np.asarray(np.where((angle <= widest)[..., None], project(camera, points), np.nan))


def _path(sensor: Sensor, outlines: list[Array]) -> str:
    return "".join(outline(sensor.to(square)) for square in outlines)
