"""Cameras that lose step: a lost frame is found and made good; a clock that is faster bends no lens."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from rcdn.calibration import calibrate, calibrate_rig, calibrate_stereo, stereo
from rcdn.calibration.board_paths import times_of
from rcdn.calibration.changing_lags import Course, by_courses, course_of, courses_of
from rcdn.calibration.coded import Geometries
from rcdn.calibration.known_lens import with_known_lens
from rcdn.calibration.out_of_step import sentences_on
from rcdn.calibration.rig_graph import sights_of
from rcdn.geometry import rotation
from rcdn_lab.camera_scenes import SPACING, board, see
from rcdn_lab.rig_scenes import row

pytestmark = pytest.mark.xdist_group("changing lags")
SCENE = row([0.12], ("pinhole",))
MOMENTS, LOST = 56, 24
TRUTH = SCENE.places["c1"] @ np.linalg.inv(SCENE.places["c0"])


def path(t):
    """T (4, 4) of a board that is waved before both cameras, in the axes of c0."""
    T = np.eye(4)
    T[:3, :3] = rotation(np.array([0.5 * np.sin(t / 4), 0.5 * np.cos(t / 5), 0.2 * np.sin(t / 7)]))
    T[:3, 3] = [-0.1 + 0.09 * np.sin(t / 5), -0.08 + 0.07 * np.cos(t / 6.3), 0.65 + 0.1 * np.sin(t / 6)]
    return T


def recorded(camera, when, noise=0.05, seed=5, along=path):
    """The boards that a camera saw at its moments m, which are at the times when(m), and the moments' names."""
    rng, boards, names = np.random.default_rng(seed), [], []
    lens, place = SCENE.cameras[camera], SCENE.places[camera] @ np.linalg.inv(SCENE.places["c0"])
    for m in range(MOMENTS):
        ij, xy = see(lens, place @ along(when(m)))
        if len(ij) == 54:
            boards.append(board(ij, xy + rng.normal(0, noise, xy.shape), lens.image_size, np.full(54, noise)))
            names.append(f"{m:03d}")
    return boards, names


def in_order(m):
    return float(m)


def after_a_lost_frame(m):
    return float(m + (m >= LOST))


def by_a_fast_clock(m):
    return 1.03 * m - 0.8


def rig_of(when):
    boards, moments = zip(
        *(recorded(c, w, seed=k) for k, (c, w) in enumerate((("c0", in_order), ("c1", when)))), strict=True
    )
    return calibrate_rig(
        dict(zip(SCENE.cameras, boards, strict=True)), SPACING,
        moments=dict(zip(SCENE.cameras, moments, strict=True)), model="brown",
    )  # fmt: skip


def stereo_of(when):
    (left, ours), (right, theirs) = recorded("c0", in_order, seed=0), recorded("c1", when, seed=1)
    pairs = [(k, theirs.index(name)) for k, name in enumerate(ours) if name in theirs]
    names = [f"a/{n}.png" for n in ours], [f"b/{n}.png" for n in theirs]
    return calibrate_stereo(left, right, SPACING, pairs=pairs, names=names, model="brown")


def place_holds(T):
    """Whether a relative pose is the true one, to a tenth of a degree and .5 mm."""
    D = TRUTH @ np.linalg.inv(T)
    assert np.linalg.norm(D[:3, 3]) < 0.0005
    assert np.linalg.norm(D[:3, :3] - np.eye(3)) < 0.002


def lens_holds(name, calibration):
    off = calibration.camera.K[0, 0] - SCENE.cameras[name].K[0, 0]
    assert abs(off) < 4 * calibration.std["fx"]
    assert abs(off) < 0.005 * SCENE.cameras[name].K[0, 0]


def keys(verdict):
    return [reason.key.split(".")[-1] for reason in verdict.against]


@pytest.fixture(scope="module")
def fast():
    return rig_of(by_a_fast_clock)


def test_a_frame_that_one_camera_of_a_rig_lost_is_made_good_and_told():
    found = rig_of(after_a_lost_frame)
    assert found.rms < 0.1
    place_holds(found.rig.relative("c0", "c1")[0])
    for name, calibration in found.cameras.items():
        lens_holds(name, calibration)
    first = found.verdict.against[0]
    assert (first.key, first.level) == ("changing_lag", "fair")
    assert f"c1 isn't in step with c0: at first in step, from {LOST:03d} on 1 frame late." in first.sentence


def test_a_frame_that_one_camera_of_a_pair_lost_is_made_good_and_told():
    found = stereo_of(after_a_lost_frame)
    assert found.epipolar < 0.1
    place_holds(found.T_right_left)
    lens_holds("c0", found.left)
    lens_holds("c1", found.right)
    first = found.verdict.against[0]
    assert (first.key, first.level) == ("changing_lag", "fair")
    assert (
        f"The right camera isn't in step with the left camera: at first in step, from b/{LOST:03d}.png"
        in found.advice[0]
    )


def test_a_fast_clock_leaves_the_lenses_of_a_rig_as_they_are_alone(fast):
    for name, when in (("c0", in_order), ("c1", by_a_fast_clock)):
        lens_holds(name, fast.cameras[name])
        alone = calibrate(recorded(name, when, seed=int(name[1]))[0], SPACING, model="brown")
        assert np.abs(fast.cameras[name].camera.parameters - alone.camera.parameters).max() < 1e-6
        assert fast.rig.cameras[fast.rig.names.index(name)].K[0, 0] == fast.cameras[name].camera.K[0, 0]


def test_a_fast_clock_is_told_first_and_neither_lens_nor_print_is_blamed(fast):
    first = fast.verdict.against[0]
    assert first.key == "contradiction"
    assert "weren't taken at the same moments" in first.sentence
    assert "c1 isn't in step with c0: at first" in first.sentence
    assert not {"stretched", "parameters", "focal_length", "rms", "aspect", "determined"} & set(keys(fast.verdict))


def test_cameras_in_step_are_solved_for_jointly_as_ever():
    found = rig_of(in_order)
    assert not {"contradiction", "changing_lag", "time_shift"} & set(keys(found.verdict))
    place_holds(found.rig.relative("c0", "c1")[0])
    alone = calibrate(recorded("c0", in_order, seed=0)[0], SPACING, model="brown")
    assert found.cameras["c0"].std["fx"] < alone.std["fx"]


@cache
def with_its_lens(camera, when, along, seed):
    """A calibration with the known lens, and its moments."""
    boards, names = recorded(camera, when, seed=seed, along=along)
    return with_known_lens(boards, Geometries.of(boards, SPACING), names, SCENE.cameras[camera]), names


def known(*views):
    """Calibrations with known lenses of (camera, when, path of its board)."""
    out, moments = zip(*(with_its_lens(*view, seed=k) for k, view in enumerate(views)), strict=True)
    time = times_of(m for each in moments for m in each)
    return out, sights_of(out, moments), time, moments


@pytest.mark.parametrize("early", [0, 1, -2])
def test_the_course_of_a_lag_has_its_steps_where_frames_were_lost(early):
    def when(m):
        return float(m + early + (m >= LOST) + (m >= 40))

    *seen, _ = known(("c0", in_order, path), ("c1", when, path))
    course = course_of(*seen, 0, 1)
    assert course.moments == pytest.approx(early + np.arange(3))
    assert course.since[1:] == pytest.approx([LOST, 40], abs=1)
    back = course_of(*seen, 1, 0)
    assert back.moments == pytest.approx(-early - np.arange(3))


def test_a_part_of_a_moment_that_is_common_is_no_part_of_the_course():
    *seen, moments = known(("c0", in_order, path), ("c1", lambda m: after_a_lost_frame(m) + 0.3, path))
    (course,) = courses_of(*seen)
    assert course.b == 1
    assert course.whole == pytest.approx([0, 1])
    later, _ = by_courses(moments, seen[-1], [course])
    assert later[1][moments[1].index("030")] == "031"
    assert later[0] == moments[0]


@pytest.mark.parametrize("late", [0.0, 1.0, 0.3])
def test_a_constant_lag_has_no_course_but_is_seen(late):
    *seen, _ = known(("c0", in_order, path), ("c1", lambda m: m + late, path))
    assert courses_of(*seen) == []
    told = courses_of(*seen, constant=True)
    assert [c.moments.tolist() for c in told] == ([[pytest.approx(late, abs=0.05)]] if late else [])


@pytest.mark.parametrize("other", range(1, 5))
def test_boards_of_their_own_have_no_course(other):
    *seen, _ = known(("c0", in_order, path), ("c1", lambda m: 7 * other + 1.3 * m, lambda t: path(-0.8 * t)))
    assert courses_of(*seen) == []


def test_of_three_cameras_the_one_that_lost_a_frame_is_named():
    *seen, _ = known(("c0", in_order, path), ("c1", after_a_lost_frame, path), ("c1", in_order, path))
    assert [(c.a in (0, 2), c.b) for c in courses_of(*seen)] == [(True, 1)]


def test_long_courses_are_told_by_their_ends():
    course = Course(0, 1, np.array([3.0, 5, 9, 20]), np.array([0, 0.5, 1, 1.5]), np.array([2, 4, 11, 3]), 90.0)
    (text,) = sentences_on([course], ["a", "b"], [{}, {20.0: "x020"}])
    assert text == "b isn't in step with a: at first in step, in 2 steps to 1.5 frames late, which it is from x020 on."


@pytest.mark.filterwarnings("error")
def test_an_epipolar_distance_without_rays_is_unknown_without_a_warning(monkeypatch):
    monkeypatch.setattr(stereo, "matches", lambda *_: {(0, 1): (np.array([0]), np.array([1]))})
    monkeypatch.setattr(stereo, "epipolar_gaps", lambda *_: np.full((4, 2), np.nan))
    task = SimpleNamespace(corners=SimpleNamespace(xy=np.zeros((2, 2))), ij=None)
    fit = SimpleNamespace(used=None, state=SimpleNamespace(cameras=(None, None), rig=np.zeros((2, 4, 4))))
    assert np.isnan(stereo._epipolar(task, fit))
