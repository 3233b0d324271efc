"""Rigs of cameras whose lenses are known: held as they are, one view is enough, and a lens that is wrong is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig
from rcdn.errors import CalibrationError, ConfigError
from rcdn.io import read_rig, write_rig, write_rig_calibration
from rcdn_lab.camera_scenes import SPACING
from rcdn_lab.rig_scenes import chain, row

pytestmark = pytest.mark.xdist_group("known lens")
SCENE = row([0.25], ("brown", "fisheye"))
MODELS = {"c0": "brown", "c1": "fisheye"}


@pytest.fixture(scope="module")
def seen():
    return SCENE.views(np.random.default_rng(5), chain(2, 5))


@pytest.fixture(scope="module")
def found(seen):
    boards, moments = seen
    return calibrate_rig(boards, SPACING, moments=moments, cameras=SCENE.cameras)


def error_of(done):
    T, cov = done.rig.relative("c0", "c1")
    D = SCENE.places["c1"] @ np.linalg.inv(SCENE.places["c0"]) @ np.linalg.inv(T)
    error = np.append(Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3])
    return error, cov


def test_known_lenses_are_held_to_the_last_digit_and_places_come_back(found):
    for name, camera in SCENE.cameras.items():
        assert found.cameras[name].camera.parameters.tolist() == camera.parameters.tolist()
        assert not found.cameras[name].std.any()
    error, cov = error_of(found)
    assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)
    assert found.given == ("c0", "c1")
    assert found.verdict.level == "good"
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.05)


def test_a_known_lens_makes_places_better_known(found, seen):
    boards, moments = seen
    solved = calibrate_rig(boards, SPACING, moments=moments, model=MODELS)
    mixed = calibrate_rig(boards, SPACING, moments=moments, model={"c0": "brown"}, cameras={"c1": SCENE.cameras["c1"]})
    spread = [np.trace(done.rig.relative("c0", "c1")[1][3:, 3:]) for done in (found, mixed, solved)]
    assert spread[0] < spread[1] < spread[2]
    assert mixed.cameras["c1"].camera.parameters.tolist() == SCENE.cameras["c1"].parameters.tolist()
    assert mixed.cameras["c0"].std.all()
    assert mixed.given == ("c1",)
    error, cov = error_of(mixed)
    assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)


def test_one_shared_view_places_a_camera_whose_lens_is_known(seen):
    boards, moments = seen
    shared = next(m for m in moments["c1"] if m in moments["c0"])
    k = moments["c1"].index(shared)
    done = calibrate_rig(
        {"c0": boards["c0"], "c1": [boards["c1"][k]]},
        SPACING,
        moments={"c0": moments["c0"], "c1": [shared]},
        cameras=SCENE.cameras,
    )
    assert done.rig.names == ("c0", "c1")
    assert done.thin == ("c0", "c1")
    assert np.linalg.norm(error_of(done)[0][3:]) < 0.01


def test_a_lens_that_is_wrong_is_told_with_what_to_do(seen):
    boards, moments = seen
    bent = replace(SCENE.cameras["c0"], distortion=SCENE.cameras["c0"].distortion + np.eye(5)[0] * 0.04)
    done = calibrate_rig(boards, SPACING, moments=moments, cameras={**SCENE.cameras, "c0": bent})
    reasons = [r for r in done.verdict.against if r.key.startswith("c0.")]
    assert reasons
    assert any("solved for" in r.action for r in reasons)
    assert done.verdict.level != "good"


def test_wrong_names_and_sizes_are_refused(seen):
    boards, moments = seen
    with pytest.raises(ConfigError, match="cameras holds top, which views don't have; they are of c0, c1"):
        calibrate_rig(boards, SPACING, moments=moments, cameras={"top": SCENE.cameras["c0"]})
    large = replace(SCENE.cameras["c0"], image_size=(1280, 960))
    with pytest.raises(
        CalibrationError, match=r"camera c0: its pictures have 640×480 px, but the camera given .* 1280×960"
    ):
        calibrate_rig(boards, SPACING, moments=moments, cameras={"c0": large}, model=MODELS)


def test_files_hold_the_known_lenses(found, tmp_path):
    write_rig(tmp_path / "rig.toml", found.rig)
    write_rig_calibration(tmp_path / "all.json", found)
    for name in ("rig.toml", "all.json"):
        back = read_rig(tmp_path / name)
        assert [c.parameters.tolist() for c in back.cameras] == [c.parameters.tolist() for c in SCENE.cameras.values()]
