"""What a session asks of the guide, as protocols: `rcdn.calibration.guidance` meets them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from rcdn.types import Array, Board


class Look(Protocol):
    """What the guide says of one frame: `refused`, why it can't be taken ("" if it can); `hint`, what to do next; `take` it now; `fit`
    0 to 1, how near the board is to where it is wanted; `arrow` ((x, y), (x, y)) px from where it is to where it should be."""

    @property
    def refused(self) -> str: ...
    @property
    def hint(self) -> str: ...
    @property
    def take(self) -> bool: ...
    @property
    def fit(self) -> float: ...
    @property
    def arrow(self) -> Any: ...


class Wanted(Protocol):
    """Where the board is wanted: `outline` (4, 2) px of its outermost corners, in order around."""

    @property
    def outline(self) -> Array: ...


class Progress(Protocol):
    """How far it has come: the names of the `views`; the `wanted` pose; a `sentence`; `worst` px uncertainty over the frame (infinite before
    there is a camera) and the `target` for it; its `map` (rows, cols) px; `done`: it is enough."""

    @property
    def views(self) -> tuple[str, ...]: ...
    @property
    def wanted(self) -> Wanted | None: ...
    @property
    def sentence(self) -> str: ...
    @property
    def worst(self) -> float: ...
    @property
    def target(self) -> float: ...
    @property
    def map(self) -> Array | None: ...
    @property
    def done(self) -> bool: ...


class Guide(Protocol):
    """`look` is quick and called for each frame in order; `add` and `remove` are slow, and called by another thread meanwhile."""

    def look(self, board: Board | None, time: float, grey: Array | None = None) -> Look: ...
    def add(self, board: Board, name: str) -> Progress: ...
    def add_all(self, boards: Mapping[str, Board]) -> Progress: ...
    def remove(self, name: str) -> Progress: ...
    @property
    def progress(self) -> Progress: ...


MakeGuide = Callable[[tuple[int, int], float], Guide]
"""a guide for pictures of a size (width, height) px and squares of a side, m"""
