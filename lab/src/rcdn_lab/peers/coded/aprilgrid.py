"""The package aprilgrid: tags of AprilGrids, without AprilTag's library. It is given the family and the border."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from rcdn.types import Array
from rcdn.types.target import AprilGrid, Target
from rcdn_lab.peers.base import not_installed, version_of
from rcdn_lab.peers.coded.base import CodedPeer, Labelled, Read, boards_of, corners_of_tag

FAMILIES = ("tag16h5", "tag25h9", "tag36h11")
BORDERS = {1: "b1", 2: ""}
"""width of the border, bits, and the suffix of the package's name for it"""


def _reads(target: Target) -> bool:
    return isinstance(target, AprilGrid) and target.family in FAMILIES and target.border in BORDERS


def _missing() -> str | None:
    return not_installed("aprilgrid") and "not installed: pip install --no-deps aprilgrid"


@lru_cache
def _detector(family: str, border: int) -> Any:
    from aprilgrid import Detector

    return Detector(f"t{family.removeprefix('tag')}{BORDERS[border]}")


def read(image: Array, target: Target) -> list[Labelled]:
    """The corners of all tags that it finds; [] for targets that it does not support."""
    if not isinstance(target, AprilGrid) or not _reads(target):
        return []
    ids: list[int] = []
    xy: list[Array] = []
    for tag in _detector(target.family, target.border).detect(np.ascontiguousarray(image)):
        numbers = corners_of_tag(target, int(tag.tag_id))
        if numbers:
            ids += numbers
            xy += [np.asarray(corner, float).ravel() for corner in tag.corners]
    return boards_of(ids, xy)


def _load() -> Read:
    return read


APRILGRID = CodedPeer("aprilgrid", _reads, _missing, lambda: version_of("aprilgrid"), _load)
