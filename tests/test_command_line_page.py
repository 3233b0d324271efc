"""docs/command-line.md: every verb has an example there, and every example runs."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from rcdn.cli import app
from rcdn.io import read_camera, read_detections, read_pixels
from rcdn.synthetic import camera_view
from rcdn.terminal.group import VERBS

pytestmark = pytest.mark.xdist_group("command line page")  # one folder
PAGE = Path(__file__).parents[1] / "docs" / "command-line.md"
BLOCKS = re.findall(r"^```sh( hours)?\n(.*?)^```", PAGE.read_text("utf-8"), re.S | re.M)
SEED = 1  # of `rcdn render`


def commands(hours):
    """The lines of the page's examples."""
    return [line for slow, text in BLOCKS if bool(slow) == hours for line in text.splitlines()]


def test_every_verb_has_an_example_and_a_heading():
    verbs = {command.name for command in app.registered_commands} | set(entry_points(group=VERBS).names)
    used = {line.split()[1] for line in commands(False) + commands(True)}
    assert used == verbs
    titles = re.findall(r"^### (.*)$", PAGE.read_text("utf-8"), re.M)
    assert {name for title in titles for name in title.split(", ")} == verbs


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """(the folder, the output of each command), after all examples of the page, one after the other."""
    if shutil.which("jq") is None or shutil.which("bash") is None:
        pytest.skip("the page's examples need bash and jq")
    place = tmp_path_factory.mktemp("page")
    variables = {**os.environ, "XDG_CACHE_HOME": str(place / "kept"), "OMP_NUM_THREADS": "1"}
    outputs = {}
    for line in commands(False):
        script = f'set -eo pipefail\nrcdn() {{ "{sys.executable}" -m rcdn "$@"; }}\n{line}\n'
        done = subprocess.run(
            ["bash", "-c", script], cwd=place, env=variables, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
        outputs[line] = done.stdout
    return place, outputs


def out_of(outputs, *words):
    """The output of the one command with these words."""
    (found,) = [text for line, text in outputs.items() if all(word in line for word in words)]
    return found


def test_the_examples_run_and_give_what_the_page_says(ran):
    place, outputs = ran
    rows = [json.loads(row) for row in out_of(outputs, "detect photos", "jq").splitlines()]
    assert [name for name, _ in rows] == [f"photos/scene_{k:06d}.png" for k in range(1, 13)]
    assert sum(max(corners, default=0) == 54 for _, corners in rows) >= 10
    assert out_of(outputs, "jq .verdict").strip() in ('"good"', '"fair"', '"unsure"')
    assert len(json.loads(out_of(outputs, "jq", "T_cam_board"))) == 4
    camera = read_camera(place / "camera.yaml")
    assert pytest.approx(camera_view(SEED, 1).camera.K, abs=0.5) == camera.K
    for name in ("camera_info.yaml", "camera.json"):
        assert np.array_equal(read_camera(place / name).K, camera.K)
    for file in ("report.html", "again.html", "difference.html", "board.pdf", "seen/scene_000001.png"):
        assert (place / file).stat().st_size > 1000
    assert "OPENCV" in out_of(outputs, "colmap")
    assert len(read_detections(place / "again.json")[0]) == 12
    assert read_pixels(place / "small" / "scene_000003.png").shape[:2] == (240, 320)
    wide = read_camera(place / "wide" / "undistorted-camera.yaml")
    assert read_pixels(place / "wide" / "scene_000003.png").shape[1::-1] == tuple(wide.image_size)


def test_undistorted_boards_are_straight(ran):
    """Rows of the corners that are found in undistorted pictures lie on lines, those of the pictures before don't."""
    from rcdn import Detector

    place, _ = ran
    detector, bends = Detector(), {}
    for folder in ("photos", "flat"):
        grids = [
            b.grid()
            for k in (1, 2, 3, 4, 5)
            for b in detector.boards(read_pixels(place / folder / f"scene_{k:06d}.png"))
        ]
        rows = [
            row for grid in grids for row in (*grid, *grid.swapaxes(0, 1)) if np.isfinite(row).all() and len(row) > 4
        ]
        assert len(rows) > 20
        bends[folder] = np.sqrt(np.mean([np.linalg.svd(row - row.mean(axis=0))[1][1] ** 2 / len(row) for row in rows]))
    assert bends["flat"] < 0.05 < 0.2 < bends["photos"]


@pytest.mark.parametrize("line", commands(True))
def test_options_of_the_long_ones_exist(line):
    verb = line.split()[1]
    done = subprocess.run([sys.executable, "-m", "rcdn", verb, "--help"], capture_output=True, text=True, check=True)
    for option in re.findall(r"--[a-z-]+", line):
        assert option in done.stdout
