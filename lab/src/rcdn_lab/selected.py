"""Cameras from few pictures, selected, random and evenly spaced ones, compared with the camera from all."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.selection import selected
from rcdn.errors import RcdnError
from rcdn.types import Board, Calibration

COUNTS = (8, 10, 12)
"""numbers of selected pictures"""
FEWEST = {"photographs": 20, "video": 16}
"""least number of pictures of a set"""
DRAWS = 9
"""random selections"""
SPACING = 0.03
"""m: the camera does not depend on the size of the squares"""


@dataclass(frozen=True, eq=False)
class Pictures:
    """`boards` of pictures of one camera, one per picture, in their order; the lens `model` to solve for; the `size`
    (columns, rows) of the board, None if its codes give the places of its corners."""

    name: str
    model: str
    size: tuple[int, int] | None
    boards: tuple[Board, ...]

    def calibrated(self, some: Iterable[int]) -> Calibration:
        """From the boards of indices `some`."""
        chosen = list(some)
        return calibrate(
            [self.boards[k] for k in chosen],
            SPACING,
            names=[str(k) for k in chosen],
            model=self.model,
            size=self.size,
        )


def row_of(pictures: Pictures, seed: int = 0) -> dict[str, Any]:
    """The figures of one set: root mean square difference over the frame from the camera of all, px, of the cameras
    from selected pictures, from evenly spaced ones, and the median of those from random ones, by the number of
    pictures; and the ratio of the first to each of the others."""
    count = len(pictures.boards)
    whole = pictures.calibrated(range(count))
    row: dict[str, Any] = {"set": pictures.name, "pictures": count, "model": pictures.model, "rms": whole.rms}

    def off(some: Iterable[int]) -> float:
        try:
            return camera_difference(whole.camera, pictures.calibrated(some).camera).rms
        except RcdnError:  # they do not determine a camera
            return float("inf")

    for many in COUNTS:
        rng = np.random.default_rng([seed, many])
        draws = [np.sort(rng.choice(count, many, replace=False)) for _ in range(DRAWS)]
        median = float(np.median([off(d) for d in draws]))
        even = off(np.linspace(0, count - 1, many).round().astype(int))
        _, found = selected(whole, many, lambda names: pictures.calibrated(int(name) for name in names))
        mine = camera_difference(whole.camera, found.camera).rms
        row |= {f"selected_{many}": mine, f"random_{many}": median, f"even_{many}": even}
        row |= {f"of_random_{many}": mine / median, f"of_even_{many}": mine / even}
    return row
