"""Throughput and memory of `rcdn detect` over a folder of pictures, run in a fresh process."""

from __future__ import annotations

import csv
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.io import write_image
from rcdn.synthetic import ORDINARY, random_scene, render

Row = dict[str, Any]
SEED = 9_200_000
SIZE = (640, 480)
DISTINCT = 50
"""most pictures rendered; the others are copies of them, because no detector caches results"""
KEPT = 500
"""most samples of a run that are kept"""


def fill(folder: Path, count: int) -> None:
    """Write `count` rendered pictures of boards under ordinary conditions, 640×480, to `folder`."""
    rendered: list[Path] = []
    for k in range(count):
        path = folder / f"picture_{k:06d}.png"
        if k < DISTINCT:
            write_image(path, render(random_scene(np.random.default_rng((SEED, k)), ORDINARY, SIZE), samples=2))
            rendered.append(path)
        else:
            _again(rendered[k % DISTINCT], path)


def _again(source: Path, path: Path) -> None:
    """The same picture under another name, as a hard link where the file system supports it."""
    try:
        os.link(source, path)
    except OSError:  # hard links are not supported, or there are too many
        shutil.copyfile(source, path)


def watch(
    command: Sequence[str], jobs: Sequence[int], count: int, describe: Callable[[str], None] | None = None
) -> Row:
    """Run `command` FOLDER JOBS SAMPLES over `count` pictures with each number of `jobs`.

    It writes a line `seconds,pictures,now MB,peak MB` to the file SAMPLES after each picture. Returns `rows`, one for
    each number of jobs, and their `samples`. Raises RcdnError if it fails.
    """
    rows, samples = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "pictures"
        folder.mkdir()
        if describe:
            describe(f"rendering {count} pictures")
        fill(folder, count)
        for many in jobs:
            if describe:
                describe(f"{count} pictures, {many} jobs")
            seen = Path(name) / f"samples_{many}.csv"
            start = time.perf_counter()
            done = subprocess.run(
                [*command, str(folder), str(many), str(seen)], capture_output=True, text=True, check=False
            )
            seconds = time.perf_counter() - start
            if done.returncode:
                raise RcdnError(f"--folder: rcdn detect failed: {done.stderr.strip()[-300:]}")
            lines = read_samples(seen)
            rows.append(folder_row(lines, many, count, seconds) | {"first process, peak MB": _end(seen)})
            samples += [{"jobs": many} | line for line in thinned(lines)]
    return {"rows": rows, "samples": samples}


def read_samples(path: Path) -> list[Row]:
    """The lines written by the command."""
    with path.open(newline="") as handle:
        return [
            {
                "seconds": float(line[0]), "pictures": int(line[1]),
                "now MB": float(line[2]) if line[2] else None, "peak MB": float(line[3]) if line[3] else None,
            }
            for line in csv.reader(handle)
        ]  # fmt: skip


def _end(seen: Path) -> float | None:
    """The value that the command wrote when it ended: the maximum memory of its first process, including the writing of
    files."""
    path = seen.with_suffix(".end")
    text = path.read_text() if path.exists() else ""
    return round(float(text), 1) if text else None


def thinned(lines: Sequence[Row], most: int = KEPT) -> list[Row]:
    """At most `most` of the lines, evenly spaced over the run; the first and the last are kept."""
    if len(lines) <= most:
        return list(lines)
    return [lines[k] for k in np.linspace(0, len(lines) - 1, most).round().astype(int).tolist()]


def folder_row(lines: Sequence[Row], jobs: int, count: int, seconds: float) -> Row:
    """`a second`: over the whole run including its start; `steady a second`: from a tenth of the pictures on.

    `ms, first half` and `second half`: time per picture from a tenth of them to the middle, and from there on: equal if
    time is linear. MB, all processes together: `peak`; `at 10 %` and `at the end` of the pictures: memory that grows
    between them would continue to grow.
    """
    if len(lines) != count:
        raise RcdnError(f"--folder: {len(lines)} of {count} pictures were seen")
    early, middle, late = lines[len(lines) // 10], lines[len(lines) * 11 // 20], lines[-1]
    between = late["seconds"] - early["seconds"]
    pictures = late["pictures"] - early["pictures"]
    peaks = [line["peak MB"] for line in lines if line["peak MB"] is not None]
    return {
        "pictures": count, "jobs": jobs, "cores": os.cpu_count(), "seconds": round(seconds, 2),
        "a second": round(count / seconds, 2),
        "steady a second": round(pictures / between, 2) if between > 0 else None,
        "ms, first half": _each(early, middle), "ms, second half": _each(middle, late),
        "MB at 10 %": early["now MB"], "MB at the end": late["now MB"], "peak MB": max(peaks, default=None),
    }  # fmt: skip


def _each(start: Row, end: Row) -> float | None:
    """ms per picture between two lines."""
    pictures = end["pictures"] - start["pictures"]
    return round(1e3 * (end["seconds"] - start["seconds"]) / pictures, 2) if pictures else None
