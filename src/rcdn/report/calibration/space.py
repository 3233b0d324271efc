"""All boards in front of the camera, in space: an orthographic drawing that a script can rotate; without it, it is
static."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from rcdn.calibration.board_points import plane_of, side_of
from rcdn.calibration.view_facts import tilts
from rcdn.errors import present
from rcdn.geometry import transform, unproject
from rcdn.report.calibration.charts import WIDTH, nice, plot
from rcdn.report.calibration.formats import coordinate, counted, number, pixels, short
from rcdn.report.calibration.svg import Drawing, each, tag
from rcdn.types import Array, BoardView, Calibration, Camera, Plane, Pose

HEIGHT, MARGIN, BELOW = 330.0, 14.0, 26.0
"""height of the drawing, its margin, and the space for the scale bar below it, units"""
YAW, PITCH = 55.0, 20.0
"""initial rotation about the vertical and elevation of the viewpoint, degrees"""
FRUSTUM = 0.45
"""length of the frustum's edges, relative to the median distance of the boards"""
RIM = 8
"""points along each side of the frustum's base"""
PYRAMID = "M1 7L13 1L16 10L10 13zM1 7L16 10M1 7L10 13"
"""a camera, in a legend"""
FAR_OUT = 1.5
"""multiple of the distance of the farthest used board beyond which boards left out aren't drawn"""


@dataclass(frozen=True, eq=False)
class Projection:
    """An orthographic projection of camera coordinates (x right, y down, z forward): rotated by `yaw` about y, then by
    `pitch` about the screen's x, degrees; `centre` (3,), m, is projected to the drawing's centre; `scale` in units per
    metre."""

    centre: Array
    scale: float
    yaw: float = YAW
    pitch: float = PITCH

    def to(self, points: Array) -> Array:
        """Positions (N, 2) in the drawing, units, of points (N, 3) in camera coordinates, m."""
        a, b = np.radians([self.yaw, self.pitch])
        x, y, z = (np.atleast_2d(points) - self.centre).T
        across, ahead = np.cos(a) * x + np.sin(a) * z, np.cos(a) * z - np.sin(a) * x
        down = np.cos(b) * y - np.sin(b) * ahead
        return np.stack([across, down], axis=-1) * self.scale + [WIDTH / 2, HEIGHT / 2]

    @property
    def numbers(self) -> str:
        """What the page's script needs to rotate the drawing."""
        return " ".join(digits(v) for v in (*self.centre, self.scale, self.yaw, self.pitch))


def boards_in_space(calibration: Calibration, suggested: Array | None = None) -> Drawing | None:
    """The drawing; None if no used board has a pose. Boards link to their pictures; `suggested` (4, 3), m, camera
    coordinates, is the outline of a further board."""
    placed = [(k, v, board_rim(calibration, v)) for k, v in enumerate(calibration.views, start=1) if v.pose]
    used = [corners for _, v, corners in placed if not v.reason]
    if not used:
        return None
    far = FAR_OUT * max(float(np.linalg.norm(c, axis=1).max()) for c in used)
    shown = [p for p in placed if not p[1].reason or np.linalg.norm(p[2], axis=1).max() <= far]
    distance = np.array([np.linalg.norm(c.mean(axis=0)) for c in used])
    rim = frustum(calibration.camera, FRUSTUM * float(np.median(distance)))
    projection = fitted_projection(
        np.concatenate([*(c for _, _, c in shown), *([] if suggested is None else [suggested]), rim, np.zeros((1, 3))])
    )
    angle = tilts(calibration)
    sentence = (
        f"The used boards’ middles stood {_between(distance)} m away, "
        f"tilted by {angle.min():.0f}° to {angle.max():.0f}° against the sensor."
    )
    art = plot(
        f"Poses of {counted(len(shown), 'board')} before the camera, from the side. {sentence}",
        each([*(_board(projection, *p) for p in shown), pyramid(projection, rim)]),
        None if suggested is None else polygon(projection, suggested, "board next"),
        scale_bar(projection),
        height=HEIGHT + BELOW,
        projection=projection.numbers,
    )
    if left := len(placed) - len(shown):
        are = "is" if left == 1 else "are"
        sentence += f" {counted(left, 'board')} left out would stand far beyond, and {are} not drawn."
    return Drawing(art, _marks(shown, suggested is not None), sentence, turns=True)


def board_rim(calibration: Calibration, view: BoardView) -> Array:
    """The outer corners (4, 3) of a view's board, m, camera coordinates: one square beyond its outermost visible
    corners."""
    plane, side = plane_of(calibration, view), side_of(calibration, view)
    pose = present(view.pose, "the pose of a view")
    return rectangle(pose, view.ij.min(axis=0) - 1, view.ij.max(axis=0) + 1, side, plane)


def rectangle(pose: Pose, low: Array, high: Array, spacing: float, plane: Plane) -> Array:
    """The corners (4, 3), m, camera coordinates, of the rectangle on a board with labels from `low` (2,) to `high`
    (2,), in cyclic order."""
    ij = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    flat = plane.points(ij) * spacing
    return transform(pose, np.column_stack([flat, np.zeros(4)]))


def frustum(camera: Camera, length: float) -> Array:
    """Points (4·RIM, 3), m, at distance `length` along the rays of the frame's rim, in cyclic order from its first
    corner; where the lens model has no ray, along the outermost ray towards the principal point."""
    width, height = camera.image_size
    ends = np.array([[-0.5, -0.5], [width - 0.5, -0.5], [width - 0.5, height - 0.5], [-0.5, height - 0.5]])
    share = np.arange(RIM)[:, None] / RIM
    rim = np.concatenate([a + share * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)])
    out = np.full((len(rim), 3), np.nan)
    for inwards in np.linspace(1, 0.1, 46):
        lost = np.isnan(out).any(axis=1)
        out[lost] = unproject(camera, camera.K[:2, 2] + inwards * (rim[lost] - camera.K[:2, 2]))
    out = np.where(np.isfinite(out), out, [0.0, 0.0, 1.0])
    return np.asarray(length * out / np.linalg.norm(out, axis=1, keepdims=True))


def fitted_projection(points: Array) -> Projection:
    """The projection in which `points` (N, 3) fit into the drawing for any rotation about the vertical."""
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    away = points - centre
    across, down = (
        np.hypot(away[:, 0], away[:, 2]).max(),
        np.abs(Projection(centre, 1.0).to(points)[:, 1] - HEIGHT / 2).max(),
    )
    room = np.array([WIDTH, HEIGHT]) / 2 - MARGIN
    return Projection(centre, float(min(room / np.maximum([across, down], 1e-9))))


def _board(projection: Projection, index: int, view: BoardView, corners: Array) -> Markup:
    state = f"left out: {view.reason}" if view.reason else pixels(view.rms)
    tooltip = f"view {index}: {short(view.name)}, {_distance(corners)} m away, {state}"
    kind = "board out" if view.reason else "board"
    return tag("a", tag("title", tooltip), polygon(projection, corners, kind), href=f"#view-{index}", tabindex="-1")


def _distance(corners: Array) -> str:
    return number(float(np.linalg.norm(corners.mean(axis=0))), 2)


def pyramid(projection: Projection, rim: Array, apex: Array | None = None, kind: str = "ray") -> Markup:
    """A camera at `apex` (3,) m (None: the origin) with the `rim` of its frustum, and edges to the frame's corners."""
    top = np.zeros(3) if apex is None else apex
    edges = [polygon(projection, np.stack([top, rim[k]]), kind, "polyline") for k in range(0, len(rim), RIM)]
    return each([polygon(projection, rim, kind), *edges])


def polygon(projection: Projection, points: Array, kind: str, shape: str = "polygon") -> Markup:
    """A shape through `points` (N, 3), with their coordinates for the script."""
    drawn = " ".join(f"{coordinate(x)},{coordinate(y)}" for x, y in projection.to(points))
    return tag(shape, class_=kind, points=drawn, data_p=" ".join(digits(v) for v in points.ravel()))


def digits(value: float) -> str:
    return f"{value:.4g}"


def scale_bar(projection: Projection) -> Markup:
    """A scale bar of a round length; in an orthographic projection it is valid for any rotation of the boards."""
    length = nice(60 / projection.scale)
    length = length if length * projection.scale < WIDTH / 3 else nice(25 / projection.scale)
    y, right = HEIGHT + 12, MARGIN + length * projection.scale
    bar = tag("path", class_="mean", d=f"M{coordinate(MARGIN)} {coordinate(y - 4)}v8m0-4H{coordinate(right)}m0-4v8")
    return each([bar, tag("text", f"{coordinate(length, 4)} m", class_="strong", x=right + 7, y=y + 4)])


def _marks(shown: list[tuple[int, BoardView, Array]], suggested: bool) -> tuple[tuple[str, Markup], ...]:
    box = "M2 3l12-1 2 9-13 1z"
    marks = [("used board", tag("path", class_="board", d=box))]
    if any(v.reason for _, v, _ in shown):
        marks.append(("left out", tag("path", class_="board out", d=box)))
    if suggested:
        marks.append(("suggested next", tag("path", class_="board next", d=box)))
    marks.append(("the camera and the rim of its frame", tag("path", class_="ray", d=PYRAMID)))
    return tuple(marks)


def _between(values: Array) -> str:
    low, high = (number(float(v), 2) for v in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"
