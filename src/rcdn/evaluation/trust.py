"""Do the stated standard deviations hold? Simulated calibrations of known cameras, and how often the truth lies within them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.errors import CalibrationError
from rcdn.evaluation.camera_scenes import SPACING, random_boards, random_camera
from rcdn.types import Array

NOISES = (0.1, 0.3, 1.0)
"""px, in turn"""
OUTLIERS = 0.05
MODELS = ("pinhole", "brown", "fisheye", "rational")


@dataclass(frozen=True)
class Trust:
    """Of one lens model: `runs` and `failed` ones; shares of all parameters `within` one and two standard deviations; `spread`, the root
    mean square of error ÷ deviation; `by_noise`: px → share within one."""

    model: str
    runs: int
    failed: int
    within: float
    within2: float
    spread: float
    by_noise: dict[float, float]


def row(of: Trust) -> dict[str, Any]:
    """As a line of a table."""
    flat = {f"within at {noise:g} px": share for noise, share in of.by_noise.items()}
    return {
        "model": of.model,
        "runs": of.runs,
        "failed": of.failed,
        "within": of.within,
        "within2": of.within2,
        "spread": of.spread,
        **flat,
    }


def trust(model: str, runs: int, seed: int = 0) -> Trust:
    """Calibrate `runs` times from 20 views, parts included, with noise of 0.1, 0.3 and 1 px in turn and 5 % gross outliers."""
    done = list(_errors(model, runs, seed))
    z = np.concatenate([e for _, e in done])
    by_noise = {
        n: _share(np.concatenate([e for m, e in done if m == n]), 1) for n in NOISES if any(m == n for m, _ in done)
    }
    return Trust(model, runs, runs - len(done), _share(z, 1), _share(z, 2), float(np.sqrt((z**2).mean())), by_noise)


def _share(z: Array, within: float) -> float:
    return float((np.abs(z) < within).mean())


def _errors(model: str, runs: int, seed: int) -> Iterator[tuple[float, Array]]:
    """(noise, error ÷ standard deviation (P,)) of each run that gave a camera."""
    for k in range(seed, seed + runs):
        noise, camera = NOISES[k % len(NOISES)], random_camera(model, k)
        boards, _ = random_boards(camera, k, noise=noise, outliers=OUTLIERS)
        try:
            found = calibrate(boards, SPACING, model=model)
        except CalibrationError:
            continue
        yield noise, (found.camera.parameters - camera.parameters) / found.std
