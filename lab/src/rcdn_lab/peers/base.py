"""The interface of every peer: a name, the input that it needs, and a function from a picture to grids."""

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
    """A board returned by any detector.

    `xy` (N, 2) px, pixel (0, 0) the centre of the top-left pixel; `ij` (N, 2) column and row, or None without labels
    (raw corners); `sigma` (N,) standard deviation, px, or None.
    """

    xy: Array
    ij: Array | None = None
    sigma: Array | None = None


Find = Callable[[Array, tuple[int, int]], list[Grid]]
"""(H, W) uint8 and the board's size (columns, rows) in inner corners, which a peer of size `free` ignores → grids"""


@dataclass(frozen=True)
class Peer:
    """Another detector. `load` makes it, once per process, and may be slow; it does not raise if `missing` returns
    None.

    `size`: `given` if it needs the board's size; `missing`: the reason why it cannot run here, or None; `raw`: it
    returns corners without boards; `board`: the only size (columns, rows) that it supports, None for any.
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
    """The pip command that installs the peers if one of `modules` cannot be imported. None of them is loaded."""
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
    """Discard standard output in this context, including that of libraries in other languages."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is no standard output
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
