"""Cameras out of step: known shifts come back, and corrected rigs are as good as those in step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig
from rcdn.calibration.board_paths import times_of
from rcdn.calibration.rig_facts import judged_rig
from rcdn.calibration.rough_shifts import _against_references
from rcdn.geometry import rotation
from rcdn_lab.camera_scenes import SPACING, board, see
from rcdn_lab.rig_scenes import row

pytestmark = pytest.mark.xdist_group("time shift")
LATE = {"c0": 0.0, "c1": 0.7, "c2": -0.4, "c3": 0.0}
SCENE = row([0.12, 0.12, 0.12], ("pinhole",))


def moving(late, moments=30, noise=0.1, seed=3, speed=1.0):
    """A board that moves steadily before cameras that are late by so many moments; boards and moments by camera."""
    rng, boards, when = np.random.default_rng(seed), {}, {}
    middle = np.linalg.inv(SCENE.places["c1"])
    for name, camera in SCENE.cameras.items():
        if name not in late:
            continue
        boards[name], when[name] = [], []
        for m in range(moments):
            t = speed * (m + late[name])
            T = np.eye(4)
            T[:3, :3] = rotation(np.array([0.4 * np.sin(t / 3), 0.4 * np.cos(t / 4), 0.1]))
            T[:3, 3] = [-0.06 + 0.1 * np.sin(t / 5), -0.08 + 0.06 * np.cos(t / 4), 0.7 + 0.1 * np.sin(t / 6)]
            ij, xy = see(camera, SCENE.places[name] @ middle @ T)
            if len(ij) == 54:
                boards[name].append(
                    board(ij, xy + rng.normal(0, noise, xy.shape), camera.image_size, np.full(54, noise))
                )
                when[name].append(f"frame {m:03d}")
    return boards, when


def solved(late, correct):
    boards, when = moving(late)
    return calibrate_rig(boards, SPACING, moments=when, cameras=SCENE.cameras, correct_time=correct)


@pytest.fixture(scope="module")
def uncorrected():
    return solved(LATE, correct=False)


@pytest.fixture(scope="module")
def corrected():
    return solved(LATE, correct=True)


def errors(done):
    """(C − 1, 6) how far places are off, and their standard deviations."""
    off, std = [], []
    for name in done.rig.names[1:]:
        T, cov = done.rig.relative("c0", name)
        D = SCENE.places[name] @ np.linalg.inv(SCENE.places["c0"]) @ np.linalg.inv(T)
        off.append(np.append(Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3]))
        std.append(np.sqrt(np.diag(cov)))
    return np.array(off), np.array(std)


def test_late_cameras_are_told_against_those_that_are_in_step(uncorrected):
    for name, late in LATE.items():
        assert uncorrected.shifts[name].moments == pytest.approx(late, abs=0.1)
        assert uncorrected.shifts[name].clear == (late != 0)
    (reason,) = [r for r in uncorrected.verdict.against if r.key == "time_shift"]
    assert "c1 is 0." in reason.sentence
    assert "--correct-time" in reason.action
    assert uncorrected.corrected == ()
    tried = judged_rig(uncorrected, correct_time=True).verdict
    (reason,) = [r for r in tried.against if r.key == "time_shift"]
    assert "--correct-time" not in reason.action
    assert "did not explain the corners better" in reason.action


def test_corrected_shifts_are_exact_to_their_deviations(corrected):
    assert corrected.corrected == ("c1", "c2")
    for name, late in LATE.items():
        shift = corrected.shifts[name]
        assert shift.moments == pytest.approx(late, abs=max(4 * shift.std, 0.01))
        assert shift.std < 0.02
    assert not [r for r in corrected.verdict.against if r.key == "time_shift"]


def test_a_corrected_rig_is_as_good_as_one_in_step(uncorrected, corrected):
    assert corrected.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.15)
    assert uncorrected.rms > 3 * corrected.rms
    off, std = errors(corrected)
    assert np.abs(off[:, 3:]).max() < 0.001
    assert np.abs(off / std).max() < 4
    worse, _ = errors(uncorrected)
    assert np.linalg.norm(worse[:, 3:]) > 3 * np.linalg.norm(off[:, 3:])
    assert max(p.epipolar for p in corrected.pairs) < 0.2
    assert max(p.epipolar for p in uncorrected.pairs) > 0.5


def test_lenses_that_are_solved_for_do_not_hide_a_shift():
    """Before a board that moves slowly and evenly, lenses and places can take up most of a shift."""
    boards, when = moving({"c1": 0.0, "c2": 0.3}, moments=24, speed=0.25, seed=12)
    found = calibrate_rig(boards, SPACING, moments=when, model="brown", correct_time=True)
    shift, other = found.shifts["c2"], found.shifts["c1"]
    assert shift.moments - other.moments == pytest.approx(0.3, abs=4 * max(shift.std, other.std))
    assert 0 < max(shift.std, other.std) < 0.03
    assert len(found.corrected) == 1
    T, cov = found.rig.relative("c1", "c2")
    off = (SCENE.places["c2"] @ np.linalg.inv(SCENE.places["c1"]) @ np.linalg.inv(T))[:3, 3]
    assert np.linalg.norm(off) < 4 * np.sqrt(np.trace(cov[3:, 3:]))


def test_poses_of_a_late_cameras_views_are_those_of_its_pictures(corrected):
    calibration = corrected.cameras["c1"]
    for view in calibration.used_views[5:25]:
        flat = np.column_stack([view.ij * SPACING, np.zeros(len(view))])
        seen = calibration.camera.project(flat @ view.pose.R.T + view.pose.t)
        assert np.median(np.linalg.norm(view.xy - seen - view.residuals, axis=1)) < 1e-6


def test_a_rig_in_step_is_left_as_it_is():
    late = dict.fromkeys(LATE, 0.0)
    one, other = solved(late, correct=False), solved(late, correct=True)
    assert other.corrected == ()
    assert [p.T_cam_board.tolist() for p in one.rig.poses] == [p.T_cam_board.tolist() for p in other.rig.poses]
    assert not [r for r in one.verdict.against if r.key == "time_shift"]


@pytest.fixture(scope="module")
def frames_apart():
    """One camera that is seven frames and a part late, and one that is five early."""
    return solved({"c0": 0.0, "c1": 7.4, "c2": -5.0, "c3": 0.0}, correct=True)


def test_cameras_that_are_frames_out_of_step_are_brought_into_step(frames_apart):
    assert frames_apart.components == (("c0", "c1", "c2", "c3"),)
    assert frames_apart.corrected == ("c1", "c2")
    for name, late in {"c0": 0.0, "c1": 7.4, "c2": -5.0, "c3": 0.0}.items():
        shift = frames_apart.shifts[name]
        assert shift.moments == pytest.approx(late, abs=max(4 * shift.std, 0.01))
        assert shift.std < 0.02
    assert frames_apart.rms == pytest.approx(0.1 * np.sqrt(2), rel=0.15)
    off, std = errors(frames_apart)
    assert np.abs(off[:, 3:]).max() < 0.001
    assert np.abs(off / std).max() < 4


def test_whole_frames_out_of_step_are_corrected_without_being_asked():
    found = solved({"c0": 0.0, "c1": 3.0, "c2": 0.0, "c3": 0.0}, correct=False)
    assert found.components == (("c0", "c1", "c2", "c3"),)
    assert found.corrected == ("c1",)
    assert found.shifts["c1"].moments == pytest.approx(3, abs=0.01)
    (reason,) = [r for r in found.verdict.reasons if r.key == "time_shift"]
    assert reason.level == "good"
    assert "c1 is 3.0" in reason.sentence


def test_parts_of_frames_beyond_whole_ones_are_told_and_left():
    found = solved({"c0": 0.0, "c1": 3.4, "c2": 0.0, "c3": 0.0}, correct=False)
    assert found.corrected == ()
    assert found.shifts["c1"].moments == pytest.approx(3.4, abs=0.02)
    (reason,) = [r for r in found.verdict.against if r.key == "time_shift"]
    assert "c1 is 3." in reason.sentence
    assert "--correct-time" in reason.action


def test_shifts_are_told_against_one_camera_of_each_group_that_moving_boards_connect():
    known, tau = np.array([0, 2, 3, 5, 6]), np.array([0.1, 0.3, -0.2, 0.3, 0.12])
    rough = _against_references(known, tau, tau, [{3, 5}, {0, 2}, {2, 6}])
    assert rough.references == (6, 3)  # of three, the one nearest to the others
    assert rough.moments == pytest.approx({0: -0.02, 2: 0.18, 6: 0, 3: 0, 5: 0.5})


def test_times_are_the_numbers_of_frames_or_the_order_of_names():
    assert times_of(["#12", "#7"]) == {"#12": 12, "#7": 7}
    assert times_of(["a", "c", "b"]) == {"a": 0, "b": 1, "c": 2}
    assert times_of(["1", "x1"]) == {"1": 0, "x1": 1}  # one number twice
    stamps = times_of(["1500000000", "1500033333", "1500066666"])
    assert stamps["1500066666"] - stamps["1500000000"] == pytest.approx(2)
