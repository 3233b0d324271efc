"""Few pictures instead of all: cameras from those that were selected, and from as many at random, beside the camera of all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.selection import most_telling
from rcdn.errors import RcdnError
from rcdn.types import Array, Board, Calibration
from rcdn_lab.calibration.sets import CameraSet

COUNTS = (8, 10, 12)
"""pictures that are selected"""
FEWEST = 20
"""pictures that a set must have"""
DRAWS = 9
"""choices at random"""
SPACING = 0.03
"""m: a camera is the same whatever the squares measure"""


def boards_of(one: CameraSet, boards: Sequence[Board]) -> list[Board]:
    """Those that show the set's board whole, or at least from end to end."""
    return [b for b in boards if sorted(b.size) == sorted(one.size)]


def row_of(one: CameraSet, boards: Sequence[Board], seed: int = 0) -> dict[str, Any]:
    """The figures of one set of at least FEWEST `boards`, one a picture: root mean square difference from the camera of all over the frame,
    px, of the camera from those selected, of the median of those at random, and their ratio, by the number of pictures."""
    names = [str(k) for k in range(len(boards))]
    whole = calibrate(boards, SPACING, names=names, model=one.model, size=one.size)
    row: dict[str, Any] = {"set": one.name, "pictures": len(boards), "model": one.model, "rms": whole.rms}
    for many in COUNTS:
        rng = np.random.default_rng([seed, many])
        draws = [np.sort(rng.choice(len(boards), many, replace=False)) for _ in range(DRAWS)]
        usual = float(np.median([_off(whole, one, boards, d) for d in draws]))
        mine = _off(whole, one, boards, np.array([int(n) for n in most_telling(whole, many)]))
        row |= {f"selected_{many}": mine, f"random_{many}": usual, f"ratio_{many}": mine / usual}
    return row


def _off(whole: Calibration, one: CameraSet, boards: Sequence[Board], some: Array) -> float:
    """Infinite if they settle no camera."""
    try:
        found = calibrate([boards[k] for k in some], SPACING, model=one.model, size=one.size)
        return camera_difference(whole.camera, found.camera).rms
    except RcdnError:
        return float("inf")
