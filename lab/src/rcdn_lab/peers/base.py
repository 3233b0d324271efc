"""What every peer is to the rest: a name, what it needs to be told, and a function from a picture to grids."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Literal

import numpy as np

from rcdn.types import Array


@dataclass(frozen=True, eq=False)
class Grid:
    """A board as any detector gives it.

    `xy` (N, 2) px, pixel (0, 0) the centre of the top-left pixel; `ij` (N, 2) column and row, or None if it has no labels
    (raw corners); `sigma` (N,) standard deviation, px, or None.
    """

    xy: Array
    ij: Array | None = None
    sigma: Array | None = None


Find = Callable[[Array, tuple[int, int]], list[Grid]]
"""(H, W) uint8 and the board's size (columns, rows) in inner corners, which a peer of size `free` doesn't look at → grids"""


@dataclass(frozen=True)
class Peer:
    """Another detector. `load` makes it, once a process, and may be slow; it raises nothing if `missing` gives None.

    `size`: `given` if it must be told the board's size; `missing`: why it can't run here, or None; `raw`: it gives
    corners without boards; `board`: the only size (columns, rows) that it is asked for, None for any.
    """

    name: str
    size: Literal["given", "free"]
    missing: Callable[[], str | None]
    version: Callable[[], str]
    load: Callable[[], Find]
    raw: bool = False
    board: tuple[int, int] | None = None


def lattice(size: tuple[int, int]) -> Array:
    """Labels (columns·rows, 2) of a whole board, row by row."""
    return np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)


def not_installed(*modules: str) -> str | None:
    """The pip command that would help if one of `modules` can't be imported. None of them is loaded."""
    if all(find_spec(name) is not None for name in modules):
        return None
    return "not installed: pip install 'rcdn-lab[peers]'"


def version_of(package: str) -> str:
    """Version of an installed distribution, or `?`."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "?"


@contextmanager
def quiet() -> Iterator[None]:
    """Standard output to nowhere, that of libraries in other languages as well."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
