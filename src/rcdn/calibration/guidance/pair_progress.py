"""Progress of a guided calibration of two cameras: the next wanted pose, and the criterion for completion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rcdn.calibration.added_pair import PairForecast, Projections
from rcdn.calibration.candidates import GRID
from rcdn.calibration.guidance.pair_estimate import PairKnown, Wishes
from rcdn.calibration.guidance.progress import FEWEST, JUDGED_FROM, hopeless, reach_of, reached
from rcdn.calibration.next_pair import NextPair, next_pair
from rcdn.calibration.next_view import distances_of, place_and_tilt
from rcdn.errors import many
from rcdn.types import Array, StereoCalibration
from rcdn.types.arrays import Real

PARTS = ("left", "right", "between")
"""what is to be known: projections into the left picture, into the right one, and from the left into the right one"""
BOTH = "Hold the whole board where both cameras see it."


@dataclass(frozen=True, eq=False)
class PairProgress:
    """State of a guided calibration of two cameras. `views`: the names of the accepted moments. `stereo` from them,
    None until they determine it. `wanted`: the pose of the board for the next ones, None before both cameras have seen
    the board at once. `parts` (3,) px: the worst uncertainty of each of PARTS over the frame, and `worst`, the largest
    of them (infinite before there is a calibration); `maps`: for each part (rows, columns) over a grid that includes
    the border, NaN where the other camera doesn't see; `target` px. `done`, `sentence` as in `Progress`."""

    views: tuple[str, ...]
    stereo: StereoCalibration | None
    wanted: NextPair | None
    worst: float
    parts: tuple[float, ...]
    maps: tuple[Array, ...] | None
    target: float
    done: bool
    sentence: str

    def __repr__(self) -> str:
        cameras = "no pair of cameras yet" if self.stereo is None else reached(self.worst, self.target, self.done)
        return f"<PairProgress: {many(len(self.views), 'moment')}, {cameras}>"


@dataclass(frozen=True, eq=False)
class PairPlan:
    """A `progress` with the estimate `known` and the `forecast` under it, None before there is one."""

    progress: PairProgress
    known: PairKnown
    forecast: PairForecast | None


Limits = tuple[tuple[float, float], tuple[float, float]]
"""m: least and greatest distance of the wanted pose from the left and from the right camera"""


def pair_planned(wishes: Wishes, known: PairKnown, sharp: Limits, taken: tuple[Array, Array]) -> PairPlan:
    """The plan for the estimate `known`; `sharp`: the depths of field, as far as they are known; `taken`: outlines of
    the boards in the accepted left and right pictures."""
    if known.pair is None or known.size is None:
        return PairPlan(_nothing(wishes, known), known, None)
    forecast = PairForecast.of(known.pair, _working_distance(known))
    distances = [
        np.unique(np.clip(reach_of(c.camera, known.size, known.plane, c.spacing), *limits))
        for c, limits in zip(known.sides, sharp, strict=True)
    ]
    near = (distances[0], distances[1])
    wanted = next_pair(known.sides, forecast, known.size, known.plane, near, known.stereo is None, taken)
    return PairPlan(_progress(wishes, known, wanted, forecast), known, forecast)


def _working_distance(known: PairKnown) -> float:
    """m: the median distance of the boards from the left camera."""
    seen = distances_of(known.sides[0])
    return float(np.median(seen)) if len(seen) else 1.0


def _nothing(wishes: Wishes, known: PairKnown) -> PairProgress:
    """Before both cameras have seen the board at once."""
    target, unknown = wishes[0].target, float("inf")
    return PairProgress(known.names, None, None, unknown, (unknown,) * 3, None, target, False, BOTH)


def _progress(wishes: Wishes, known: PairKnown, wanted: NextPair | None, forecast: PairForecast) -> PairProgress:
    target, stereo = wishes[0].target, known.stereo
    sentence = BOTH if wanted is None else place_and_tilt(wanted.leading, wishes[wanted.lead].image_size)
    if stereo is None:
        why = known.trouble if len(known.names) >= JUDGED_FROM else ""
        unknown = (float("inf"),) * 3
        return PairProgress(known.names, None, wanted, unknown[0], unknown, None, target, False, why or sentence)
    values = forecast.projections.deviations(forecast.pair.cov)
    maps = tuple(_map(forecast.projections, values, part, wishes) for part in range(len(PARTS)))
    parts = tuple(float(np.nanmax(m)) if np.isfinite(m).any() else float("inf") for m in maps)
    worst, pairs = max(parts), _pairs(stereo)
    done = worst <= target and min(len(stereo.left.used_views), len(stereo.right.used_views), pairs) >= FEWEST
    why = "" if done else hopeless(stereo.verdict, pairs, worst, target)
    if done:
        sentence = f"Enough: both cameras and where they stand are known to {worst:.2g} px."
    return PairProgress(known.names, stereo, wanted, worst, parts, maps, target, done, why or sentence)


def _pairs(stereo: StereoCalibration) -> int:
    """The number of used moments at which both cameras saw the board."""
    left, right = ({v.name for v in side.used_views} for side in (stereo.left, stereo.right))
    return len(left & right)


def _map(projections: Projections, values: Real[Array, " g"], part: int, wishes: Wishes) -> Array:
    """(rows, columns): the largest of the `values` of a part at each place of the grid; NaN where there is none."""
    mine, size = projections.part == part, wishes[1 if part == 1 else 0].image_size
    cells = np.round(projections.xy[mine] / (np.array(size) - 1) * (np.array(GRID) - 1)).astype(int)
    out = np.full(GRID[::-1], -np.inf)
    np.maximum.at(out, (cells[:, 1], cells[:, 0]), values[mine])
    return np.where(np.isfinite(out), out, np.nan)
