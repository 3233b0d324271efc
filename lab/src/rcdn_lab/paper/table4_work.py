"""What takes long in Table 4, shared out over processes: rendering pictures, and looking for boards in them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

from rcdn.config import DetectorConfig
from rcdn.io import write_image
from rcdn.synthetic import Scene, render
from rcdn_lab.calibration.detectors import Contestant, Store, contestants
from rcdn_lab.share_out import share_out

Step = Callable[[int, int], None]
"""called with what is done and all there is to do"""
Drawing = tuple[Scene, Path]
"""what to render, and where to"""
Look = tuple[Path, tuple[int, int]]
"""a picture, and the size (columns, rows) of its board"""

_detectors: list[Contestant] = []
"""Those of this process."""


def draw(drawings: Sequence[Drawing], workers: int, step: Step | None = None) -> None:
    """Render all pictures into their files."""
    for _ in share_out(_draw, drawings, workers, _nothing, (), step):
        pass


def _draw(task: Drawing) -> None:
    scene, path = task
    write_image(path, render(scene))


def _nothing() -> None:
    pass


def fill(
    pictures: Sequence[Look],
    names: Sequence[str],
    identify: Callable[[DetectorConfig], str],
    open_store: Callable[[str], Store],
    workers: int,
    step: Step | None = None,
) -> None:
    """Have the detectors `names` look at all pictures, so that their answers are in the store; `identify`, `open_store` as in `contestants`.

    What breaks down isn't kept and is asked again afterwards, as is everything where the store can't be written.
    """
    for _ in share_out(_look, pictures, workers, _load, (tuple(names), identify, open_store), step):
        pass
    _detectors.clear()


def _load(
    names: tuple[str, ...], identify: Callable[[DetectorConfig], str], open_store: Callable[[str], Store]
) -> None:
    _detectors[:] = contestants(names, identify, open_store)[0]


def _look(task: Look) -> None:
    path, size = task
    content = hashlib.sha256(path.read_bytes()).hexdigest()
    for detector in _detectors:
        detector.look(path, content, size)
