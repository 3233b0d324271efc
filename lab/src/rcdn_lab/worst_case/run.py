"""CPU time per megapixel of pictures designed to be slow, relative to the median of photographs. Each in a process of
its own with a time limit."""

from __future__ import annotations

import math
import multiprocessing
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.config import DetectorConfig
from rcdn.errors import ConfigError
from rcdn.types import Array
from rcdn_lab.worst_case.checkers import screen
from rcdn_lab.worst_case.pictures import pictures

LEAST_MEGAPIXELS = 0.1
"""megapixels; smaller pictures count as this"""
GOAL = 10.0
"""× the median of the photographs"""
PATIENCE, OUT_OF_TIME = 10, 24
"""see `measured`; the number of the signal SIGXCPU"""
MOST_PHOTOGRAPHS = 100
"""most photographs of a folder, evenly spaced"""
PHOTOGRAPHS = "photographs, median"
Answer = dict[str, Any]


def table(
    photographs: Path,
    names: Sequence[str] = (),
    limit: float = 120.0,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """One row for the photographs in a folder, then one for each picture whose name contains one of `names` (empty:
    all), the slowest first.

    `limit`: seconds of computing after which a picture is aborted. Raises ConfigError if there are no photographs, or
    no picture has such a name.
    """
    chosen = [n for n in pictures() if not names or any(part in n for part in names)]
    if not chosen:
        raise ConfigError(f"--picture: no name contains {' or '.join(names)}; without it all pictures are measured")
    median_time = _median_time(photographs)
    rows = []
    for done, name in enumerate(chosen, start=1):
        rows.append(_row(name, measured(name, limit), median_time))
        if progress:
            progress(done, len(chosen))
    rows.sort(key=lambda row: -row["ratio"])
    return [_row(PHOTOGRAPHS, {"ms a megapixel": median_time}, median_time), *rows]


def settings_of(photographs: Path, limit: float) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "photographs": photographs.name, "most photographs": MOST_PHOTOGRAPHS, "limit s": limit, "threads": 1,
        "least megapixels": LEAST_MEGAPIXELS, "goal": GOAL,
    }  # fmt: skip


def _row(name: str, answer: Answer, median_time: float) -> dict[str, Any]:
    keys = ("width", "height", "ms a megapixel", "ratio", "boards", "largest", "corners", "warnings", "ended")
    ratio = round(answer["ms a megapixel"] / median_time, 2)
    rounded = round(answer["ms a megapixel"], 1)
    return {"picture": name} | dict.fromkeys(keys) | answer | {"ms a megapixel": rounded, "ratio": ratio}


def _median_time(folder: Path) -> float:
    """Median CPU time of photographs, ms per megapixel."""
    from rcdn.io import expand, is_video, read_image

    paths = [p for p in expand([str(folder)])[0] if not is_video(p)]
    if not paths:
        raise ConfigError(f"{folder}: there is no picture in this folder; name one with photographs")
    some = np.unique(np.linspace(0, len(paths) - 1, min(MOST_PHOTOGRAPHS, len(paths))).astype(int))
    detector = _warm()
    return statistics.median(_timed(detector, read_image(paths[k]))[0] for k in some.tolist())


def measured(name: str, limit: float) -> Answer:
    """Time and result of detection on the picture called `name`. After `limit` s of computing it is aborted, and counts
    as if it had just ended; the same after `PATIENCE` times as long by the clock."""
    context = multiprocessing.get_context("spawn")
    receive, send = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(name, limit, send), daemon=True)
    process.start()
    send.close()
    answer: Answer = {}
    try:
        answer = receive.recv()  # the picture's size, sent when it is drawn
        if receive.poll(PATIENCE * limit):
            return answer | receive.recv()
        return _given_up(answer, limit)
    except EOFError:
        process.join()
        if answer and process.exitcode == -OUT_OF_TIME:
            return _given_up(answer, limit)
        return answer | {"ms a megapixel": float("inf"), "ended": f"its process ended with {process.exitcode}"}
    finally:
        process.kill()
        process.join()


def _given_up(answer: Answer, limit: float) -> Answer:
    megapixels = max(answer["width"] * answer["height"] / 1e6, LEAST_MEGAPIXELS)
    return answer | {"ms a megapixel": 1e3 * limit / megapixels, "ended": f"given up after {limit:g} s"}


def _child(name: str, limit: float, send: Connection) -> None:
    image = pictures()[name]()
    detector = _warm()
    height, width = image.shape
    send.send({"width": width, "height": height})
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + limit), resource.RLIM_INFINITY))
    send.send(_answer(*_timed(detector, image)))


def _answer(time_taken: float, found: Any) -> Answer:
    sizes = [len(board) for board in found.boards]
    return {
        "ms a megapixel": time_taken, "boards": len(sizes), "largest": max(sizes, default=0),
        "corners": len(found.corners), "warnings": len(found.warnings), "ended": "done",
    }  # fmt: skip


def _warm() -> Any:
    """A detector that has loaded everything it needs."""
    import cv2

    from rcdn.detector import Detector

    cv2.setNumThreads(1)
    detector = Detector(DetectorConfig(threads=1))
    detector.detect(screen((240, 180), 9, 7))
    return detector


def _timed(detector: Any, image: Array) -> tuple[float, Any]:
    """CPU time, ms per megapixel, and the result."""
    start = time.process_time()
    found = detector.detect(image)
    return 1e3 * (time.process_time() - start) / max(image.size / 1e6, LEAST_MEGAPIXELS), found
