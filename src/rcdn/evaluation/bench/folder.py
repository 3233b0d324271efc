"""Pictures a second, and memory along the way, over a folder: `rcdn detect` itself in a fresh process, watched."""

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
"""pictures rendered, at most; after these come copies of them: no detector remembers any"""


def fill(folder: Path, count: int) -> None:
    """`count` rendered pictures of boards, as people take them, 640×480."""
    rendered: list[Path] = []
    for k in range(count):
        path = folder / f"picture_{k:06d}.png"
        if k < DISTINCT:
            write_image(path, render(random_scene(np.random.default_rng((SEED, k)), ORDINARY, SIZE), samples=2))
            rendered.append(path)
        else:
            shutil.copyfile(rendered[k % DISTINCT], path)


def watch(command: Sequence[str], jobs: Sequence[int], count: int, tell: Callable[[str], None] | None = None) -> Row:
    """Run `command` FOLDER JOBS SAMPLES over `count` pictures with each number of `jobs`.

    It writes a line `seconds,pictures,now MB,peak MB` to the file SAMPLES as each picture is done. Gives `rows`, one for
    each number of jobs, and their `samples`. Raises RcdnError if it fails.
    """
    rows, samples = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "pictures"
        folder.mkdir()
        if tell:
            tell(f"rendering {count} pictures")
        fill(folder, count)
        for many in jobs:
            if tell:
                tell(f"{count} pictures, {many} jobs")
            seen = Path(name) / f"samples_{many}.csv"
            start = time.perf_counter()
            done = subprocess.run(
                [*command, str(folder), str(many), str(seen)], capture_output=True, text=True, check=False
            )
            seconds = time.perf_counter() - start
            if done.returncode:
                raise RcdnError(f"--folder: rcdn detect failed: {done.stderr.strip()[-300:]}")
            lines = read_samples(seen)
            rows.append(folder_row(lines, many, count, seconds))
            samples += [{"jobs": many} | line for line in lines]
    return {"rows": rows, "samples": samples}


def read_samples(path: Path) -> list[Row]:
    """The lines that the command wrote."""
    with path.open(newline="") as handle:
        return [
            {
                "seconds": float(line[0]), "pictures": int(line[1]),
                "now MB": float(line[2]) if line[2] else None, "peak MB": float(line[3]) if line[3] else None,
            }
            for line in csv.reader(handle)
        ]  # fmt: skip


def folder_row(lines: Sequence[Row], jobs: int, count: int, seconds: float) -> Row:
    """`a second`: over the whole run with its start; `steady a second`: from a tenth of the pictures on.

    MB, all processes together: `peak`; `at 10 %` and `at the end` of the pictures: what grows between them would grow on.
    """
    if len(lines) != count:
        raise RcdnError(f"--folder: {len(lines)} of {count} pictures were seen")
    early, late = lines[len(lines) // 10], lines[-1]
    between = late["seconds"] - early["seconds"]
    pictures = late["pictures"] - early["pictures"]
    peaks = [line["peak MB"] for line in lines if line["peak MB"] is not None]
    return {
        "pictures": count, "jobs": jobs, "cores": os.cpu_count(), "seconds": round(seconds, 2),
        "a second": round(count / seconds, 2),
        "steady a second": round(pictures / between, 2) if between > 0 else None,
        "MB at 10 %": early["now MB"], "MB at the end": late["now MB"], "peak MB": max(peaks, default=None),
    }  # fmt: skip
