"""docs/rigs.md, done by somebody who copies it, with pictures of two known cameras."""

import json

import cv2
import numpy as np
import pytest
from tests.adapters.rig_pictures import BASELINE, FOCAL, pictures
from tests.doc_blocks import blocks, commands, run

from rcdn.io import read_rig

pytestmark = pytest.mark.xdist_group("rigs page")  # one folder
PAGE = "docs/rigs.md"


@pytest.fixture(scope="module")
def workplace(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    for side, taken in zip(("left", "right"), pictures(14), strict=True):
        (folder / "rig" / side).mkdir(parents=True)
        for k, picture in enumerate(taken):
            cv2.imwrite(str(folder / "rig" / side / f"{k:03d}.png"), picture)
    return folder


def is_the_rig(found):
    assert [c.K[0, 0] for c in found.cameras] == pytest.approx(FOCAL, abs=0.3)
    T, _ = found.relative(*found.names)
    assert np.linalg.norm(T[:3, 3]) == pytest.approx(BASELINE, abs=5e-4)
    assert np.degrees(np.arccos((np.trace(T[:3, :3]) - 1) / 2)) == pytest.approx(6, abs=0.05)


def test_the_command_writes_one_rig_in_three_files(workplace):
    calibrates, poses = commands(PAGE)
    run(workplace, "-m", *calibrates)
    run(workplace, "-m", *poses)
    places = json.loads((workplace / "poses.json").read_text())["rig_poses"]
    assert len(places) == 14
    assert all(place["cameras"] == ["left", "right"] and not place["left_out"] for place in places)
    rigs = [read_rig(workplace / name) for name in ("rig.toml", "camera_array.toml", "rig.json")]
    for found in rigs:
        is_the_rig(found)
    assert rigs[0].names == rigs[2].names == ("left", "right")
    assert rigs[2].covariance is not None


def test_the_python_gives_the_rig(workplace):
    code = "\n".join(blocks(PAGE, "python"))  # as one program, from top to bottom
    (workplace / "rig.toml").unlink(missing_ok=True)
    run(workplace, "-c", code)
    is_the_rig(read_rig(workplace / "rig.toml"))
