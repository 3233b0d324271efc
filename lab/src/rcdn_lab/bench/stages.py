"""Time of each stage for one picture: the stages' functions are wrapped from outside, at the places where they are
looked up."""

from __future__ import annotations

import functools
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from rcdn.children import end_with_parent
from rcdn.config import DetectorConfig
from rcdn.types import Array
from rcdn_lab.bench.child import limited
from rcdn_lab.bench.chosen import Photograph
from rcdn_lab.bench.pictures import rendered

Size = tuple[int, int]
Row = dict[str, Any]
STAGES = (
    ("views", "rcdn.pyramid:View.of"),
    ("views", "rcdn.pyramid:View.reduced"),
    ("sieve", "rcdn.corners.response:cells_with_saddles"),
    ("sieve", "rcdn.views:saddles_by_steepness"),
    ("response", "rcdn.corners.response:ResponseModel.__call__"),
    ("threshold", "rcdn.corners.maxima:threshold_value"),
    ("nms", "rcdn.corners.maxima:nms"),
    ("refine", "rcdn.corners:refine"),
    ("refine", "rcdn.corners.peaks:refine"),
    ("axes", "rcdn.corners.peaks:axes"),
    ("candidates, rest", "rcdn.views:find_maxima"),
    ("candidates, rest", "rcdn.views:candidates_at"),
    ("candidates, rest", "rcdn.corners.peaks:Peaks.evaluate"),
    ("boards", "rcdn.views:find_boards"),
    ("boards", "rcdn.views:find_boards_paper"),
    ("boards", "rcdn.views:count_cells"),
    ("views, compared", "rcdn.views:outside"),
    ("views, compared", "rcdn.views:unexplained"),
    ("views, compared", "rcdn.views:may_go_on"),
    ("views, compared", "rcdn.views:plainly_seen"),
    ("views, compared", "rcdn.views:shown_nearby"),
    ("views, compared", "rcdn.views:faint_cells"),
    ("views, compared", "rcdn.views:at_the_frame"),
    ("views, compared", "rcdn.views:Views._in_detail"),
    ("views, compared", "rcdn.views:closer_view"),
    ("views, compared", "rcdn.views:corners_in_picture"),
    ("views, compared", "rcdn.views:boards_in_picture"),
    ("views, compared", "rcdn.views:distinct_boards"),
    ("views, compared", "rcdn.views:distinct_corners"),
    ("views, compared", "rcdn.detector:distinct_boards"),
    ("views, compared", "rcdn.detector:distinct_corners"),
    ("codes", "rcdn.detector:Detector._identified"),
    ("sharpen, fit", "rcdn.precision:fit_corners"),
    ("sharpen, smooth", "rcdn.precision:smooth"),
    ("sharpen, rest", "rcdn.detector:sharpen"),
)
"""(stage, module:name); time in a stage called by another counts for the inner one only"""
REST = "rest"
SECONDS = 5.0
"""time limit for one photograph"""


class Clock:
    """Exclusive processor time of each stage, s, in a process with one thread."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self._inner = [0.0]

    def wrapped(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function`, with its time added to `stage`."""

        @functools.wraps(function)
        def timed(*arguments: Any, **named: Any) -> Any:
            self._inner.append(0.0)
            start = time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                whole = time.process_time() - start
                inner = self._inner.pop()
                self._inner[-1] += whole
                self.seconds[stage] = self.seconds.get(stage, 0.0) + whole - inner
                self.calls[stage] = self.calls.get(stage, 0) + 1

        return timed


@contextmanager
def watched(clock: Clock, stages: Sequence[tuple[str, str]] = STAGES) -> Iterator[list[str]]:
    """Wrap all stages for the `clock` in this context. Returns the functions that were not found."""
    absent = []
    with ExitStack() as stack:
        for stage, place in stages:
            module, _, name = place.partition(":")
            *path, last = name.split(".")
            try:
                owner = functools.reduce(getattr, path, import_module(module))
                function = getattr(owner, last)
            except (ImportError, AttributeError):
                function = None
            if not callable(function):  # removed, or replaced by a module of that name
                absent.append(place)
                continue
            stack.callback(setattr, owner, last, vars(owner)[last])
            setattr(owner, last, clock.wrapped(stage, function))
        yield absent


def stages(
    sizes: Sequence[Size],
    board: Size,
    preset: str,
    count: int,
    budget: float,
    describe: Callable[[str], None] | None = None,
) -> list[Row]:
    """One row for each picture and stage: our detector in one thread, medians of up to `count` runs within `budget` s.

    Multi-threaded runs are not split into stages, because their stages overlap.
    """
    rows = []
    with limited(1), ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        for size in sizes:
            for kind in ("board", "clutter", "texture"):
                if describe:
                    describe(f"stages, {kind} {size[0]}x{size[1]}")
                image = rendered(kind, size, board)
                head = {"picture": kind, "size": f"{size[0]}x{size[1]}", "preset": preset}
                rows += [head | row for row in pool.submit(stages_of, image, preset, count, budget).result()]
    return rows


CLASSES = (0.1, 0.5, 2.0)
"""megapixels that separate classes of photographs"""


def photograph_stages(
    pictures: Sequence[Photograph], preset: str, count: int, describe: Callable[[str], None] | None = None
) -> list[Row]:
    """One row for each class of photographs and stage: our detector in one thread; `ms/MP` over all of its `count`
    pictures together.

    Classes are defined by size and by whether there is a board; within one, each picture is weighted by its pixels.
    `calls`: per picture.
    """
    found: dict[str, list[tuple[float, list[Row]]]] = {}
    with limited(1), ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        for picture in sorted(pictures, key=lambda p: (p.is_empty, p.megapixels)):
            if describe:
                describe(f"stages, {picture.set}/{picture.file}")
            rows = pool.submit(stages_of, picture.image, preset, count, SECONDS).result()
            found.setdefault(class_of(picture), []).append((picture.megapixels, rows))
    return [{"preset": preset} | row for name, mine in found.items() for row in class_rows(name, mine)]


def class_of(picture: Photograph) -> str:
    """The class of a photograph, in words."""
    low = max((edge for edge in CLASSES if picture.megapixels >= edge), default=0.0)
    high = min((edge for edge in CLASSES if picture.megapixels < edge), default=None)
    return (
        f"{'no board' if picture.is_empty else 'boards'}, {low:g} MP "
        f"{'and more' if high is None else f'to {high:g} MP'}"
    )


def class_rows(name: str, mine: Sequence[tuple[float, list[Row]]]) -> list[Row]:
    """The rows of one class from those of its pictures, each with its megapixels."""
    area = sum(megapixels for megapixels, _ in mine)
    ms, calls = dict[str, float](), dict[str, int]()
    for stage, row in ((row["stage"], row) for _, rows in mine for row in rows):
        ms[stage] = ms.get(stage, 0.0) + row["ms"]
        calls[stage] = calls.get(stage, 0) + (row["calls"] or 0)
    names = sorted(ms, key=lambda stage: (stage == "whole", stage == REST))
    return [
        {
            "pictures": name, "count": len(mine), "stage": stage, "ms/MP": round(ms[stage] / area, 3),
            "share": round(ms[stage] / ms["whole"], 3), "calls": round(calls[stage] / len(mine), 2),
        }
        for stage in names
    ]  # fmt: skip


def stages_of(image: Array, preset: str, count: int, budget: float) -> list[Row]:
    """Rows of one picture (H, W): processor time `ms`, `share` of the total, and `calls`; the last row is the total
    itself.

    The stages and the rest add up to the total in every run; medians over several runs do so approximately. `note` of
    the last row lists functions that were not found.
    """
    import cv2

    from rcdn.detector import Detector

    cv2.setNumThreads(1)
    detector = Detector(DetectorConfig.preset(preset, threads=1))
    begin = time.perf_counter()
    detector.detect(image)
    runs: list[dict[str, float]] = []
    calls, absent = dict[str, int](), list[str]()
    while not runs or (len(runs) < count and time.perf_counter() - begin + runs[-1]["whole"] < budget):
        clock = Clock()
        with watched(clock) as lacking:
            start = time.process_time()
            detector.detect(image)
            whole = time.process_time() - start
        rest = whole - sum(clock.seconds.values())
        runs.append(clock.seconds | {REST: rest, "whole": whole})
        calls, absent = clock.calls, lacking
    names = [name for name in dict.fromkeys([stage for stage, _ in STAGES] + [REST, "whole"]) if name in runs[0]]
    medians = {name: float(np.median([run[name] for run in runs])) for name in names}
    return [
        {
            "stage": name, "ms": round(1e3 * medians[name], 3), "share": round(medians[name] / medians["whole"], 3),
            "calls": calls.get(name), "repeats": len(runs),
            "note": f"not found: {', '.join(absent)}" if name == "whole" and absent else "",
        }
        for name in names
    ]  # fmt: skip
