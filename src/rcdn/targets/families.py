"""The marker dictionaries of OpenCV, as bits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.types import Array

FAMILIES: tuple[tuple[str, ...], ...] = (
    ("DICT_4X4_50", "DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"),
    ("DICT_5X5_50", "DICT_5X5_100", "DICT_5X5_250", "DICT_5X5_1000"),
    ("DICT_6X6_50", "DICT_6X6_100", "DICT_6X6_250", "DICT_6X6_1000"),
    ("DICT_7X7_50", "DICT_7X7_100", "DICT_7X7_250", "DICT_7X7_1000"),
    ("DICT_ARUCO_ORIGINAL",),
    ("DICT_APRILTAG_16h5",),
    ("DICT_APRILTAG_25h9",),
    ("DICT_APRILTAG_36h10",),
    ("DICT_APRILTAG_36h11",),
    ("DICT_ARUCO_MIP_36h12",),
)
"""Nested dictionaries, the shortest first: the markers of each are the first ones of the next."""


@dataclass(frozen=True, eq=False)
class Family:
    """Nested dictionaries: the `bits` (N, n, n) of the longest, 1 is white; `names` and `sizes` of all, by rising
    size."""

    bits: Array
    names: tuple[str, ...]
    sizes: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.bits)

    def smallest(self, highest: int) -> str:
        """The smallest dictionary that contains the marker number `highest`."""
        return next(name for name, size in zip(self.names, self.sizes, strict=True) if highest < size)


@lru_cache
def families(side: int) -> tuple[Family, ...]:
    """All families of markers with `side`² bits."""
    return tuple(f for f in map(_family, FAMILIES) if f.bits.shape[1] == side)


def family_of(dictionary: str) -> Family:
    """The family that contains the `dictionary` with this name in OpenCV. Raises ConfigError if OpenCV has none of that
    name."""
    for names in FAMILIES:
        if dictionary in names and dictionary in _family(names).names:
            return _family(names)
    known = ", ".join(name for names in FAMILIES for name in _family(names).names)
    raise ConfigError(f"dictionary must be one of {known}, not {shown(dictionary)}")


@lru_cache
def _family(names: tuple[str, ...]) -> Family:
    known = [name for name in names if hasattr(cv2.aruco, name)]  # older versions of OpenCV have fewer
    dictionaries = [cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)) for name in known]
    if not dictionaries:
        return Family(np.zeros((0, 1, 1), np.uint8), (), ())
    side = dictionaries[-1].markerSize
    rows = dictionaries[-1].bytesList
    bits = np.stack([cv2.aruco.Dictionary.getBitsFromByteList(row[None], side) for row in rows])
    return Family(bits.astype(np.uint8), tuple(known), tuple(len(d.bytesList) for d in dictionaries))
