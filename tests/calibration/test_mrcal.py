"""The same corners.vnl through mrcal: cameras within the uncertainty, and the same projection uncertainty."""

import json
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate, projection_uncertainty
from rcdn.calibration.bundle import Corners3, State, residuals
from rcdn.calibration.solver import solve
from rcdn.calibration.uncertainty import Clustered, covariance
from rcdn.io import ImageResult, write_vnl
from rcdn.types import Board, Corners
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards

MRCAL = shutil.which("mrcal-calibrate-cameras")
CODE = """
import json, sys, mrcal, numpy as np
model = mrcal.cameramodel(sys.argv[1])
rays = mrcal.unproject(np.array(json.loads(sys.argv[2])), *model.intrinsics(), normalize=True)
std = mrcal.projection_uncertainty(rays, model, atinfinity=True, what="rms-stdev")
print(json.dumps({"intrinsics": model.intrinsics()[1].tolist(), "std": std.tolist()}))
"""
PIXELS = [[320.0, 240.0], [100, 100], [320, 60], [560, 400], [480, 240]]


def by_noise(found):
    """`found` with the covariance by the noise of single corners, which is what mrcal states."""
    frame = np.repeat(np.arange(len(found.views)), [len(v) for v in found.views])
    ij, xy = (np.concatenate([getattr(v, name) for v in found.views]) for name in ("ij", "xy"))
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 0)))
    state = State.mono(found.camera, np.array([v.pose.T_cam_board for v in found.views]))
    done = solve(state, corners, np.full(len(frame), 1 / found.noise))
    gaps = residuals(done.state, corners) / found.noise
    scale = (gaps**2).sum() / (2 * len(frame) - 6 * len(found.views) - len(found.std))
    cov = covariance(done.arrow, np.arange(len(found.views)), scale, Clustered(scale * done.arrow.covariance, 1.0))
    return replace(found, camera=done.state.cameras[0], cov=cov)


@pytest.mark.skipif(MRCAL is None, reason="mrcal isn't installed (Debian: apt install mrcal)")
@pytest.mark.parametrize("model", ["pinhole", "brown"])
def test_camera_and_uncertainty_are_those_of_mrcal(tmp_path, model):
    camera = CAMERAS[model]
    boards, _ = random_boards(camera, 3, views=15, noise=0.3, whole=True)
    plain = [Board(b.xy, b.ij, b.image_size, b.response, b.status, "unique") for b in boards]
    results = [
        ImageResult(f"view{k:02d}.png", *camera.image_size, Corners(np.zeros((0, 2)), [], []), (b,))
        for k, b in enumerate(plain)
    ]
    write_vnl(tmp_path / "corners.vnl", results, (9, 6))
    for r in results:
        (tmp_path / r.path).touch()
    ours = by_noise(calibrate(plain, SPACING, model=model, flat=True))
    lens = {"pinhole": "LENSMODEL_PINHOLE", "brown": "LENSMODEL_OPENCV5"}[model]
    words = (
        f"{MRCAL} --corners-cache corners.vnl --lensmodel {lens} --focal 500 --imagersize 640 480 --object-spacing "
        f"{SPACING} --object-width-n 9 --object-height-n 6 --outdir . --skip-calobject-warp-solve "
        "--skip-regularization --skip-outlier-rejection view*.png"
    )
    # its own Python, not that of a virtual environment
    env = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    subprocess.run(words.split(), cwd=tmp_path, check=True, capture_output=True, env=env, timeout=120)
    command = ["/usr/bin/python3", "-c", CODE, "camera-0.cameramodel", json.dumps(PIXELS)]
    output = subprocess.run(
        command, cwd=tmp_path, check=True, capture_output=True, text=True, env=env, timeout=60
    ).stdout
    theirs = json.loads(output)
    gap = (ours.camera.parameters - theirs["intrinsics"]) / ours.std
    assert np.abs(gap).max() < 0.05  # the weights are the same but for the boards' order
    # mrcal takes the residuals' mean square for the noise; ours counts what the unknowns took out of it
    corners, unknowns = sum(len(b) for b in boards), 6 * len(boards) + len(ours.std)
    freedom = np.sqrt(2 * corners / (2 * corners - unknowns))
    assert projection_uncertainty(ours, PIXELS) == pytest.approx(freedom * np.array(theirs["std"]), rel=0.02)
