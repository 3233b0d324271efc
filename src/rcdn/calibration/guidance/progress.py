"""Progress of a guided calibration: the next wanted view, and the criterion for completion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.calibration.added_pair import SideForecast
from rcdn.calibration.added_view import Forecast
from rcdn.calibration.calibrate import calibrate
from rcdn.calibration.candidates import GRID, frame_grid
from rcdn.calibration.coded import Spacing
from rcdn.calibration.guidance.first_guess import first_guess
from rcdn.calibration.guidance.way_up import TURN, held_up, next_way, upright
from rcdn.calibration.labels import Size
from rcdn.calibration.next_view import NextView, next_view, place_and_tilt
from rcdn.calibration.uncertainty import projection_uncertainty
from rcdn.errors import CalibrationError, many, present, two_digits
from rcdn.geometry import unproject
from rcdn.geometry.rigid import unit
from rcdn.types import Array, Board, Calibration, Camera, Plane, Verdict
from rcdn.types.arrays import Real

FILLS = (0.85, 0.55, 0.35)
"""shares of the frame that a board facing the camera spans at the candidate distances: the larger of those of width and
height"""
NEAREST = 0.6
"""least distance, as a share of the board's longer side: closer it blocks the light, and no lens is sharp from its
centre to its border"""
FEWEST = 8
"""least number of views for completion"""
ENDLESS = 60
"""number of further pictures above which more pictures are not the remedy"""
JUDGED_FROM = 10
"""least number of views for that decision"""
HINDRANCES = ("bent", "smooth", "systematic", "rms", "uneven", "pair_rms", "epipolar")
"""checks of the verdict whose causes more pictures do not remove"""


@dataclass(frozen=True, eq=False)
class Progress:
    """State of a guided calibration. `views`: the names of the accepted pictures. `calibration` from them, None until
    they determine a camera. `wanted`: the pose of the board for the next picture, None before a board was seen and if
    no candidate is visible. `worst` px: the worst projection uncertainty over the frame (infinite before there is a
    camera), and `map` (rows, columns) of it over a grid that includes the border, None before; `target` px to reach.
    `done`: it is reached. `sentence`: what to do, or why the calibration is sufficient, or why more pictures of this
    kind will not make it so."""

    views: tuple[str, ...]
    calibration: Calibration | None
    wanted: NextView | None
    worst: float
    map: Array | None
    target: float
    done: bool
    sentence: str

    def __repr__(self) -> str:
        camera = "no camera yet" if self.calibration is None else reached(self.worst, self.target, self.done)
        return f"<Progress: {many(len(self.views), 'view')}, {camera}>"


def reached(worst: float, target: float, done: bool) -> str:
    """How far the worst uncertainty is from the one wanted."""
    return f"worst {two_digits(worst)} px, wanted {target:.4g} px{', done' * done}"


@dataclass(frozen=True, eq=False)
class Known:
    """The current estimate: `found`, the calibration from the accepted pictures, None until they determine a camera;
    `guess`, the provisional one until then; the pictures' `names`; the board's `size` (columns, rows) in corners, None
    until it was seen whole, and the `plane` of its labels; `way`: which way up the next picture is wanted, None:
    either, and `turn`: whether the board must be turned for it (`way_up.next_way`)."""

    found: Calibration | None
    guess: Calibration | None
    names: tuple[str, ...]
    size: Size | None
    plane: Plane
    way: bool | None = None
    turn: bool = False

    @property
    def calibration(self) -> Calibration:
        """The best available estimate."""
        return present(self.found or self.guess, "a camera")


@dataclass(frozen=True, eq=False)
class Plan:
    """A `progress` with what the assessment of a frame needs: the estimate `known`, and the `forecast` for one more
    view under it (one of two cameras: for a pair)."""

    progress: Progress
    known: Known
    forecast: Forecast | SideForecast | None


@dataclass(frozen=True)
class Wish:
    """Settings of a guided calibration: `image_size` (width, height) px, `spacing` m, lens `model`, `target` px."""

    image_size: tuple[int, int]
    spacing: Spacing
    model: str
    target: float


def learned(wish: Wish, boards: Sequence[Board], names: Sequence[str], size: Size | None, plane: Plane) -> Known:
    """The estimate from the accepted `boards`."""
    found = _calibrated(wish, boards, names, size)
    guess = None if found else first_guess(wish.image_size, boards, names, wish.spacing, size)
    return Known(found, guess, tuple(names), size, plane, *next_way(upright(board, size) for board in boards))


def planned(wish: Wish, known: Known, sharp: tuple[float, float] = (0.0, np.inf)) -> Plan:
    """The plan for the estimate `known`; `sharp` m: least and greatest distance of the wanted pose, the depth of field
    as far as it is known."""
    best, wanted = known.calibration, None
    if known.size is not None:
        distances = np.clip(reach_of(best.camera, known.size, known.plane, best.spacing), *sharp)
        size = _along(known.size, wish.image_size)
        wanted = next_view(best, distances=np.unique(distances), size=size, plane=known.plane)
        wanted = None if wanted is None else held_up(wanted, known.way, known.plane, best.spacing)
    return Plan(_progress(wish, known, wanted), known, Forecast.of(best))


def reach_of(camera: Camera, size: Size, plane: Plane, spacing: float) -> Real[Array, " d"]:
    """(D,) m, ascending: distances at which a board that faces the `camera` spans a large part of the frame."""
    width, height = camera.image_size
    cols, rows = _along(size, camera.image_size)
    extent = np.abs(plane.points(np.array([cols - 1, rows - 1]))) * spacing
    ends = np.array([[0, height / 2], [width, height / 2], [width / 2, 0], [width / 2, height]]) - 0.5
    middle = (np.array([width, height]) - 1) / 2
    least = NEAREST * float(extent.max())
    distances = []
    for fill in FILLS:
        rays = unit(unproject(camera, middle + (ends - middle) * fill))
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
        sentence = _where(wish, known, wanted) or "Hold the board in front of the camera."
        return Progress(names, None, wanted, float("inf"), None, wish.target, False, sentence)
    values = projection_uncertainty(found, frame_grid(wish.image_size)).reshape(GRID[1], GRID[0])
    worst = float(np.nanmax(values)) if np.isfinite(values).any() else float("inf")
    done = worst <= wish.target and len(found.used_views) >= FEWEST
    why = "" if done else hopeless(found.verdict, len(found.used_views), worst, wish.target)
    if done:
        sentence = f"Enough: projections are known to {worst:.2g} px all over the picture."
    elif why:
        sentence = why
    else:
        sentence = _where(wish, known, wanted)
    return Progress(names, found, wanted, worst, values, wish.target, done, sentence)


def _where(wish: Wish, known: Known, wanted: NextView | None) -> str:
    """The instruction in words: where to hold the board, and whether to turn it first."""
    if wanted is None:
        return ""
    return f"{TURN} " * known.turn + place_and_tilt(wanted, wish.image_size)


def hopeless(verdict: Verdict | None, n: int, worst: float, target: float) -> str:
    """The reason why more pictures like the `n` accepted ones will not reach `target` px from `worst`, or ""."""
    needed = n * ((worst / target) ** 2 - 1)  # the variance of a mean is inversely proportional to the number of views
    if n < JUDGED_FROM or needed <= ENDLESS or verdict is None or not verdict.judged:
        return ""
    cause = next((r for r in verdict.against if r.key.split(".")[-1] in HINDRANCES), None)
    if cause is None:
        return ""
    return f"More pictures like these won't help: {cause.sentence} {cause.action}".rstrip()
