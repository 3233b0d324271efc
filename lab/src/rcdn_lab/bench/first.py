"""Start-up times until the first picture is processed, and the memory for one picture, always in fresh processes."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array
from rcdn_lab.bench.child import Broken, Child
from rcdn_lab.bench.pictures import rendered
from rcdn_lab.bench.run import PROGRAMS, Contestant

Size = tuple[int, int]
Row = dict[str, Any]
OURS = """
import json, sys, time
t = [time.perf_counter()]
import rcdn
t.append(time.perf_counter())
detector = rcdn.Detector()
t.append(time.perf_counter())
import numpy
image = numpy.load(sys.argv[1])
for _ in range(2):
    t.append(time.perf_counter())
    detector.boards(image)
    t.append(time.perf_counter())
print(json.dumps([t[1] - t[0], t[2] - t[1], t[4] - t[3], t[6] - t[5]]))
"""
OPENCV = """
import json, sys, time
t = [time.perf_counter()]
import cv2
t.append(time.perf_counter())
import numpy
image = numpy.load(sys.argv[1])
size = int(sys.argv[2]), int(sys.argv[3])
for _ in range(2):
    t.append(time.perf_counter())
    cv2.findChessboardCornersSB(image, size, flags=0)
    t.append(time.perf_counter())
print(json.dumps([t[1] - t[0], 0.0, t[3] - t[2], t[5] - t[4]]))
"""
SCRIPTS = {"rcdn": OURS, "opencv-sb": OPENCV}
STEPS = ("import ms", "make ms", "first ms", "second ms")


def first_calls(board: Size, count: int, size: Size = (640, 480)) -> list[Row]:
    """A row for rcdn and for the yardstick: medians over `count` fresh interpreters, alternating, with default
    settings.

    `import ms`: of the package; `make ms`: of the detector, with all that it loads; then the first detection and the
    second, of a board in a picture of `size`.
    """
    found: dict[str, list[list[float]]] = {name: [] for name in SCRIPTS}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.npy"
        np.save(path, rendered("board", size, board))
        for _ in range(count):
            for name, script in SCRIPTS.items():
                found[name].append(_steps(script, [str(path), *map(str, board)]))
    rows: list[Row] = []
    for name, times in found.items():
        steps = 1e3 * np.median(np.array(times), axis=0)
        row: Row = {"detector": name, "size": f"{size[0]}x{size[1]}", "processes": count}
        row |= {step: round(float(v), 1) for step, v in zip(STEPS, steps, strict=True)}
        rows.append(row | {"to first board ms": round(float(1e3 * np.median([sum(t[:3]) for t in times])), 1)})
    return rows


def _steps(script: str, arguments: list[str]) -> list[float]:
    done = subprocess.run([sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RcdnError(f"first call: a fresh interpreter failed: {done.stderr.strip()[-300:]}")
    values: list[float] = json.loads(done.stdout)
    return values


def memory(
    sizes: Sequence[Size],
    board: Size,
    who: Sequence[Contestant],
    threads: int,
    describe: Callable[[str], None] | None = None,
) -> list[Row]:
    """A row for each detector and size: one detection of a board in a fresh process.

    MB: `loaded`, resident memory before the picture; `peak`, its maximum until the picture is done; `more`, their
    difference. None if the operating system does not report it, or if a peer is an external program.
    """
    rows: list[Row] = []
    for size in sizes:
        if describe:
            describe(f"memory, {size[0]}x{size[1]}")
        images = {b: rendered("board", size, b) for b in dict.fromkeys(c.board or board for c in who)}
        for contestant in who:
            row: Row = {"detector": contestant.name, "size": f"{size[0]}x{size[1]}", "threads": threads}
            rows.append(row | _taken(contestant, images[contestant.board or board], contestant.board or board, threads))
    return rows


def _taken(contestant: Contestant, image: Array, board: Size, threads: int) -> Row:
    blank: Row = {"loaded MB": None, "peak MB": None, "more MB": None, "note": ""}
    runner = contestant.start(threads)
    if contestant.name in PROGRAMS or not isinstance(runner, Child):
        return blank | {"note": "a program of its own"}
    try:
        with runner:
            runner.time(image, board)
            taken = runner.memory()
    except Broken as error:
        return blank | {"note": f"failed: {error}"}
    if taken is None:
        return blank | {"note": "needs Linux"}
    more = max(0.0, taken.peak - taken.before)
    values = {"loaded MB": taken.before, "peak MB": taken.peak, "more MB": more}
    return {name: round(value, 1) for name, value in values.items()} | {"note": ""}
