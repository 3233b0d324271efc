"""Cameras that share boards only at the edges of their pictures: joint lenses connect them where their own do not, and
connect no boards of different moments."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration import calibrate_rig, calibrate_stereo, joint_pairs, stereo
from rcdn.calibration import rig as rig_module
from rcdn.calibration.joint_pairs import JointPairs
from rcdn.calibration.rig_start import edges_of
from rcdn.errors import CalibrationError
from rcdn.types import Pose
from rcdn_lab.camera_scenes import SIZE, SPACING
from rcdn_lab.rig_scenes import chain, outwards

pytestmark = pytest.mark.xdist_group("joint pairs")  # one ring that all of them look at
SCENE = outwards()
RING = list(SCENE.cameras)
LAST = np.array(SIZE) - 1
HALF_TURN = np.diag([-1.0, -1, 1, 1])
HALF_TURN[:2, 3] = LAST * SPACING


@pytest.fixture(scope="module")
def seen():
    return SCENE.views(np.random.default_rng(4), chain(4, 5, closed=True))


@pytest.fixture(scope="module")
def alone(seen):
    """Each camera from its own boards alone, once it is asked for: by name the same whatever the moments."""
    boards, _ = seen
    geometries = rig_module.Geometries.of([b for each in boards.values() for b in each], SPACING, None)
    calibrated = rig_module.with_lens  # in whose place `rig` puts this

    class Alone(dict):
        def __missing__(self, name):
            self[name] = calibrated(boards[name], geometries, None, "brown")
            return self[name]

    return Alone()


@pytest.fixture
def rig(seen, alone, monkeypatch):
    """The rig's calibration by its boards' moments."""
    name_of = {id(boards): name for name, boards in seen[0].items()}
    monkeypatch.setattr(rig_module, "with_lens", lambda boards, *_: alone[name_of[id(boards)]])
    return lambda moments: calibrate_rig(seen[0], SPACING, moments=moments, model="brown")


def shared(moments, a, b):
    return [m for m in moments[a] if m in moments[b]]


def mixed(moments, a, b, order):
    """`moments` of camera `b` with those of the boards that it shares with `a` in another order."""
    both = shared(moments, a, b)
    new = dict(zip(both, [both[k] for k in order], strict=True))
    return {**moments, b: [new.get(m, m) for m in moments[b]]}


def rolled(moments, a, b):
    many = len(shared(moments, a, b))
    return mixed(moments, a, b, [*range(1, many), 0])


def of_pairs(alone, moments, **changed):
    cameras = [replace(alone[n], **changed) for n in RING]
    sights = [{(m, 0): k for k, m in enumerate(moments[n])} for n in RING]
    return JointPairs(cameras, sights, [False] * 4)


def true_place(T, a, b, turn=4.0):
    """Whether T_b_a is right to `turn` degrees and .1 m, boards being 2 to 5 m away and a few pixels wide."""
    D = SCENE.places[RING[b]] @ np.linalg.inv(SCENE.places[RING[a]]) @ np.linalg.inv(T)
    return np.degrees(Rotation.from_matrix(D[:3, :3]).magnitude()) < turn and np.linalg.norm(D[:3, 3]) < 0.1


def test_boards_at_the_edges_disagree_by_each_lens_alone_and_agree_by_joint_ones(seen, alone):
    pairs = of_pairs(alone, seen[1])
    apart = edges_of(pairs.cameras, pairs.sights)
    assert {(e.a, e.b) for e in apart} == {(0, 3), (1, 2)}
    assert all(e.votes < len(e.keys) for e in apart)
    for a, b in ((0, 1), (2, 3)):
        edge = pairs.edge(a, b)
        assert set(edge.joint) == set(edge.keys)
        assert true_place(edge.T, a, b)


def test_half_turns_of_plain_boards_are_settled_by_the_pose_that_most_agree_on(seen, alone):
    def of(name):
        views = [
            replace(v, ij=LAST - v.ij, pose=Pose(v.pose.T_cam_board @ HALF_TURN)) if name == "c1" and k % 2 else v
            for k, v in enumerate(alone[name].views)
        ]
        return replace(alone[name], views=tuple(views), orientation="ambiguous_180")

    edge = of_pairs({n: of(n) for n in RING}, seen[1]).edge(0, 1)
    assert set(edge.joint) == set(edge.keys)
    assert true_place(edge.T, 0, 1)


@pytest.mark.parametrize("px", [1, 6])
def test_boards_that_moved_between_both_pictures_are_not_fitted_by_bending_lenses(seen, alone, px):
    rng, both = np.random.default_rng(0), shared(seen[1], "c0", "c1")
    views = [
        replace(v, xy=v.xy + rng.normal(0, px, 2)) if m in both else v
        for m, v in zip(seen[1]["c1"], alone["c1"].views, strict=True)
    ]
    late = {n: alone[n] for n in RING} | {"c1": replace(alone["c1"], views=tuple(views))}
    assert of_pairs(late, seen[1]).edge(0, 1) is None


def test_corners_refuse_boards_of_other_moments_whatever_their_poses_say(seen, alone, monkeypatch):
    monkeypatch.setattr(joint_pairs, "WIDE", np.inf)
    assert of_pairs(alone, rolled(seen[1], "c2", "c3")).edge(2, 3) is None


def test_a_ring_whose_neighbours_share_a_tenth_is_one_rig_of_all_its_views(rig, seen):
    done = rig(seen[1])
    assert done.components == (tuple(RING),)
    assert not done.links
    assert [p.used for p in done.pairs] == [p.shared for p in done.pairs]
    for name in RING[1:]:
        T, cov = done.rig.relative("c0", name)
        D = SCENE.places[name] @ np.linalg.inv(SCENE.places["c0"]) @ np.linalg.inv(T)
        error = np.append(Rotation.from_matrix(D[:3, :3]).as_rotvec(), D[:3, 3])
        assert error @ np.linalg.solve(cov, error) < 6 + 4 * np.sqrt(12)


def test_boards_of_another_moment_are_left_out_of_a_joint_pair_and_named(rig, seen):
    both = shared(seen[1], "c0", "c1")
    done = rig(mixed(seen[1], "c0", "c1", [1, 0, *range(2, len(both))]))
    assert done.components == (tuple(RING),)
    left_out = {seen[1]["c1"][k] for k, v in enumerate(done.cameras["c1"].views) if v.reason}
    assert left_out == set(both[:2])


def test_a_camera_whose_shared_boards_are_shuffled_in_time_is_not_joined(rig, seen):
    done = rig(rolled(rolled(seen[1], "c1", "c2"), "c3", "c2"))
    assert done.components == (("c0", "c1", "c3"), ("c2",))
    (link,) = done.links
    assert link.second == "c2"
    assert link.same_moment
    assert "c2" in done.verdict.against[0].sentence


def test_a_ring_paired_wrongly_is_no_rig(rig, seen):
    late = {name: [*moments[k:], *moments[:k]] for k, (name, moments) in enumerate(seen[1].items())}
    assert any(shared(late, a, b) for a, b in pairwise(RING))
    with pytest.raises(CalibrationError, match="no two cameras"):
        rig(late)


def test_a_ring_whose_shared_boards_are_all_shuffled_in_time_is_no_rig(rig, seen):
    wrong = seen[1]
    for a, b in (("c0", "c1"), ("c1", "c2"), ("c2", "c3"), ("c0", "c3")):
        wrong = rolled(wrong, a, b)
    with pytest.raises(CalibrationError, match="no two cameras"):
        rig(wrong)


def test_two_cameras_alone_are_placed_by_joint_lenses(seen, alone, monkeypatch):
    are_placed(seen, alone, monkeypatch, 2, 3)


def test_two_that_look_elsewhere_are_placed_too(seen, alone, monkeypatch):
    are_placed(seen, alone, monkeypatch, 0, 1)


def are_placed(seen, alone, monkeypatch, a, b):
    monkeypatch.setattr(stereo, "_each", lambda *_: (alone[RING[a]], alone[RING[b]], ""))

    def found(moments):
        both = shared(moments, RING[a], RING[b])
        pairs = [tuple(moments[RING[c]].index(m) for c in (a, b)) for m in both]
        return calibrate_stereo(seen[0][RING[a]], seen[0][RING[b]], SPACING, pairs=pairs, model="brown")

    pair = found(seen[1])
    assert true_place(pair.T_right_left, a, b, 5.0)  # without a ring that closes
    assert pair.verdict.level in ("unsure", "bad")
    assert not any("left out" in text for text in pair.advice)
    many = len(shared(seen[1], RING[a], RING[b]))
    places = [(v.pose.T_cam_board, w.pose.T_cam_board) for v, w in zip(pair.left.views, pair.right.views, strict=False)]
    np.testing.assert_allclose([q for _, q in places[:many]], [pair.T_right_left @ p for p, _ in places[:many]])
    with pytest.raises(CalibrationError, match="on where the cameras stand"):
        found(rolled(seen[1], RING[a], RING[b]))
