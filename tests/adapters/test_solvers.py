"""docs/adapters.md with the real programs, on rendered pictures of known cameras:
focal lengths and baselines come out right."""

import importlib.util
import json
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.adapters.rig_pictures import BASELINE, FOCAL, pictures
from tests.doc_blocks import blocks, commands, run

from rcdn.io import read_camera

PAGE = "docs/adapters.md"
START, *_ = blocks(PAGE, "python")
MRCAL, MULTICAL = shutil.which("mrcal-calibrate-cameras"), shutil.which("multical")


def code_with(word):
    """The one block of the page that imports `word`."""
    (code,) = [block for block in blocks(PAGE, "python") if f"import {word}" in block or f"from {word}" in block]
    return code


def needs(package):
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} isn't installed (pip install {package}; python -m tests.environments {package})")


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A folder with what both cameras saw."""
    folder = tmp_path_factory.mktemp("rig")
    for side, taken in zip(("left", "right"), pictures(14), strict=True):
        (folder / side).mkdir()
        for k, picture in enumerate(taken):
            cv2.imwrite(str(folder / side / f"{k:03d}.png"), picture)
    return folder


def output_of(folder, code, answer, python=sys.executable):
    """What the expression `answer` is after `code`, in a process of its own."""
    done = subprocess.run(
        [python, "-c", f"{code}\nimport json\nprint(json.dumps({answer}))"],
        cwd=folder, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_lensboy(rig):
    needs("lensboy")
    camera = "result.camera_model"
    answer = f"[{camera}.fx, {camera}.fy, {camera}.cx, {camera}.cy]"
    assert output_of(rig, START + code_with("lensboy"), answer) == pytest.approx(
        [FOCAL[0], FOCAL[0], 322, 236], abs=0.1
    )


def test_aniposelib(rig):
    """Within 1 %: it holds the principal point in the middle of the picture and has one coefficient of distortion."""
    needs("aniposelib")
    answer = "[[c.get_focal_length(), c.get_extrinsics_mat().tolist()] for c in group.cameras]"
    (one, first), (two, second) = output_of(rig, START + code_with("aniposelib"), answer)
    assert [one, two] == pytest.approx(FOCAL, rel=0.01)
    between = np.array(second) @ np.linalg.inv(first)
    assert np.linalg.norm(between[:3, 3]) == pytest.approx(BASELINE, rel=0.02)


def test_caliscope(rig):
    needs("caliscope")
    found = "volume.camera_array.cameras.values()"
    answer = f"[[c.matrix[0, 0], c.matrix[1, 1], *c.translation.tolist()] for c in {found}]"
    first, second = np.array(output_of(rig, START + code_with("caliscope"), answer))
    assert [*first[:2], *second[:2]] == pytest.approx(np.repeat(FOCAL, 2), abs=0.1)
    assert np.linalg.norm(second[2:]) == pytest.approx(BASELINE, abs=2e-4)
    assert np.linalg.norm(first[2:]) == pytest.approx(0, abs=2e-4)


@pytest.mark.skipif(MULTICAL is None, reason="multical isn't installed (python -m tests.environments multical)")
def test_multical(rig):
    """In the environment that the command `multical` belongs to; the corners come as files."""
    for words in commands(PAGE)[:2]:
        run(rig, "-m", *words)
    calibration = "workspace.latest_calibration"
    answer = f"[[c.intrinsic[0, 0] for c in {calibration}.cameras], {calibration}.camera_poses.poses.tolist()]"
    python = Path(MULTICAL).parent / "python"
    focal, poses = output_of(rig, code_with("multical"), answer, str(python))
    assert focal == pytest.approx(FOCAL, abs=0.1)
    between = np.array(poses[1]) @ np.linalg.inv(poses[0])
    assert np.linalg.norm(between[:3, 3]) == pytest.approx(BASELINE, abs=2e-4)


@pytest.mark.skipif(MRCAL is None, reason="mrcal isn't installed (Debian: apt install mrcal)")
def test_mrcal(tmp_path):
    run(tmp_path, "-m", "rcdn", "render", "photos", "--one-camera", "--count", "20")
    detect, convert = commands(PAGE)[2:]
    run(tmp_path, "-m", *detect)
    (line,) = [line for block in blocks(PAGE, "") for line in block.splitlines() if line.startswith("mrcal-")]
    # its own Python, not that of a virtual environment
    env = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    subprocess.run(shlex.split(line), cwd=tmp_path, check=True, capture_output=True, env=env, timeout=120)
    run(tmp_path, "-m", *convert)
    truth = json.loads((tmp_path / "photos" / "scene_000001.json").read_text())["scene"]
    found = read_camera(tmp_path / "camera.yaml")
    assert [found.K[0, 0], found.K[1, 1]] == pytest.approx([truth["focal"]] * 2, abs=0.1)
    assert found.K[:2, 2] == pytest.approx(truth["centre"], abs=0.1)
