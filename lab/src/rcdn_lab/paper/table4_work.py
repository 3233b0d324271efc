"""The time-consuming parts of Table 4, distributed over processes: rendering pictures, and detecting boards in them."""

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
"""called with the number of tasks done and in total"""
Drawing = tuple[Scene, Path]
"""a scene to render, and its file"""
SizedPicture = tuple[Path, tuple[int, int]]
"""a picture, and the size (columns, rows) of its board"""

_detectors: list[Contestant] = []
"""The detectors of this process."""


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
    pictures: Sequence[SizedPicture],
    names: Sequence[str],
    identify: Callable[[DetectorConfig], str],
    open_store: Callable[[str], Store],
    workers: int,
    step: Step | None = None,
) -> None:
    """Run the detectors `names` on all pictures, so that their results are in the store; `identify`, `open_store` as in
    `contestants`.

    Failures are not stored and are repeated later, as is everything if the store cannot be written.
    """
    for _ in share_out(_detect, pictures, workers, _load, (tuple(names), identify, open_store), step):
        pass
    _detectors.clear()


def _load(
    names: tuple[str, ...], identify: Callable[[DetectorConfig], str], open_store: Callable[[str], Store]
) -> None:
    _detectors[:] = contestants(names, identify, open_store)[0]


def _detect(task: SizedPicture) -> None:
    path, size = task
    content = hashlib.sha256(path.read_bytes()).hexdigest()
    for detector in _detectors:
        detector.result(path, content, size)
