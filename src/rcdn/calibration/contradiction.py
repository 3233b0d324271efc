"""Lenses of a joint solution that contradict those of the cameras alone.

Cameras that didn't see a board at the same moments share no pose of it. Where most boards are affected, the least
squares bend lenses and the board's shape until the views fit to each other, which each camera alone contradicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.rig_task import RigTask
from rcdn.types import Calibration

BENT = 20.0
"""standard deviations of a lens parameter, as the camera alone has it, by which a joint solution contradicts it: other
cameras' views move it by up to four, boards of other moments by hundreds"""
WORSE = 2.0
"""× the median length of the residuals of the camera alone: a lens that fits the corners better isn't bent"""


def contradicted(task: RigTask, fit: robust.Fit, alone: Sequence[Calibration]) -> list[int]:
    """The cameras of `task`, by their numbers there, whose lens the joint solution `fit` moves much farther than their
    own views leave open (BENT), and whose corners fit much worse for that (WORSE)."""
    return [
        local
        for local, c in enumerate(task.cameras)
        if not task.known[local]
        and _moved(alone[c], fit, local) > BENT
        and _median(fit.residuals[task.corners.camera == local])
        > WORSE * _median(np.concatenate([v.residuals for v in alone[c].used_views]))
    ]


def with_held(task: RigTask, cameras: Sequence[int]) -> RigTask:
    """`task` with the lenses of more `cameras`, by their numbers there, held constant."""
    return replace(task, known=[known or local in cameras for local, known in enumerate(task.known)])


def _moved(alone: Calibration, fit: robust.Fit, local: int) -> float:
    """The largest change of a lens coefficient, in its standard deviations."""
    few = alone.camera.coefficients
    std = np.asarray(alone.std)[:few]
    change = np.abs(fit.state.cameras[local].parameters[:few] - alone.camera.parameters[:few])
    return float(np.max(change[std > 0] / std[std > 0], initial=0.0))


def _median(residuals: np.ndarray) -> float:
    return float(np.median(np.nan_to_num(np.linalg.norm(residuals, axis=1), nan=np.inf)))
