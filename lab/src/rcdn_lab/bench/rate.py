"""Arithmetic throughput of the dense network of the preset `paper`, relative to the processor's peak, measured by
matrix products."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from rcdn.children import end_with_parent
from rcdn_lab.bench.child import limited
from rcdn_lab.bench.pictures import rendered

Row = dict[str, Any]
Task = tuple[float, Callable[[], Any]]
"""number of operations, and the function that performs them"""
NETWORK = "network, preset paper"
SIZE = (640, 480)
SIDES = (1024, 2048)
"""sides of the square matrices; the faster product defines the peak"""
ROUNDS = 20
"""least number of rounds"""


def rate(count: int) -> list[Row]:
    """The rows of `rates`, on one thread in a separate process: the network on a board of `SIZE`, and products of
    float32 matrices of `SIDES`.

    `count`: number of rounds, at least `ROUNDS`.
    """
    with limited(1), ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        return pool.submit(_measured, max(count, ROUNDS)).result()


def _measured(count: int) -> list[Row]:
    return rates(tasks(SIZE, SIDES), count)


def tasks(size: tuple[int, int], sides: tuple[int, ...]) -> dict[str, Task]:
    """The network first, then the products, by name.

    Only the network's multiplications and additions for pixels of the picture count, not those for the context of its
    tiles, nor other operations; its time is that of the whole response map, including normalisation, padding and
    tiling.
    """
    from rcdn.corners.response import load_model

    model, image = load_model("paper"), rendered("board", size, (9, 6))
    out: dict[str, Task] = {NETWORK: (2.0 * model.facts["mac_per_pixel"] * image.size, lambda: model(image, 1))}
    rng = np.random.default_rng(0)
    for side in sides:
        a, b = rng.standard_normal((2, side, side), np.float32)
        room = np.empty((side, side), np.float32)
        out[f"matrix product, {side}"] = (
            2.0 * side**3,
            lambda a=a, b=b, room=room: np.matmul(a, b, out=room),  # type: ignore[misc]
        )
    return out


def rates(todo: Mapping[str, Task], count: int, clock: Callable[[], float] = time.perf_counter) -> list[Row]:
    """A row for each task; the first is compared with the fastest of the others.

    Each is run once to warm up, then `count` rounds, all of them once in each round in a new order. `GFLOP`: 1e9
    operations; `ms` and `GFLOP/s`: medians; `at best`: the highest GFLOP/s; `of peak`: median over the rounds of the
    ratio of GFLOP/s to the peak's, `from` and `to` its quartiles. The peak is the product with the highest median.
    """
    names = list(todo)
    for _, work in todo.values():
        work()
    rng = np.random.default_rng(0)
    seconds = np.empty((count, len(names)))
    for number in range(count):
        for column in rng.permutation(len(names)).tolist():
            start = clock()
            todo[names[column]][1]()
            seconds[number, column] = clock() - start
    done = np.array([todo[name][0] for name in names]) / 1e9
    speed = done / seconds
    peak = 1 + int(np.argmax(np.median(speed[:, 1:], axis=0)))
    low, middle, high = np.percentile(speed / speed[:, [peak]], [25, 50, 75], axis=0)
    return [
        {
            "task": name, "GFLOP": round(float(done[k]), 3), "ms": round(1e3 * float(np.median(seconds[:, k])), 3),
            "GFLOP/s": round(float(np.median(speed[:, k])), 2), "at best": round(float(speed[:, k].max()), 2),
            "of peak": round(float(middle[k]), 3), "from": round(float(low[k]), 3), "to": round(float(high[k]), 3),
            "rounds": count,
        }
        for k, name in enumerate(names)
    ]  # fmt: skip
