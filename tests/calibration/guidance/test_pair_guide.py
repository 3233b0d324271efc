"""Guidance of two cameras: one criterion for lenses and relative pose, that is true, and moments that both must see."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rcdn.calibration.added_pair import PairCovariance, PairForecast, SideForecast, pair_projections
from rcdn.calibration.guidance import PairGuide
from rcdn.calibration.guidance.pair_estimate import by_camera, pair_learned
from rcdn.calibration.guidance.progress import Wish
from rcdn.calibration.outlines import distances, outline
from rcdn.calibration.stereo import stereo_solution
from rcdn.calibration.stereo_verdict import baseline_std
from rcdn.calibration.uncertainty import projection_uncertainty
from rcdn.errors import ConfigError, RcdnError
from rcdn.geometry import project, rotation, unproject
from rcdn.types import SQUARES
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, random_pose, see

BROWN, PINHOLE = CAMERAS["brown"], CAMERAS["pinhole"]
T_RIGHT_LEFT = np.eye(4)
T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3] = rotation(np.array([0.02, -0.05, 0.03])), [-0.12, 0.004, 0.01]
NOISE = 0.1
BEGIN = np.eye(4)
BEGIN[:3, 3] = [-0.06, -0.07, 0.55]


def held(camera, T, rng=None):
    """The board that a camera sees at `T`; None if it hardly sees it."""
    ij, xy = see(camera, T)
    if len(ij) < 12:
        return None
    xy = xy + (rng.normal(0, NOISE, xy.shape) if rng is not None else 0)
    return board(ij - ij.min(axis=0), xy, camera.image_size, np.full(len(xy), NOISE))


def moment(T, rng=None, cameras=(PINHOLE, PINHOLE)):
    """What both cameras see of a board at T_left_board."""
    return held(cameras[0], T, rng), held(cameras[1], T_RIGHT_LEFT @ T, rng)


def wanted_pose(guide):
    """T_left_board of the wanted pose."""
    wanted = guide.progress.wanted
    T = wanted.leading.pose.T_cam_board
    return np.linalg.inv(T_RIGHT_LEFT) @ T if wanted.lead else T


def followed(views, **given):
    """A guide whose wanted poses were followed for `views` moments, up to 3° and 5 mm."""
    rng = np.random.default_rng(1)
    guide = PairGuide((PINHOLE.image_size, PINHOLE.image_size), SPACING, **{"size": SIZE, "model": "pinhole"} | given)
    guide.add(moment(BEGIN, rng), "0")
    while len(guide.progress.views) < views:
        T, views_wanted = wanted_pose(guide).copy(), guide.progress.wanted.views
        T[:3, :3] = rotation(rng.normal(0, 0.05, 3)) @ T[:3, :3]
        T[:3, 3] += rng.normal(0, 0.005, 3)
        seen = zip(moment(T, rng), views_wanted, strict=True)
        guide.add(tuple(b if v is not None else None for b, v in seen), str(len(guide.progress.views)))
    return guide


def random_pairs(seed, views=10, camera=PINHOLE):
    """Boards that both cameras see whole."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < views:
        pair = moment(random_pose(rng, 0.35, 0.7, (0.4, 0.8)), rng, (camera, camera))
        if all(b is not None and len(b) == SIZE[0] * SIZE[1] for b in pair):
            found.append(pair)
    return found


def solved(pairs, model="pinhole"):
    (left, right), _, both = by_camera(pairs, [str(k) for k in range(len(pairs))])
    return stereo_solution(left, right, SPACING, pairs=both, model=model, size=SIZE)


def as_pair(found):
    cameras = found.stereo.left.camera, found.stereo.right.camera
    return PairCovariance(cameras, found.stereo.T_right_left, found.cov, found.used, (1.0, 1.0))


@pytest.fixture(scope="module")
def eight():
    return followed(8)


@pytest.fixture(scope="module")
def started():
    return followed(3)


def still(guide, seen, start, **given):
    """What is said of boards that are held still for half a second."""
    return [guide.look(seen, start + 0.05 * k, **given) for k in range(11)][-1]


def test_eight_moments_recover_a_known_rig(eight):
    found = eight.progress.stereo
    turn = Rotation.from_matrix(found.T_right_left[:3, :3] @ T_RIGHT_LEFT[:3, :3].T).magnitude()
    assert found.baseline == pytest.approx(np.linalg.norm(T_RIGHT_LEFT[:3, 3]), rel=0.003)
    assert np.degrees(turn) < 0.05
    for side in (found.left, found.right):
        assert side.camera.parameters[:2] == pytest.approx(PINHOLE.parameters[:2], rel=0.002)
    assert eight.progress.worst < 0.3
    assert eight.progress.worst == max(eight.progress.parts)


def test_it_ends_when_all_three_are_known():
    """From eight moments on that both have seen, and not before."""
    guide = PairGuide((PINHOLE.image_size, PINHOLE.image_size), SPACING, size=SIZE, model="pinhole", target=0.6)
    moments = dict(zip("abcdefgh", random_pairs(5, 8), strict=True))
    assert guide.add_all({k: moments[k] for k in "abcdefg"}).worst < 0.6
    assert not guide.progress.done
    assert guide.add(moments["h"], "h").done
    assert guide.progress.sentence.startswith("Enough")
    assert max(guide.progress.parts) < 0.45
    baseline = np.linalg.norm(T_RIGHT_LEFT[:3, 3])
    assert guide.progress.stereo.baseline == pytest.approx(baseline, abs=3 * baseline_std(guide.progress.stereo))
    assert baseline_std(guide.progress.stereo) < 0.005 * baseline


def test_uncertainties_of_each_camera_are_those_of_its_calibration():
    found = solved(random_pairs(4))
    pair = as_pair(found)
    projections = pair_projections(pair, 0.6)
    values = projections.deviations(pair.cov)
    for part, side in enumerate((found.stereo.left, found.stereo.right)):
        mine = projections.part == part
        assert values[mine] == pytest.approx(projection_uncertainty(side, projections.xy[mine]), rel=1e-6)


def test_derivatives_from_left_to_right_are_those_of_the_projection():
    """By differences in both lenses and in the relative pose."""
    found = solved(random_pairs(4, camera=BROWN), "brown")
    pair, distance = as_pair(found), 0.6
    projections = pair_projections(pair, distance)
    (first, second), (a, b) = pair.cameras, pair.counts
    near = np.flatnonzero(projections.part == 2)[:40]
    xy = projections.xy[near]

    def projected(shift):
        left, right = (
            first.with_parameters(first.parameters + shift[:a]),
            second.with_parameters(second.parameters + shift[a : a + b]),
        )
        rays = unproject(left, xy)
        points = distance * rays / np.linalg.norm(rays, axis=1, keepdims=True) @ pair.T[:3, :3].T + pair.T[:3, 3]
        return project(right, points @ rotation(shift[a + b : a + b + 3]).T + shift[a + b + 3 :])

    for k in range(a + b + 6):
        step = np.zeros(a + b + 6)
        step[k] = 1e-3 if k % a < 4 and k < a + b else 1e-6
        slope = (projected(step) - projected(-step)) / (2 * step[k])
        scale = np.abs(slope).max() + 1e-9
        assert projections.by_shared[near, :, k] / scale == pytest.approx(slope / scale, abs=2e-4)


def transferred(cameras, T, xy, distance):
    """Pixels in the right picture of points that the left camera sees at `xy`, `distance` (G,) m away."""
    rays = unproject(cameras[0], xy)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return project(cameras[1], rays @ T[:3, :3].T + T[:3, 3] / distance[:, None])


def test_errors_from_left_to_right_are_as_large_as_stated():
    """The error of points that the left camera sees, projected into the right picture,
    is a standard deviation in the mean of calibrations."""
    ratios = []
    for seed in range(8):
        pair = as_pair(solved(random_pairs(10 + seed)))
        found = pair_projections(pair, 0.6)
        between = found.part == 2
        xy, distance = found.xy[between], found.distance[between]
        off = transferred(pair.cameras, pair.T, xy, distance)
        off = off - transferred((PINHOLE, PINHOLE), T_RIGHT_LEFT, xy, distance)
        stated = found.deviations(pair.cov)[between]
        ratios.append(np.mean((off**2).mean(axis=1) / stated**2))
    assert 0.5 < np.sqrt(np.mean(ratios)) < 1.5


def test_a_forecast_of_nothing_changes_nothing_and_of_a_view_by_both_tells_most():
    pair = replace(as_pair(solved(random_pairs(4))), weight=(7.0, 7.0))
    forecast = PairForecast.of(pair, 0.6)
    T = random_pose(np.random.default_rng(5), 0.1, 0.7, (0.4, 0.5))
    ij = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2) * SPACING
    points = (np.column_stack([ij, 0 * ij[:, 0]]) @ T[:3, :3].T + T[:3, 3])[None]
    ones, none = np.ones(points.shape[1]), np.zeros(points.shape[1])
    _, levels = forecast.after(
        np.repeat(points, 4, 0), np.array([[none, none], [ones, none], [none, ones], [ones, ones]])
    )
    gains = forecast.gain(levels)
    assert gains[3] > max(gains[1], gains[2]) > min(gains[1], gains[2]) > gains[0]
    for side, seen in ((0, points), (1, pair.in_right(points))):
        alone = SideForecast(forecast, side, False).after(seen, ones[None])[1]
        assert alone == pytest.approx(levels[1 + side : 2 + side], rel=1e-6)
        both = SideForecast(forecast, side, True).after(seen, ones[None])[1]
        assert both == pytest.approx(levels[3:], rel=1e-6)


def test_the_information_of_a_moment_is_that_of_the_solution():
    """Forecast with one of the moments more, beside the calibration that has it."""
    pairs = random_pairs(4, 12, BROWN)
    before, after = solved(pairs[:-1], "brown"), solved(pairs, "brown")
    weight = 1 / np.hypot(NOISE, 0.1)  # the corner's own deviation, and the noise of the same size that the fit finds
    pair = replace(as_pair(before), weight=(weight, weight))
    forecast = PairForecast.of(pair, 0.6)
    view = after.stereo.left.views[11]
    ij = view.ij * SPACING
    points = np.column_stack([ij, 0 * ij[:, 0]]) @ view.pose.R.T + view.pose.t
    _, level = forecast.after(points[None], np.ones((1, 2, len(points))))
    now = PairForecast.of(as_pair(after), 0.6)
    assert level[0] < forecast.level
    assert level[0] == pytest.approx(now.level, rel=0.35)


def test_the_first_moment_shows_the_whole_board_to_both():
    guide = PairGuide((BROWN.image_size, BROWN.image_size), SPACING)
    assert guide.progress.wanted is None
    left, right = moment(BEGIN)
    alone = still(guide, (left, None), 0.0)
    assert alone.refused == "Right camera: No board is seen."
    assert not alone.take
    assert "both cameras" in alone.hint
    part = replace_part(right)
    assert still(guide, (left, part), 10.0).refused == "One camera doesn't see the whole board."
    whole = still(guide, (left, right), 20.0)
    assert whole.take
    assert not whole.refused


def replace_part(whole):
    """The board without its last columns."""
    keep = whole.ij[:, 0] < 5
    return board(whole.ij[keep], whole.xy[keep], whole.image_size)


def test_from_the_first_moment_on_a_pose_that_both_see_is_wanted():
    guide = PairGuide((BROWN.image_size, BROWN.image_size), SPACING)
    guide.add(moment(BEGIN, np.random.default_rng(0)), "0")
    assert guide.progress.stereo is None
    views = guide.progress.wanted.views
    assert all(v is not None and v.inside == 1 for v in views)
    gap = np.linalg.norm(views[1].pose.T_cam_board[:3, 3] - (T_RIGHT_LEFT @ views[0].pose.T_cam_board)[:3, 3])
    assert gap < 0.15 * views[0].distance  # the relative pose is a guess


def test_boards_held_as_wanted_are_taken_once_both_are_still(started):
    seen = moment(wanted_pose(started))
    first = started.look(seen, 100.0)
    assert first.refused == "Hold the board still."
    last = still(started, seen, 100.1)
    assert last.take
    assert last.used == (True, True)
    assert last.fit > 0.8


def test_a_camera_that_should_see_the_board_and_does_not_is_named(started):
    left, _ = moment(wanted_pose(started))
    wanted = started.progress.wanted
    assert all(v is not None for v in wanted.views)
    assessment = still(started, (left, None), 200.0)
    assert assessment.refused == "Right camera: No board is seen."
    assert not assessment.take


def test_no_pose_is_wanted_that_is_there_already(eight):
    """Neither among those that were asked for, nor where pictures of both would be like one that was taken."""
    wanted = eight.progress.wanted
    seen = moment(wanted_pose(eight))
    for view, here, taken in zip(wanted.views, seen, zip(*eight._moments.values(), strict=True), strict=True):
        if (
            view is not None
            and min(distances(np.stack([outline(b) for b in taken if b is not None]), outline(here))) > 0.02
        ):
            return
    raise AssertionError("both pictures are like others")


def test_a_moment_can_be_given_up():
    guide = PairGuide((PINHOLE.image_size, PINHOLE.image_size), SPACING, size=SIZE, model="pinhole")
    guide.add_all({str(k): pair for k, pair in enumerate(random_pairs(5, 4))})
    guide.remove("3")
    assert guide.progress.views == ("0", "1", "2")
    with pytest.raises(ConfigError, match="name must be one of the accepted"):
        guide.remove("../3")


def test_the_same_frames_give_the_same_answers(started):
    again = followed(3)
    assert np.array_equal(again.progress.stereo.T_right_left, started.progress.stereo.T_right_left)
    assert np.array_equal(wanted_pose(again), wanted_pose(started))


def test_a_lens_model_is_chosen_from_eight_moments_on():
    """Before, that of the first guess is kept; then the choice holds until the moments have grown by half."""
    wish, pairs = Wish(BROWN.image_size, SPACING, "auto", 0.1), random_pairs(3, 9, BROWN)
    names = [str(k) for k in range(len(pairs))]
    known, lenses = None, []
    for n in (1, 3, 8, 9):
        known = pair_learned((wish, wish), pairs[:n], names[:n], SIZE, SQUARES, known)
        lenses.append((known.lens, known.chosen))
    assert lenses[0] == lenses[1]
    assert lenses[0][1] == 0
    assert lenses[2:] == [("brown", 8), ("brown", 8)]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"spacing": -1.0}, "spacing"),
        ({"model": "thin"}, "model"),
        ({"image_sizes": ((640, 480), (0, 1))}, "image_size"),
    ],
)
def test_wrong_arguments_are_named(given, message):
    with pytest.raises(RcdnError, match=message):
        PairGuide(**{"image_sizes": ((640, 480), (640, 480)), "spacing": 0.03} | given)


@pytest.mark.parametrize("boards", [(None, None), (None,)])
def test_a_moment_without_a_board_is_refused(boards):
    guide = PairGuide((BROWN.image_size, BROWN.image_size), SPACING)
    with pytest.raises(ConfigError, match="one of them at least"):
        guide.add(boards, "0")


@pytest.mark.parametrize(
    ("seen", "greys", "message"),
    [
        (lambda a, b: ([a], b), None, r"boards\[0\] must be one Board or None, not a list"),
        (lambda a, b: (a, [b]), None, r"boards\[1\] must be one Board or None, not a list"),
        (lambda a, b: a, None, "boards must have the board of the left and of the right picture, None where"),
        (lambda a, b: (a, replace(b, image_size=(80, 60))), None, r"boards\[1\] must be of a picture of 640×480 px"),
        (lambda a, b: (a, b), np.zeros((480, 640), np.uint8), "greys must have the frame of the left and of the right"),
        (lambda a, b: (a, b), [np.zeros((480, 640, 3), np.uint8)] * 2, r"greys\[0\] must be the whole frame in grey"),
    ],
)
def test_a_moment_is_judged_by_a_board_and_a_frame_of_each_camera(started, seen, greys, message):
    with pytest.raises(ConfigError, match=message):
        started.look(seen(*moment(wanted_pose(started))), 900.0, greys)


def test_both_frames_may_be_one_array(started):
    seen, frames = moment(wanted_pose(started)), np.zeros((2, 480, 640), np.uint8)
    together, apart = (started.look(seen, 900.0, greys) for greys in (frames, list(frames)))
    assert repr(together) == repr(apart)


def test_a_moment_of_another_picture_size_is_refused():
    guide = PairGuide((BROWN.image_size, BROWN.image_size), SPACING)
    left, right = moment(BEGIN)
    with pytest.raises(ConfigError, match=r"first\[1\] must be of a picture of 640×480 px, not 800×600"):
        guide.add((left, replace(right, image_size=(800, 600))), "first")
