"""Simulated sets of pictures with a known fault, from known cameras and exact poses, from which no good camera can be
calibrated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rcdn.geometry import project, rotation
from rcdn.types import Array, Board, Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, labels, random_boards, random_pose
from rcdn_lab.real_boards import curved_board

NOISE = 0.1
"""px, standard deviation of a corner along one axis"""
VIEWS = 20
BROWN = CAMERAS["brown"]
Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class CaseInput:
    """Input of `calibrate`: `boards`, the names of their pictures, and options that differ from the defaults."""

    boards: list[Board]
    names: list[str]
    options: dict[str, Any] = field(default_factory=dict)
    spacing: float = SPACING


@dataclass(frozen=True)
class BadCase:
    """A fault in words, the function `make` that simulates it, and the `keys` of reasons, one of which must come first
    in the verdict."""

    name: str
    make: Callable[[Rng], CaseInput]
    keys: tuple[str, ...]


FLAT = np.column_stack([labels() * SPACING, np.zeros(SIZE[0] * SIZE[1])])
"""(N, 3) m: the corners of a perfect board"""
OBLONG = FLAT * [0.04, 0, 0]
"""(N, 3) m: displacements of the corners of a board whose x is printed 4 % too long"""


def view(
    camera: Camera, T: Array, rng: Rng, noise: float = NOISE, offsets: Array | None = None, least: float = 0.6
) -> Board | None:
    """The board under `T` (4, 4) as seen by `camera`, with noise; None if less than the share `least` is in the
    picture.

    `offsets` (N, 3) m, displacements of the corners, as in `camera_scenes.see`.
    """
    points = FLAT if offsets is None else FLAT + offsets
    return _board(camera, labels(), project(camera, points @ T[:3, :3].T + T[:3, 3]), rng, noise, least)


def _board(camera: Camera, ij: Array, xy: Array, rng: Rng, noise: float = NOISE, least: float = 0.6) -> Board | None:
    inside = (xy > 1).all(axis=1) & (xy < np.array(camera.image_size) - 2).all(axis=1)
    if inside.mean() < least:
        return None
    ij, xy = ij[inside], xy[inside]
    xy = xy + rng.normal(0, noise, xy.shape)
    return board(ij - ij.min(axis=0), xy, camera.image_size, np.full(len(xy), noise))


def views(make: Callable[[Array], Board | None], rng: Rng, many: int = VIEWS, **pose: Any) -> list[Board]:
    """`many` boards that `make` returns under random poses."""
    found: list[Board] = []
    while len(found) < many:
        seen = make(random_pose(rng, **pose))
        if seen is not None:
            found.append(seen)
    return found


def plain(camera: Camera, rng: Rng, many: int = VIEWS, **pose: Any) -> list[Board]:
    """Boards without a fault."""
    return views(lambda T: view(camera, T, rng), rng, many, **pose)


def _as(boards: list[Board], prefix: str = "img", **options: Any) -> CaseInput:
    return CaseInput(boards, [f"{prefix}{k:02d}.png" for k in range(len(boards))], options)


def _groups(*cameras: Camera) -> Callable[[Rng], CaseInput]:
    """Pictures of several cameras, one camera after the other."""

    def make(rng: Rng) -> CaseInput:
        return _as([b for c in cameras for b in plain(c, rng, VIEWS // len(cameras))])

    return make


def zoomed(camera: Camera, factor: float) -> Camera:
    """`camera` with another focal length."""
    p = camera.parameters.copy()
    p[:2] *= factor
    return camera.with_parameters(p)


OTHER = Camera(
    np.array([[555.0, 0, 309], [0, 553, 251], [0, 0, 1]]), np.array([-0.18, 0.03, -0.001, 0.001, 0.0]), (640, 480)
)
"""another camera with another lens"""


def _paper(rng: Rng) -> CaseInput:
    return _as(views(lambda T: view(BROWN, T, rng, offsets=curved_board(rng.normal(0, 0.005, 2))), rng))


def _bent_board(rng: Rng) -> CaseInput:
    return _as(views(lambda T: view(BROWN, T, rng, offsets=curved_board((0.009, -0.006))), rng))


def _frontal(many: int) -> Callable[[Rng], CaseInput]:
    return lambda rng: _as(plain(BROWN, rng, many, tilt=0.03))


def _one_tilt(rng: Rng) -> CaseInput:
    R = rotation(np.array([0.6, 0.0, 0.0]))

    def seen(T: Array) -> Board | None:
        alike = T.copy()
        centre = T[:3, :3] @ [*(np.array(SIZE) - 1) * SPACING / 2, 0] + T[:3, 3]
        alike[:3, :3], alike[:3, 3] = R, centre - R @ [*(np.array(SIZE) - 1) * SPACING / 2, 0]
        return view(BROWN, alike, rng)

    return _as(views(seen, rng))


def _within(low: tuple[float, float], high: tuple[float, float]) -> Callable[[Rng], CaseInput]:
    """All boards far away and inside one part of the sensor; `low` and `high`: shares of its sides."""

    def make(rng: Rng) -> CaseInput:
        size = np.array(BROWN.image_size)

        def seen(T: Array) -> Board | None:
            found = view(BROWN, T, rng, least=1.0)
            ok = found is not None and (found.xy >= size * low).all() and (found.xy <= size * high).all()
            return found if ok else None

        return _as(views(seen, rng, spread=0.7, distance=(1.0, 1.6)))

    return make


def _duplicates(shake: float) -> Callable[[Rng], CaseInput]:
    """Four poses of the board, each in five pictures that differ by rotations of standard deviation `shake` rad and by
    noise."""

    def make(rng: Rng) -> CaseInput:
        found: list[Board | None] = []
        for T in _usable_poses(rng, 4):
            turns = [rotation(rng.normal(0, shake, 3)) for _ in range(5)]
            found += [view(BROWN, _turned(T, R), rng) for R in turns]
        return _as([b for b in found if b is not None])

    return make


def _turned(T: Array, R: Array) -> Array:
    """`T` (4, 4) with the camera rotated by `R` (3, 3)."""
    M = np.eye(4)
    M[:3, :3] = R
    return np.asarray(M @ T)


def _usable_poses(rng: Rng, many: int) -> list[Array]:
    """Poses under which the whole board is in the picture."""
    out: list[Array] = []
    while len(out) < many:
        T = random_pose(rng)
        if view(BROWN, T, rng, least=1.0) is not None:
            out.append(T)
    return out


def _wrong_labels(rng: Rng) -> CaseInput:
    """In five views a column is skipped: labels beyond it are one too high."""
    boards = plain(BROWN, rng)
    for k in range(0, VIEWS, 4):
        b = boards[k]
        ij = b.ij.copy()
        ij[ij[:, 0] >= 4, 0] += 1
        boards[k] = replace(b, ij=ij)
    return _as(boards)


def circle_centres(rng: Rng) -> CaseInput:
    """Centroids of discs, as measured on a circle grid: the centroid of a projected disc is nearly, but not exactly,
    its projected centre."""
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]) * 0.45 * SPACING

    def seen(T: Array) -> Board | None:
        ij = labels()
        rims = FLAT[:, None] + ring
        xy = project(BROWN, rims.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]).reshape(len(ij), -1, 2)
        return _board(BROWN, ij, centroids(xy), rng)

    return _as(views(seen, rng, distance=(0.2, 0.35)))


def centroids(outline: Array) -> Array:
    """(N, 2) centroids of the areas of polygons (N, K, 2)."""
    base = outline[:, :1]
    a = outline - base
    b = np.roll(a, -1, axis=1)
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.asarray(base[:, 0] + ((a + b) * cross[..., None]).sum(axis=1) / (3 * cross.sum(axis=1))[:, None])


def _oblong(rng: Rng) -> CaseInput:
    return _as(views(lambda T: view(BROWN, T, rng, offsets=OBLONG), rng))


def _rolling_shutter(rng: Rng) -> CaseInput:
    """The board moves while the rows are read: up to 3 cm and 4° within a picture."""

    def seen(T: Array) -> Board | None:
        ij, speed, turn = labels(), rng.normal(0, 0.015, 3), rng.normal(0, 0.03, 3)
        points = FLAT @ T[:3, :3].T
        xy = project(BROWN, points + T[:3, 3])
        for _ in range(4):
            time = np.clip(xy[:, 1] / BROWN.image_size[1], -0.5, 1.5) - 0.5
            moved = points + time[:, None] * (speed + np.cross(turn, points))
            xy = project(BROWN, moved + T[:3, 3])
        return _board(BROWN, ij, xy, rng)

    return _as(views(seen, rng))


def _ripples(rng: Rng) -> CaseInput:
    """A lens with periodic distortion over the sensor, up to half a pixel."""

    def seen(T: Array) -> Board | None:
        ij = labels()
        xy = project(BROWN, FLAT @ T[:3, :3].T + T[:3, 3])
        return _board(BROWN, ij, xy + 0.7 * np.sin(xy[:, ::-1] / [22.0, 27.0]), rng)

    return _as(views(seen, rng))


def _pinhole_for_fisheye(rng: Rng) -> CaseInput:
    return _as(plain(CAMERAS["fisheye"], rng, spread=1.0, distance=(0.2, 0.5)), model="pinhole")


def _other_size(every: int) -> Callable[[Rng], CaseInput]:
    """Every `every`-th picture has twice the width and height."""

    def make(rng: Rng) -> CaseInput:
        boards = plain(BROWN, rng)
        boards[::every] = [replace(b, xy=b.xy * 2 + 0.5, image_size=(1280, 960)) for b in boards[::every]]
        return _as(boards)

    return make


def _millimetres(rng: Rng) -> CaseInput:
    return replace(_as(plain(BROWN, rng)), spacing=25.0)


def _named_by_squares(rng: Rng) -> CaseInput:
    return _as(plain(BROWN, rng), size=(SIZE[0] + 1, SIZE[1] + 1))


def _mirrored_half(rng: Rng) -> CaseInput:
    """Half of the pictures were mirrored before corner detection: a mirrored checkerboard is still a checkerboard. The
    principal point, 26 px off the centre, is then on opposite sides of it."""
    width = BROWN.image_size[0]
    boards = plain(BROWN.with_parameters(BROWN.parameters + np.eye(9)[2] * 16), rng)
    for k in range(VIEWS // 2, VIEWS):
        b = boards[k]
        ij = b.ij * [-1, 1]
        boards[k] = replace(b, xy=np.column_stack([width - 1 - b.xy[:, 0], b.xy[:, 1]]), ij=ij - ij.min(axis=0))
    return _as(boards)


def _smeared_half(rng: Rng) -> CaseInput:
    return _as(plain(BROWN, rng, VIEWS // 2) + views(lambda T: view(BROWN, T, rng, 1.2), rng, VIEWS // 2))


def _stretched_half(rng: Rng) -> CaseInput:
    """Half of the pictures come from a video with another aspect ratio, scaled to the size of the others."""
    p = BROWN.parameters.copy()
    p[0] *= 1.1
    return _groups(BROWN, BROWN.with_parameters(p))(rng)


def _scattered(share: float) -> Callable[[Rng], CaseInput]:
    def make(rng: Rng) -> CaseInput:
        return _as(random_boards(BROWN, int(rng.integers(1 << 30)), VIEWS, NOISE, share)[0])

    return make


TOGETHER = ("one_camera", "aspect", "smooth", "left_out", "uneven", "systematic", "rms")
"""reasons for several cameras in one set: the direct one, and symptoms in the residuals if the cameras are not
distinguished"""
BEND = ("smooth", "dropped", "rms", "systematic", "left_out")
VARIETY = ("tilt", "tilt_spread", "views", "focal", "centre", "typical", "unsettled")
CASES = (
    BadCase("two cameras, half and half", _groups(BROWN, OTHER), TOGETHER),
    BadCase("autofocus, 2 % between groups", _groups(BROWN, zoomed(BROWN, 1.02)), TOGETHER),
    BadCase("zoom, 25 % between groups", _groups(BROWN, zoomed(BROWN, 1.25)), TOGETHER),
    BadCase("stretched video among pictures", _stretched_half, TOGETHER),
    BadCase("half of the pictures mirrored", _mirrored_half, TOGETHER),
    BadCase("paper, bent anew in every view", _paper, BEND),
    BadCase("a bent board", _bent_board, ("bent",)),
    BadCase("rolling shutter", _rolling_shutter, BEND),
    BadCase("a print that is stretched", _oblong, ("stretched",)),
    BadCase("three frontal views", _frontal(3), VARIETY),
    BadCase("ten frontal views", _frontal(10), VARIETY),
    BadCase("all views tilted alike", _one_tilt, VARIETY),
    BadCase("four places, five near-duplicates each", _duplicates(0.003), VARIETY),
    BadCase("four pictures, five copies each", _duplicates(0.0), VARIETY),
    BadCase(
        "one corner of the sensor", _within((0, 0), (0.5, 0.5)),
        ("coverage", "typical", "corners", "focal", "centre", "reach"),
    ),
    BadCase(
        "the centre only", _within((0.3, 0.25), (0.7, 0.75)),
        ("coverage", "typical", "corners", "focal", "centre", "reach"),
    ),
    BadCase("labels that pass over a column", _wrong_labels, ("left_out", "dropped")),
    BadCase("a lens that no coefficient follows", _ripples, ("systematic", "smooth")),
    BadCase(
        "a fisheye taken for a pinhole", _pinhole_for_fisheye,
        ("rms", "systematic", "smooth", "dropped", "left_out", "unsettled"),
    ),
    BadCase("pictures of another size, one in five", _other_size(5), ("picture_size",)),
    BadCase("pictures of another size, every other", _other_size(2), ("error",)),
    BadCase("spacing in millimetres", _millimetres, ("spacing",)),
    BadCase("board named by its squares", _named_by_squares, ("board_size",)),
    BadCase("half of the pictures smeared", _smeared_half, ("uneven",)),
    BadCase("a fifth of the corners wrong", _scattered(0.2), ("dropped", "left_out")),
)  # fmt: skip
"""all faults, grouped by cause"""
