"""Several cameras or zooms among the pictures are found and named; one camera isn't doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from jackknife import deviations

from rcdn.calibration import calibrate
from rcdn.calibration.apart import CameraGroup, apart_by, significance
from rcdn.calibration.groups import describe, name_partitions, natural_order
from rcdn.calibration.influence import gains, group_difference, view_information
from rcdn.calibration.one_camera import one_camera
from rcdn.errors import CalibrationError
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards, random_pose, see
from rcdn_lab.real_boards import curved_board

BROWN = CAMERAS["brown"]
PINHOLE = CAMERAS["pinhole"]


def zoomed(camera, factor, shift=(0.0, 0.0)):
    p = camera.parameters.copy()
    p[:2] *= factor
    p[2:4] += shift
    return camera.with_parameters(p)


def scene(cameras, seed, bend=0.0, noise=0.15):
    """A board for each of `cameras`, each bent anew by `bend` m."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < len(cameras):
        ij, xy = see(cameras[len(out)], random_pose(rng, 0.4), offsets=curved_board(rng.normal(0, bend, 2)))
        if len(ij) >= 40:
            out.append(
                board(ij - ij.min(axis=0), xy + rng.normal(0, noise, xy.shape), (640, 480), np.full(len(xy), noise))
            )
    return out


def found(cameras, names, seed=0, model="pinhole", **options):
    return one_camera(calibrate(scene(cameras, seed, **options), SPACING, names=names, model=model))


def plain(many):
    return [f"{k:03d}.png" for k in range(many)]


# ---- no false alarm


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("bend", [0.0, 0.0005])
def test_one_camera_is_not_doubted(seed, bend):
    names = [f"{'left' if k % 2 else 'right'}{k}.png" for k in range(16)]
    assert found([BROWN] * 16, names, seed, "brown", bend=bend) is None


def test_few_views_are_not_tested():
    assert found([PINHOLE] * 5, plain(5)) is None


# ---- several cameras


def test_two_zooms_are_told_by_their_names():
    """Interleaved, so that order tells nothing."""
    cameras = [PINHOLE, zoomed(PINHOLE, 1.04)] * 8
    names = [f"{'wide' if k % 2 == 0 else 'near'}_{k}.png" for k in range(16)]
    finding = found(cameras, names, 1)
    assert finding.by == "names"
    assert finding.probability < 1e-3
    groups = {g.label: g for g in finding.groups}
    assert set(groups) == {"wide_*", "near_*"}
    for label, factor in (("wide_*", 1.0), ("near_*", 1.04)):
        group = groups[label]
        assert len(group.names) == group.views == 8
        truth = zoomed(PINHOLE, factor).parameters
        assert (np.abs(group.camera.parameters - truth) < 5 * group.std).all()
        assert f"in 8 pictures ({label})" in finding.finding
    assert finding.together > 1.05 * max(g.rms for g in finding.groups)
    assert finding.difference == pytest.approx(apart_by(PINHOLE, zoomed(PINHOLE, 1.04)), rel=0.2)


def test_another_principal_point_is_found_too():
    cameras = [PINHOLE] * 8 + [zoomed(PINHOLE, 1.0, (12, -9))] * 8
    names = [f"cam{k // 8}_{k % 8}.png" for k in range(16)]
    finding = found(cameras, names, 2)
    assert finding.by == "names"
    assert {g.label for g in finding.groups} == {"cam0_*", "cam1_*"}
    assert "cx " in finding.finding or "cy " in finding.finding


def test_a_zoom_in_the_middle_is_found_without_names():
    cameras = [PINHOLE] * 9 + [zoomed(PINHOLE, 1.04)] * 7
    finding = found(cameras, plain(16), 3)
    assert finding.by == "order"
    first, second = sorted(finding.groups, key=lambda g: g.names[0])
    assert abs(len(first.names) - 9) <= 2
    assert first.label == f"000.png to {first.names[-1]}"
    assert second.camera.K[0, 0] / first.camera.K[0, 0] == pytest.approx(1.04, abs=0.02)


def test_a_smooth_correction_hides_no_second_camera():
    """With one for each group, the deviations of the lens parameters are so large that nothing differs."""
    cameras = [BROWN] * 9 + [zoomed(BROWN, 1.0, (20, 0))] * 9
    finding = found(cameras, plain(18), 4, "splined", noise=0.05)
    assert finding.by == "order"
    assert "cx " in finding.finding
    gap = finding.groups[0].camera.K[0, 2] - finding.groups[1].camera.K[0, 2]
    assert abs(gap) == pytest.approx(20, abs=3)


@pytest.mark.parametrize("seed", [5, 6])
def test_two_zooms_in_no_order_are_found(seed):
    far = np.random.default_rng(seed).permutation(20) < 9
    cameras = [zoomed(PINHOLE, 1.12) if f else PINHOLE for f in far]
    finding = found(cameras, plain(20), seed)
    assert finding.by == "focal length"
    near, tele = sorted(finding.groups, key=lambda g: g.camera.K[0, 0])
    wrong = sum(far[int(n[:3])] for n in near.names) + sum(not far[int(n[:3])] for n in tele.names)
    assert wrong <= 4
    assert tele.camera.K[0, 0] / near.camera.K[0, 0] == pytest.approx(1.12, abs=0.05)


def test_views_left_out_that_have_a_camera_of_their_own_are_named():
    cameras = [PINHOLE] * 14 + [zoomed(PINHOLE, 1.8, (20, 10))] * 5
    calibration = calibrate(scene(cameras, 5), SPACING, names=plain(19), model="pinhole")
    assert len(calibration.left_out) == 5
    finding = one_camera(calibration)
    assert finding.by == "left out"
    majority, other = finding.groups
    assert other.names == tuple(plain(19)[14:])
    assert other.camera.K[0, 0] == pytest.approx(1.8 * 520, rel=0.02)
    assert majority.views == 14


def test_pictures_of_two_sizes_are_named_by_size():
    boards = scene([PINHOLE] * 8, 0)
    boards = boards[:4] + [replace(b, image_size=(1280, 960)) for b in boards[4:]]
    names = [f"{'a' if k < 4 else 'b'}{k}.png" for k in range(8)]
    with pytest.raises(CalibrationError, match=r"640×480 in 4: a\*; 1280×960 in 4: b\*"):
        calibrate(boards, SPACING, names=names)


# ---- what it rests on


@pytest.fixture(scope="module")
def single():
    return calibrate(random_boards(BROWN, 6, 14)[0], SPACING, model="brown")


def test_the_score_is_zero_at_the_solution_and_the_information_is_that_of_the_covariance(single):
    info = view_information(single)
    H = info.information.sum(axis=0)
    # but for the prior, which the views' scores don't hold
    assert np.linalg.solve(H, info.score.sum(axis=0)) / single.std == pytest.approx(0, abs=0.01)
    many = len(H)
    stated = np.sqrt(np.diag(np.linalg.inv(H)))
    assert stated.shape == (many,)
    ratio = deviations(info) / stated
    assert ratio.mean() == pytest.approx(1.3, abs=0.5)  # independent noise; a jackknife is cautious


def test_group_differences_are_those_of_separate_solutions_if_everything_may_differ(single):
    info = view_information(single)
    info = replace(info, prior=0 * info.prior).at_optimum()  # the prior is on the camera that all have in common
    mask = np.arange(14) % 2 == 0
    d = group_difference(info, np.eye(9), mask[None])
    apart = [np.linalg.solve(info.information[m].sum(axis=0), info.score[m].sum(axis=0)) for m in (mask, ~mask)]
    assert d.value[0] == pytest.approx(apart[0] - apart[1], rel=1e-3)
    assert (np.abs(d.value / d.std) < 6).all()
    assert ((d.freedom > 3) & (d.freedom < 13)).all()
    cost = sum(info.score[m].sum(axis=0) @ a for m, a in zip((mask, ~mask), apart, strict=True))
    assert gains(info, mask[None])[0] == pytest.approx(cost, rel=1e-3)


def test_cameras_that_differ_by_a_rotation_do_not_differ():
    assert apart_by(BROWN, BROWN) < 1e-6
    long = PINHOLE.with_parameters(PINHOLE.parameters * [40, 40, 1, 1])
    assert apart_by(long, zoomed(long, 1.0, (5, 0))) < 0.01
    assert apart_by(PINHOLE, zoomed(PINHOLE, 1.02)) > 1


# ---- names


def test_partitions_by_names():
    assert name_partitions(["left01.png", "right01.png"] * 4) == [(0, 1) * 4]
    assert name_partitions(["a/1.png"] * 3 + ["b/1.png"] * 4) == [(0, 0, 0, 1, 1, 1, 1)]
    assert name_partitions([f"cam{c}_{k}.png" for c in (0, 1) for k in range(3, 8)]) == [(0,) * 5 + (1,) * 5]
    assert name_partitions(["x1.png", "x2.png", "x3.png", "odd.png"]) == []
    assert name_partitions(["x1.png"] * 3 + ["odd.png"] + ["y1.png"] * 3) == [(0, 0, 0, -1, 1, 1, 1)]
    assert name_partitions([f"{k}.png" for k in range(12)]) == []
    assert name_partitions([]) == []


def test_groups_in_few_words():
    assert describe(["d/left1.png", "d/left2.png"], ["d/right1.png"]) == "left*"
    assert describe(["a/1.png", "a/2.png"], ["b/1.png", "b/2.png"]) == "a/*"
    assert describe(["1.png", "10.png", "2.png", "3.png"], ["11.png", "12.png"]) == "1.png to 10.png"
    assert describe(["1.png", "4.png"], ["3.png"]) == "1.png, 4.png"
    assert describe(["1.png", "4.png", "6.png", "9.png"], ["3.png"]) == "1.png, 4.png, 6.png, …"


def test_natural_order():
    assert natural_order(["a10", "a2", "a1"]) == [2, 1, 0]


def test_what_is_held_fixed_differs_by_nothing():
    def group(fx, std):
        camera = Camera(np.array([[fx, 0, 320], [0, 500, 240], [0, 0, 1.0]]), [], (640, 480), "pinhole")
        return CameraGroup(("a",), "", camera, np.array(std), 0.1, 9)

    with np.errstate(all="raise"):
        far = significance([group(500.0, (1.0, 0, 1, 1)), group(503.0, (0.0, 0, 1, 1))])
    assert far == pytest.approx([3, 0, 0, 0])
