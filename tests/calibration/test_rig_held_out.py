"""Epipolar distances of moments that the cameras' places were solved without."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration import calibrate_rig
from rcdn.calibration.choose import FOLDS
from rcdn.calibration.epipolar import epipolar_gaps
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.rig_scenes import row

SCENE = row([0.25], ("pinhole",))
MOMENTS = 10


def rms(found, views, moments, names=("c0", "c1")):
    """Root mean square of the epipolar distances of these moments, px."""
    rig, parts = found.rig, []
    for m in moments:
        a, b = (views[n][m] for n in names)
        order = [np.lexsort(each.ij.T) for each in (a, b)]
        cameras = [rig.cameras[rig.index(n)] for n in names]
        parts.append(epipolar_gaps(*cameras, rig.relative(*names)[0], a.xy[order[0]], b.xy[order[1]]))
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def test_they_are_those_of_rigs_that_were_calibrated_without_these_moments():
    views, _ = SCENE.views(np.random.default_rng(3), [(0, 1)] * MOMENTS, noise=0.3)
    whole = calibrate_rig(views, SPACING, model="pinhole")
    order = sorted(range(MOMENTS), key=str)  # moments are dealt out in the order of their names
    squares = []
    for k in range(FOLDS):
        out = order[k::FOLDS]
        rest = {n: [b for m, b in enumerate(each) if m not in out] for n, each in views.items()}
        squares += [rms(calibrate_rig(rest, SPACING, model="pinhole"), views, out) ** 2] * len(out)
    (pair,) = whole.pairs
    assert pair.epipolar == pytest.approx(np.sqrt(np.mean(squares)), rel=0.02)
    assert pair.epipolar > 1.02 * rms(whole, views, range(MOMENTS))


def test_what_alone_connects_two_cameras_cannot_be_held_out():
    scene = row([0.25, 0.3], ("pinhole",))
    views, moments = scene.views(np.random.default_rng(0), [(0, 1)] * 8 + [(2, 2)] * 6)
    common = [m for m in moments["c2"] if m in moments["c0"] or m in moments["c1"]]
    when = [m if m == common[0] else f"late {m}" for m in moments["c2"]]
    found = calibrate_rig(views, SPACING, moments={**moments, "c2": when}, model="pinhole")
    assert found.thin == ("c2",)
    for pair in found.pairs:
        assert np.isnan(pair.epipolar) == ("c2" in (pair.first, pair.second))
