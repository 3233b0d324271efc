"""Rigs of cameras, simulated: how far the places are off in their deviations, and what a solution takes."""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import combinations
from multiprocessing import get_context
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig
from rcdn.types import Array, RigCalibration
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.rig_scenes import Scene, chain, clusters, joined, outwards, room, row

Between = list[tuple[int, int]]
LARGE = 8
"""cameras from which on a rig is drawn an eighth as often"""


@dataclass(frozen=True, eq=False)
class Trial:
    """A rig, where its boards are, and by name the cameras that get only so many of their pictures, the last ones."""

    scene: Scene
    between: Between
    most: Mapping[str, int] = field(default_factory=dict)


def trials(large: bool = False) -> dict[str, Trial]:
    """Rigs by name; `large`: the one of 16 cameras and 512 moments alone."""
    if large:
        return {"16 around a room, 512 moments": Trial(room(16), chain(16, 16, closed=True))}
    two = [(k, k) for k in range(4) for _ in range(6)]
    last = [(2, 2)] * 8 + [(1, 2)] * 3
    return {
        "two": Trial(row([0.2]), chain(2, 6)),
        "fisheye and pinhole": Trial(row([0.25, 0.25], ("fisheye", "pinhole")), chain(3, 6)),
        "row of 4": Trial(row([0.45] * 3), two + [(k, k + 1) for k in range(3) for _ in range(3)]),
        "one camera little seen": Trial(row([0.3, 0.45]), chain(2, 6) + last),
        "one camera in 3 pictures": Trial(row([0.3, 0.45]), chain(2, 6) + [(1, 2)] * 3, {"c2": 3}),
        "ring of 4, 10 % overlap": Trial(outwards(), chain(4, 5, closed=True)),
        "two clusters of 4": Trial(clusters(4), joined(4, 4)),
        "16 around a room": Trial(room(16), chain(16, 3, closed=True)),
    }


def run(trial: Trial, seed: int) -> tuple[RigCalibration, float, float]:
    """The rig of one draw of boards, and the CPU and wall seconds that solving took."""
    boards, moments = trial.scene.views(np.random.default_rng(seed), trial.between)
    for name, many in trial.most.items():
        boards[name], moments[name] = boards[name][-many:], moments[name][-many:]
    models = {name: camera.model for name, camera in trial.scene.cameras.items()}
    began = time.process_time(), time.perf_counter()
    found = calibrate_rig(boards, SPACING, moments=moments, model=models)
    return found, time.process_time() - began[0], time.perf_counter() - began[1]


def errors(found: RigCalibration, scene: Scene) -> Array:
    """(P, 6) how far each two cameras' relative pose is off, in its standard deviations."""
    rows = []
    for first, second in combinations(found.rig.names, 2):
        T, cov = found.rig.relative(first, second)
        D = scene.places[second] @ np.linalg.inv(scene.places[first]) @ np.linalg.inv(T)
        off = np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])
        rows.append(off / np.sqrt(np.diag(np.asarray(cov))))
    return np.array(rows)


def rows_of(name: str, trial: Trial, seeds: int) -> dict[str, Any]:
    """`row_of` in a process of its own, so that the memory is this rig's."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(row_of, name, trial, seeds).result()


def row_of(name: str, trial: Trial, seeds: int) -> dict[str, Any]:
    """The figures of one rig over `seeds` draws of its boards."""
    seeds = max(seeds // 8, 1) if len(trial.scene.cameras) >= LARGE else seeds
    runs = [run(trial, seed) for seed in range(seeds)]
    off = np.concatenate([errors(found, trial.scene).ravel() for found, *_ in runs])
    return {
        "rig": name,
        "cameras": len(trial.scene.cameras),
        "moments": len(trial.between),
        "rigs": seeds,
        "connected": sum(len(found.components) == 1 for found, *_ in runs),
        "numbers": len(off),
        "within_1": float((np.abs(off) < 1).mean()),
        "within_3": float((np.abs(off) < 3).mean()),
        "rms": float(np.mean([found.rms for found, *_ in runs])),
        "cpu_s": float(np.mean([cpu for _, cpu, _ in runs])),
        "wall_s": float(np.mean([wall for *_, wall in runs])),
        "memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
