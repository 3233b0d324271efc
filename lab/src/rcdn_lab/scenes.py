"""Raw corners on rendered VGA scenes not used in training: precision and recall under each threshold (cf. Table 2)."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from rcdn.children import end_with_parent
from rcdn.config import Adaptive, DetectorConfig, Fixed, MaxFraction, Std
from rcdn.corners import find_candidates
from rcdn.corners.response import load_model
from rcdn.metrics import counted, match, within_radius
from rcdn.synthetic import ORDINARY, random_scene, render, truth
from rcdn.types import Array

FIRST = 7_000_000_000
RADIUS = 4.0
"""px; the paper's limit for a true corner (section 4.1)"""
BLIND = 8.0
"""px; detections this close to a corner that is neither demanded nor forbidden do not count"""
RULES: dict[str, Any] = {
    "0.5": Fixed(0.5),
    "std 0.8": Std(0.8),
    "0.41 max": MaxFraction(0.41),
    "adaptive": Adaptive(),
}
Counts = dict[str, tuple[int, int, int, int, int, float]]
"""row → detections, true ones by the paper's definition, true ones one to one, corners, fully correct pictures, sum of
distances"""


def rows() -> dict[str, DetectorConfig]:
    """The detectors compared: `paper` under each threshold of Table 2, and `auto`."""
    out = {f"paper, {name}": DetectorConfig.paper(threshold=rule, threads=1) for name, rule in RULES.items()}
    out["auto"] = DetectorConfig.auto(threads=1)
    return out


def score_scene(index: int) -> Counts:
    """Counts of one scene, for each detector."""
    scene = random_scene(np.random.default_rng(FIRST + index), ORDINARY)
    image = render(scene)
    boards = truth(scene)
    corners = np.concatenate([b.xy[b.visible] for b in boards])
    blind = np.concatenate([b.xy[b.ignore] for b in boards])
    maps: dict[str, Array] = {}
    out: Counts = {}
    for name, config in rows().items():
        if config.model not in maps:
            maps[config.model] = load_model(config.model)(image, 1)
        found = find_candidates(image, maps[config.model], config).corners.xy
        found = counted(found, corners, blind, RADIUS, BLIND)
        pairs, gaps = match(found, corners, RADIUS)
        right = len(pairs) == len(found) == len(corners)
        out[name] = (
            len(found),
            int(within_radius(found, corners, RADIUS).sum()),
            len(pairs),
            len(corners),
            int(right),
            float(gaps.sum()),
        )
    return out


def table(count: int = 300, workers: int = 2, progress: Callable[[int], None] | None = None) -> list[dict[str, Any]]:
    """One row for each detector: micro-averaged precision (by the paper's definition and one to one), recall, fully
    correct pictures, mean error of hits, px."""
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), end_with_parent) as pool:
        results: Iterable[Counts] = pool.map(score_scene, range(count), chunksize=4)
        total: dict[str, Array] = {name: np.zeros(6) for name in rows()}
        for done, result in enumerate(results, start=1):
            for name, values in result.items():
                total[name] += values
            if progress:
                progress(done)
    return [_row(name, values, count) for name, values in total.items()]


def _row(name: str, values: Array, count: int) -> dict[str, Any]:
    found, near, pairs, corners, whole, gap = values.tolist()
    return {
        "detector": name,
        "precision": round(near / max(found, 1), 4),
        "precision one-to-one": round(pairs / max(found, 1), 4),
        "recall": round(pairs / max(corners, 1), 4),
        "whole pictures": f"{int(whole)}/{count}",
        "mean error px": round(gap / max(pairs, 1), 3),
    }
