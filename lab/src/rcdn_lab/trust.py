"""Validity of the stated standard deviations: simulated calibrations of known cameras, and how often the truth lies
within them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.errors import CalibrationError
from rcdn.types import Array, Board, Calibration, Camera
from rcdn_lab.camera_scenes import SPACING, random_boards, random_camera
from rcdn_lab.real_boards import smooth_error, uneven_board

NOISES = (0.1, 0.3, 1.0)
"""px, in turn"""
OUTLIERS = 0.05
MODELS = ("pinhole", "brown", "fisheye", "rational")
BOARDS = ("flat", "uneven", "paper")
"""kinds of boards: perfect; uneven in the same way in all views; held by hand, with a different bend in every view"""
STRETCH, PRINT_ERROR, BEND = 0.003, 0.0001, 0.0007
"""of an uneven board: relative excess of its x over its y; root mean square errors in its plane and out of it, m"""
PAPER = 0.0003
"""root mean square bend of hand-held paper, m"""
CORE = 4
"""fx, fy, cx, cy: the first of a camera's parameters"""


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of one run: error ÷ stated standard deviation of all `parameters` (P,) and of the `aspect` fx ÷ fy, at
    `noise` px."""

    noise: float
    parameters: Array
    aspect: float


@dataclass(frozen=True)
class Trust:
    """Figures of one lens model and kind of boards: `runs` and `failed` ones; shares of all parameters `within` one and
    two standard deviations; `spread`, the root mean square of error ÷ deviation; `by_noise`: px → share within one;
    shares within one of fx and fy (`focal`), fx ÷ fy (`aspect`), cx and cy (`centre`), and of the distortion
    coefficients, `lens` (NaN: there are none)."""

    model: str
    boards: str
    runs: int
    failed: int
    within: float
    within2: float
    spread: float
    by_noise: dict[float, float]
    focal: float
    aspect: float
    centre: float
    lens: float


def row(of: Trust) -> dict[str, Any]:
    """As a table row."""
    return {
        "model": of.model,
        "boards": of.boards,
        "runs": of.runs,
        "failed": of.failed,
        "within": of.within,
        "within2": of.within2,
        "spread": of.spread,
        **{f"within at {noise:g} px": of.by_noise.get(noise) for noise in NOISES},
        "focal": of.focal,
        "aspect": of.aspect,
        "centre": of.centre,
        "lens": None if np.isnan(of.lens) else of.lens,
    }


def simulated_boards(camera: Camera, seed: int, boards: str, noise: float, views: int = 20) -> list[Board]:
    """`views` boards of the kind `boards` as seen by `camera`, including parts, with `noise` px and 5 % gross
    outliers."""
    if boards == "uneven":
        offsets = uneven_board(np.random.default_rng([seed, 2]), STRETCH, PRINT_ERROR, BEND)
        return random_boards(camera, seed, views, noise, OUTLIERS, offsets=offsets)[0]
    if boards == "paper":
        return random_boards(camera, seed, views, noise, OUTLIERS, offsets=_held)[0]
    return random_boards(camera, seed, views, noise, OUTLIERS)[0]


def _held(rng: np.random.Generator) -> Array:
    bend = smooth_error(rng, PAPER)
    return np.column_stack([0 * bend, 0 * bend, bend])


def trust(model: str, runs: int, seed: int = 0, boards: str = "flat") -> Trust:
    """Calibrate `runs` times from 20 views of a kind of `boards`, including parts, with noise of 0.1, 0.3 and 1 px in
    turn and 5 % gross outliers."""
    done = list(_errors(model, runs, seed, boards))
    z = np.stack([e.parameters for e in done]) if done else np.full((1, CORE), np.nan)
    noise = np.array([e.noise for e in done])
    by_noise = {n: _share(z[noise == n]) for n in NOISES if (noise == n).any()}
    return Trust(
        model, boards, runs, runs - len(done), _share(z), _share(z, 2), float(np.sqrt((z**2).mean())), by_noise,
        focal=_share(z[:, :2]), aspect=_share(np.array([e.aspect for e in done])), centre=_share(z[:, 2:CORE]),
        lens=_share(z[:, CORE:]),
    )  # fmt: skip


def _share(z: Array, within: float = 1) -> float:
    return float((np.abs(z) < within).mean()) if z.size else float("nan")


def _errors(model: str, runs: int, seed: int, boards: str) -> Iterator[Errors]:
    """Errors of each run that gave a camera."""
    for k in range(seed, seed + runs):
        noise, camera = NOISES[k % len(NOISES)], random_camera(model, k)
        try:
            found = calibrate(simulated_boards(camera, k, boards, noise), SPACING, model=model)
        except CalibrationError:
            continue
        yield Errors(noise, (found.camera.parameters - camera.parameters) / found.std, _aspect(found, camera))


def _aspect(found: Calibration, camera: Camera) -> float:
    """Error of log(fx ÷ fy) ÷ its standard deviation."""
    focal, truth = found.camera.parameters[:2], camera.parameters[:2]
    slope = np.array([1, -1]) / focal
    return float(np.log(focal[0] / focal[1] * truth[1] / truth[0]) / np.sqrt(slope @ found.cov[:2, :2] @ slope))
