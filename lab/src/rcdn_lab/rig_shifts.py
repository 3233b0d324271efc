"""Videos of a rig put out of step on purpose: one camera's frames are numbered as if they had been
taken earlier or later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rcdn.calibration import calibrate, calibrate_rig
from rcdn.types import Camera, RigCalibration
from rcdn_lab.real_rigs.sets import Shots

FIRST = 1000
"""number of the first frame: numbers stay positive when frames are shifted"""


def lenses(shots: Shots, spacing: float) -> dict[str, Camera]:
    """The lens of each camera, from its own pictures: time plays no part in it."""
    return {n: calibrate(list(each.values()), spacing).camera for n, each in shots.boards.items()}


def shifted(shots: Shots, camera: str, frames: int) -> Shots:
    """The same pictures, those of one camera numbered as if it were `frames` later than it is."""
    return Shots({
        n: {str(FIRST + int(m) - (frames if n == camera else 0)): b for m, b in each.items()}
        for n, each in shots.boards.items()
    })  # fmt: skip


def rig(shots: Shots, cameras: Mapping[str, Camera], spacing: float, correct: bool) -> RigCalibration:
    """The rig of known lenses, brought into step or not."""
    views, moments = shots.arguments()
    return calibrate_rig(views, spacing, moments=moments, cameras=cameras, correct_time=correct)


def row_of(
    shots: Shots, cameras: Mapping[str, Camera], spacing: float, camera: str, frames: int, base: Mapping[str, float]
) -> dict[str, Any]:
    """What is found of one shift, added to that of the videos as they are (`base`, frames by camera)."""
    some = shifted(shots, camera, frames)
    bare, corrected = (rig(some, cameras, spacing, correct) for correct in (False, True))
    found = corrected.shifts or {}
    zero = next((n for n, s in found.items() if s.moments == 0), "")
    mine = found.get(camera)
    return {
        "camera": camera,
        "frames": frames,
        "found": float("nan") if mine is None else mine.moments,
        "std": float("nan") if mine is None else mine.std,
        "true": frames + base.get(camera, 0.0) - base.get(zero, 0.0),
        "in_step_with": zero,
        "connected": len(corrected.rig),
        "corrected": ", ".join(corrected.corrected),
        "rms": bare.rms,
        "rms_corrected": corrected.rms,
        "boards": len(bare.boards),
        "boards_corrected": len(corrected.boards),
        "epipolar_px": _epipolar(bare),
        "epipolar_px_corrected": _epipolar(corrected),
    }


def _epipolar(found: RigCalibration) -> float:
    """Root mean square of the pairs' distances in moments held out, px."""
    known = [p.epipolar for p in found.pairs if np.isfinite(p.epipolar)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")
