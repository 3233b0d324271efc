"""Cameras from few pictures, selected ones and random ones, compared with the camera from all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.selection import most_informative
from rcdn.errors import RcdnError
from rcdn.types import Array, Board, Calibration
from rcdn_lab.calibration.sets import CameraSet

COUNTS = (8, 10, 12)
"""numbers of selected pictures"""
FEWEST = 20
"""least number of pictures of a set"""
DRAWS = 9
"""random selections"""
SPACING = 0.03
"""m: the camera does not depend on the size of the squares"""


def boards_of(one: CameraSet, boards: Sequence[Board]) -> list[Board]:
    """Boards that show the set's board whole, or at least from end to end."""
    return [b for b in boards if sorted(b.size) == sorted(one.size)]


def row_of(one: CameraSet, boards: Sequence[Board], seed: int = 0) -> dict[str, Any]:
    """The figures of one set of at least FEWEST `boards`, one per picture: root mean square difference over the frame
    from the camera of all, px, of the camera from the selected ones, the median of those from random ones, and their
    ratio, by the number of pictures."""
    names = [str(k) for k in range(len(boards))]
    whole = calibrate(boards, SPACING, names=names, model=one.model, size=one.size)
    row: dict[str, Any] = {"set": one.name, "pictures": len(boards), "model": one.model, "rms": whole.rms}
    for many in COUNTS:
        rng = np.random.default_rng([seed, many])
        draws = [np.sort(rng.choice(len(boards), many, replace=False)) for _ in range(DRAWS)]
        median = float(np.median([_off(whole, one, boards, d) for d in draws]))
        mine = _off(whole, one, boards, np.array([int(n) for n in most_informative(whole, many)]))
        row |= {f"selected_{many}": mine, f"random_{many}": median, f"ratio_{many}": mine / median}
    return row


def _off(whole: Calibration, one: CameraSet, boards: Sequence[Board], some: Array) -> float:
    """Infinite if the boards do not determine a camera."""
    try:
        found = calibrate([boards[k] for k in some], SPACING, model=one.model, size=one.size)
        return camera_difference(whole.camera, found.camera).rms
    except RcdnError:
        return float("inf")
