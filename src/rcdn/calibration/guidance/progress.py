"""How far a guided calibration is, what is wanted next, and when it is enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.added_view import Forecast
from rcdn.calibration.calibrate import calibrate
from rcdn.calibration.candidates import GRID, frame_grid
from rcdn.calibration.coded import Spacing
from rcdn.calibration.guidance.first_guess import first_guess
from rcdn.calibration.labels import Size
from rcdn.calibration.next_view import NextView, next_view, place_and_tilt
from rcdn.calibration.uncertainty import projection_uncertainty
from rcdn.errors import CalibrationError, present
from rcdn.geometry import unproject
from rcdn.types import Array, Board, Calibration, Camera, Plane
from rcdn.types.arrays import Real

FILLS = (0.85, 0.55, 0.35)
"""shares of the frame that the board may span where it is held facing the camera: the larger of those of width and height"""
NEAREST = 0.6
"""of the board's longer side: nearer it hides the light, and no lens is sharp from its middle to its rim"""
FEWEST = 8
"""views, below which it is never enough"""
ENDLESS = 60
"""pictures that may still be needed, beyond which more of them aren't the way"""
SETTLED = 10
"""views from which on that can be told"""
HINDRANCES = ("bent", "smooth", "systematic", "rms", "uneven")
"""checks of the verdict that say what more pictures won't mend"""


@dataclass(frozen=True, eq=False)
class Progress:
    """How far it is. `views`: the names of the accepted pictures. `calibration` from them, None until they settle a camera. `wanted`: where to
    hold the board for the next one, None before a board was seen and where no pose can be seen. `worst` px: the worst projection uncertainty
    over the frame (infinite before there is a camera), and `map` (rows, columns) of it over a grid from rim to rim, None before; `target` px to
    reach. `done`: it is reached. `stuck`: more pictures like these won't reach it. `sentence`: what to do, or why it is enough."""

    views: tuple[str, ...]
    calibration: Calibration | None
    wanted: NextView | None
    worst: float
    map: Array | None
    target: float
    done: bool
    stuck: bool
    sentence: str


@dataclass(frozen=True, eq=False)
class Known:
    """What is known: `found`, the calibration of the accepted pictures, None until they settle a camera; `guess` instead of it until then;
    the pictures' `names`; the board's `size` (columns, rows) in corners, None until it was seen whole, and the `plane` it counts on."""

    found: Calibration | None
    guess: Calibration | None
    names: tuple[str, ...]
    size: Size | None
    plane: Plane

    @property
    def calibration(self) -> Calibration:
        """The best there is."""
        return present(self.found or self.guess, "a camera")


@dataclass(frozen=True, eq=False)
class Plan:
    """A `progress` with what judging a frame needs: what is `known`, and the `forecast` of one view more under it."""

    progress: Progress
    known: Known
    forecast: Forecast | None


@dataclass(frozen=True)
class Wish:
    """What a guided calibration is to be: `image_size` (width, height) px, `spacing` m, lens `model`, `target` px."""

    image_size: tuple[int, int]
    spacing: Spacing
    model: str
    target: float


def learned(wish: Wish, boards: Sequence[Board], names: Sequence[str], size: Size | None, plane: Plane) -> Known:
    """What the accepted `boards` tell."""
    found = _calibrated(wish, boards, names, size)
    guess = None if found else first_guess(wish.image_size, boards, names, wish.spacing, size)
    return Known(found, guess, tuple(names), size, plane)


def planned(wish: Wish, known: Known, nearest: float = 0.0) -> Plan:
    """The plan for what is `known`; `nearest` m: the board isn't wanted nearer."""
    best, wanted = known.calibration, None
    if known.size is not None:
        distances = np.maximum(reach_of(best.camera, known.size, known.plane, best.spacing), nearest)
        size = _along(known.size, wish.image_size)
        wanted = next_view(best, distances=np.unique(distances), size=size, plane=known.plane)
    return Plan(_progress(wish, known, wanted), known, Forecast.of(best))


def reach_of(camera: Camera, size: Size, plane: Plane, spacing: float) -> Real[Array, " d"]:
    """(D,) m, rising: distances at which a board that faces the `camera` spans a good part of the frame."""
    width, height = camera.image_size
    cols, rows = _along(size, camera.image_size)
    extent = np.abs(plane.points(np.array([cols - 1, rows - 1]))) * spacing
    ends = np.array([[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]]) - 0.5
    middle = (np.array([width, height]) - 1) / 2
    least = NEAREST * float(extent.max())
    distances = []
    for fill in FILLS:
        rays = unproject(camera, middle + (ends - middle) * fill)
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        angles = np.arccos(np.clip([rays[0] @ rays[1], rays[2] @ rays[3]], -1, 1))
        distances.append(float(np.max(extent / 2 / np.tan(np.clip(angles, 1e-3, 3.0) / 2))))
    return np.unique(np.maximum(distances, least))


def _along(size: Size, image_size: tuple[int, int]) -> Size:
    """`size` with its longer side along the frame's."""
    return size if (size[0] >= size[1]) == (image_size[0] >= image_size[1]) else (size[1], size[0])


def _calibrated(wish: Wish, boards: Sequence[Board], names: Sequence[str], size: Size | None) -> Calibration | None:
    try:
        found = calibrate(boards, wish.spacing, names=names, model=wish.model, size=size)
    except CalibrationError:
        return None
    return found if np.isfinite(found.cov).all() else None


def _progress(wish: Wish, known: Known, wanted: NextView | None) -> Progress:
    found, names = known.found, known.names
    if found is None:
        said = "Hold the board in front of the camera." if wanted is None else place_and_tilt(wanted, wish.image_size)
        return Progress(names, None, wanted, float("inf"), None, wish.target, False, False, said)
    values = projection_uncertainty(found, frame_grid(wish.image_size)).reshape(GRID[1], GRID[0])
    worst = float(np.nanmax(values)) if np.isfinite(values).any() else float("inf")
    done = worst <= wish.target and len(found.used_views) >= FEWEST
    why = "" if done else _hopeless(found, worst, wish.target)
    if done:
        said = f"Enough: projections are known to {worst:.2g} px all over the picture."
    elif why:
        said = why
    else:
        said = "" if wanted is None else place_and_tilt(wanted, wish.image_size)
    return Progress(names, found, wanted, worst, values, wish.target, done, bool(why), said)


def _hopeless(found: Calibration, worst: float, target: float) -> str:
    """Why more pictures like these won't reach `target` px, or ""."""
    n = len(found.used_views)
    needed = n * ((worst / target) ** 2 - 1)  # a mean's variance falls with the number of views
    if n < SETTLED or needed <= ENDLESS or found.verdict is None:
        return ""
    cause = next((r for r in found.verdict.against if r.key in HINDRANCES), None)
    if cause is None:
        return ""
    return f"More pictures like these won't help: {cause.sentence} {cause.action}".rstrip()
