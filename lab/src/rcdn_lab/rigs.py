"""Rigs of cameras, simulated: how far the places are off in their deviations, and what a solution takes."""

from __future__ import annotations

import resource
import time
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


def scenes() -> dict[str, tuple[Scene, Between]]:
    """Rigs by name, and where their boards are."""
    two = [(k, k) for k in range(4) for _ in range(6)]
    last = [(2, 2)] * 8 + [(1, 2)] * 3
    return {
        "two": (row([0.2]), chain(2, 6)),
        "fisheye and pinhole": (row([0.25, 0.25], ("fisheye", "pinhole")), chain(3, 6)),
        "row of 4": (row([0.45] * 3), two + [(k, k + 1) for k in range(3) for _ in range(3)]),
        "one camera little seen": (row([0.3, 0.45]), chain(2, 6) + last),
        "two clusters of 4": (clusters(4), joined(4, 4)),
        "ring of 4, 10 % overlap": (outwards(), chain(4, 5, closed=True)),
        "16 around a room": (room(16), chain(16, 3, closed=True)),
    }


def run(scene: Scene, between: Between, seed: int) -> tuple[RigCalibration, float]:
    """The rig of one draw of boards, and the CPU seconds that solving took."""
    boards, moments = scene.views(np.random.default_rng(seed), between)
    models = {name: camera.model for name, camera in scene.cameras.items()}
    began = time.process_time()
    found = calibrate_rig(boards, SPACING, moments=moments, model=models)
    return found, time.process_time() - began


def errors(found: RigCalibration, scene: Scene) -> Array:
    """(C − 1, 6) how far each camera's place is off, in its standard deviations."""
    rows = []
    first = found.rig.names[0]
    for name in found.rig.names[1:]:
        T, cov = found.rig.relative(first, name)
        D = scene.places[name] @ np.linalg.inv(scene.places[first]) @ np.linalg.inv(T)
        off = np.concatenate([Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]])
        rows.append(off / np.sqrt(np.diag(np.asarray(cov))))
    return np.array(rows)


def row_of(name: str, scene: Scene, between: Between, seeds: int) -> dict[str, Any]:
    """The figures of one rig over `seeds` draws of its boards."""
    seeds = max(seeds // 8, 1) if len(scene.cameras) >= LARGE else seeds
    runs = [run(scene, between, seed) for seed in range(seeds)]
    off = np.concatenate([errors(found, scene).ravel() for found, _ in runs])
    return {
        "rig": name,
        "cameras": len(scene.cameras),
        "moments": len(between),
        "rigs": seeds,
        "connected": sum(len(found.components) == 1 for found, _ in runs),
        "numbers": len(off),
        "within_1": float((np.abs(off) < 1).mean()),
        "within_3": float((np.abs(off) < 3).mean()),
        "rms": float(np.mean([found.rms for found, _ in runs])),
        "cpu_s": float(np.mean([seconds for _, seconds in runs])),
        "memory_MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
