"""Section 4.3's figure: sub-pixel refinements of one corner over noise, blur, rotation and tilt.

Choices that the paper leaves open: "low levels" of the other factors are noise 2, blur 1 px, rotation 10° and tilt 10°.
All methods start from the highest response of the central 10 × 10 px; a picture without one is left out for all of
them. If a method fails, its initial position is kept, as in detection, and the failure is counted.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.config import Refine
from rcdn.corners.adaptive import LONE_PITCH
from rcdn.corners.refine import refine
from rcdn.corners.response import ResponseModel
from rcdn.errors import ConfigError
from rcdn.types import Array, Status
from rcdn_lab.paper.corner_pictures import View, corner_xy, defocused, noisy
from rcdn_lab.paper.lone_fit import lone_fit
from rcdn_lab.paper.middle_response import middle_response
from rcdn_lab.paper.pixel_error import standard_error
from rcdn_lab.share_out import share_out
from rcdn_lab.table_weights import load_network

SIZE, REGION = 80, 10
LOW = (SIZE - REGION) // 2
AROUND = 5
"""px around the region in which methods use the response (CoM: 4)"""
FIRST = 8_200_000_000
"""No training and no other test uses this seed."""
CHUNK = 50
"""pictures that are refined together, independent of the number of processes"""
SEED, FITTED = "seed", "ours, fit"
RESPONSE = {"CoM": Refine("com"), "Gauss": Refine("peak"), "parabola": Refine("parabola")}
INTENSITY = {"OpenCV": Refine("edge"), "ROCHADE": Refine("saddle", half=2)}
MIXED = {"mixed": Refine("mixed", half=2)}
OURS = {"ours, first": Refine("saddle", half=None)}
RULES = RESPONSE | INTENSITY | MIXED | OURS
METHODS = (SEED, *RULES, FITTED)
"""The initial position, the paper's six (windows: CoM and OpenCV 9×9, ROCHADE 5×5, Gauss and parabola 3×3), the first
refinement of `auto` (windows of 17 and 19 px for a corner without neighbours), and the fit of a blurred crossing to
squares of 20 px."""
Row = dict[str, Any]

_model: list[ResponseModel] = []
"""The network of this process."""


@dataclass(frozen=True)
class Levels:
    """Parameters of the pictures; the defaults are the low levels. Grey levels, px, degrees, degrees."""

    noise: float = 2.0
    blur: float = 1.0
    rotation: float = 10.0
    tilt: float = 10.0


BASE = Levels()
FACTORS: dict[str, tuple[float, ...]] = {
    "noise": tuple(range(0, 101, 10)),
    "blur": tuple(k / 2 for k in range(13)),
    "rotation": tuple(range(0, 91, 5)),
    "tilt": tuple(range(0, 71, 5)),
}


@dataclass(frozen=True)
class Task:
    """Pictures `first` to `last` - 1 of one level of a factor."""

    factor: str
    level: float
    first: int
    last: int


def picture(factor: str, level: float, trial: int) -> tuple[Array, Array]:
    """Picture `trial` (SIZE, SIZE) uint8 of a level, and its corner (2,) px. The same arguments give the same
    picture."""
    made = replace(BASE, **{factor: float(level)})
    rng = np.random.default_rng([FIRST, zlib.crc32(factor.encode()), round(10 * level), trial])
    x, y = rng.uniform(-0.5, 0.5, 2)
    view = View(made.rotation, made.tilt, float(x), float(y))
    return noisy(defocused(view, SIZE, made.blur), made.noise, rng), np.array(corner_xy(view, SIZE))


def responses(model: ResponseModel, grey: Array) -> Array:
    """Response (SIZE, SIZE) float32 of `grey`, in the region and around it; 0 elsewhere."""
    out = np.zeros((SIZE, SIZE), np.float32)
    near = slice(LOW - AROUND, LOW + REGION + AROUND)
    out[near, near] = middle_response(model, grey, near.start, near.stop)
    return out


def start(response: Array) -> Array | None:
    """The pixel (x, y) of the highest response in the region of `response` (SIZE, SIZE); None if there is no
    response."""
    region = response[LOW : LOW + REGION, LOW : LOW + REGION]
    if region.max() <= 0:
        return None
    y, x = np.unravel_index(int(region.argmax()), region.shape)
    return np.array([x + LOW, y + LOW])


def positions(shots: Sequence[Array], maps: Sequence[Array], starts: Array) -> tuple[Array, Array]:
    """Results of each of METHODS from `starts` (N, 2) in N pictures and their responses: px (M, N, 2), and whether it
    failed (M, N).

    The pictures are stacked vertically: no window reaches from the centre of one to the next.
    """
    fall = np.stack([np.zeros(len(starts), np.int64), SIZE * np.arange(len(starts))], axis=1)
    grey, response, seeds = np.concatenate(shots), np.concatenate(maps), starts + fall
    pitch = np.full(len(seeds), LONE_PITCH)
    found = [(seeds.astype(float), np.zeros(len(seeds), bool))]
    for rule in RULES.values():
        xy, status = refine(grey, response, seeds, rule, pitch)
        found.append((xy, status == Status.SEED))
    found.append(lone_fit(grey, *found[-1]))
    return np.stack([xy - fall for xy, _ in found]), np.stack([failed for _, failed in found])


def table(
    trials: int = 200,
    factors: Sequence[str] = (),
    weights: str = "paper",
    workers: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Row]:
    """One row for each factor, level and method, of `trials` pictures each.

    `factors`: of FACTORS, empty: all; `weights`: the network that finds the corner, for `load_network`. `mean px`, `se
    px`, `median px`: error; `failed`: share of the answers that are the initial position; `no corner`: share of the
    pictures without an initial position, which are left out of the other figures. The same arguments give the same
    rows, whatever `workers`. Raises ConfigError for an unknown factor.
    """
    if unknown := sorted(set(factors) - set(FACTORS)):
        raise ConfigError(f"--factor: nothing is called {', '.join(unknown)}; known: {', '.join(FACTORS)}")
    levels = [(factor, level) for factor in (factors or FACTORS) for level in FACTORS[factor]]
    tasks = [Task(*at, k, min(k + CHUNK, trials)) for at in levels for k in range(0, trials, CHUNK)]
    found: dict[tuple[str, float], list[tuple[Array, Array]]] = {at: [] for at in levels}
    for task, result in zip(tasks, share_out(_errors, tasks, workers, _load, (weights,), progress), strict=True):
        found[task.factor, task.level].append(result)
    return [row for at, parts in found.items() for row in _rows(*at, trials, parts)]


def _load(weights: str) -> None:
    _model[:] = [load_network(weights)]


def _errors(task: Task) -> tuple[Array, Array]:
    """Errors, px, and failures (M, n) of all methods on those pictures of a task that have an initial position."""
    shots, maps, starts, truth = [], [], [], []
    for trial in range(task.first, task.last):
        grey, xy = picture(task.factor, task.level, trial)
        response = responses(_model[0], grey)
        at = start(response)
        if at is not None:
            shots.append(grey)
            maps.append(response)
            starts.append(at)
            truth.append(xy)
    if not starts:
        return np.zeros((len(METHODS), 0)), np.zeros((len(METHODS), 0), bool)
    xy, failed = positions(shots, maps, np.array(starts))
    return np.linalg.norm(xy - np.array(truth), axis=2), failed


def _rows(factor: str, level: float, trials: int, parts: Sequence[tuple[Array, Array]]) -> list[Row]:
    errors, failed = (np.concatenate([part[k] for part in parts], axis=1) for k in (0, 1))
    count = errors.shape[1]
    out = []
    for k, method in enumerate(METHODS):
        row = {"factor": factor, "level": level, "method": method, "trials": trials}
        some = {
            "mean px": float(errors[k].mean()), "se px": standard_error(errors[k]),
            "median px": float(np.median(errors[k])), "failed": float(failed[k].mean()),
        } if count else dict.fromkeys(("mean px", "se px", "median px", "failed"))  # fmt: skip
        out.append(row | some | {"no corner": 1 - count / trials})
    return out
