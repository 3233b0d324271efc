"""Draws docs/images/rig.png, a simulated rig as it was solved, from above: `python docs/images/draw_rig.py`."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.patches import Ellipse

from rcdn.calibration import calibrate_rig
from rcdn.types import Rig
from rcdn_lab.camera_scenes import SIZE, SPACING
from rcdn_lab.rigs import trials

mpl.use("Agg")
from matplotlib import pyplot as plt  # after the choice of Agg

OUT = Path(__file__).parent / "rig.png"
GREATER = 20
"""ellipses are drawn as many times larger"""


def centre_spread(rig: Rig, k: int) -> np.ndarray:
    """Covariance (3, 3) of a camera's centre in the rig's frame, m²."""
    assert rig.covariance is not None
    part = rig.covariance[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6]
    R = rig.poses[k].R
    return np.asarray(R.T @ part @ R)


def draw() -> None:
    """Cameras with their ellipses of three deviations, boards, and who saw how many boards together."""
    trial = trials()["row of 4"]
    scene, between = trial.scene, trial.between
    boards, moments = scene.views(np.random.default_rng(0), between)
    found = calibrate_rig(boards, SPACING, moments=moments, model={n: c.model for n, c in scene.cameras.items()})
    rig = found.rig
    figure, axes = plt.subplots(figsize=(9, 4.6))
    for T in found.boards.values():
        ends = np.array([T[:3, 3], T[:3, 3] + (SIZE[0] - 1) * SPACING * T[:3, 0]])
        axes.plot(ends[:, 0], ends[:, 2], color="#009e73", alpha=0.5, lw=2)
    centres = np.array([-p.R.T @ p.t for p in rig.poses])
    for row, pair in enumerate(sorted(found.pairs, key=lambda p: rig.index(p.second) - rig.index(p.first))):
        k, m = rig.index(pair.first), rig.index(pair.second)
        low = -0.3 if m == k + 1 else -0.3 - 0.17 * (row - len(rig) + 2)
        axes.plot([centres[k][0], centres[m][0]], [low, low], color="#999999", lw=1, marker="|")
        axes.annotate(f"{pair.used} boards", ((centres[k][0] + centres[m][0]) / 2, low - 0.08), ha="center", fontsize=9)
    for k, (name, pose) in enumerate(zip(rig.names, rig.poses, strict=True)):
        eye = np.array([[-0.12, 0, 0.2], [0, 0, 0], [0.12, 0, 0.2]]) @ pose.R + centres[k]
        axes.plot(eye[:, 0], eye[:, 2], color="#0072b2", lw=2)
        axes.annotate(name, (centres[k][0], centres[k][2] - 0.14), ha="center", fontweight="bold")
        spread, turn = np.linalg.eigh(centre_spread(rig, k)[np.ix_([0, 2], [0, 2])])
        wide, high = 2 * 3 * GREATER * np.sqrt(np.maximum(spread, 0))
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))
        axes.add_patch(Ellipse((centres[k][0], centres[k][2]), wide, high, angle=angle, fill=False, color="#d55e00"))
    axes.set(xlabel="x, m", ylabel="z, m", aspect="equal")
    axes.set_title(f"four cameras, frame of the first; ellipses: 3 deviations, {GREATER} times larger; green: boards")
    figure.savefig(OUT, dpi=80, bbox_inches="tight")


if __name__ == "__main__":
    draw()
