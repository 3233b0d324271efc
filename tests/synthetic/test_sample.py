"""Random scenes keep to their ranges; crops are a function of their seed, with labels where the corners are."""

import functools

import numpy as np
import pytest

from rcdn.errors import ConfigError
from rcdn.geometry import unproject
from rcdn.synthetic import HARD, ORDINARY, PRESETS, TRAINING, Ranges, random_crop, random_scene, truth
from rcdn.synthetic.background import KINDS, paint
from rcdn.synthetic.crops import crop_scene
from rcdn.synthetic.scene import Background
from rcdn.synthetic.surface import board_to_pixels

pytestmark = pytest.mark.xdist_group("sample")  # the same scenes


@functools.cache
def hard_scenes():
    return [random_scene(np.random.default_rng(seed), HARD) for seed in range(250)]


def tilt(scene, spec):
    """Angle, degrees, of a board to the axis, or (fisheye) to the line of sight of its middle; px per square."""
    pose = spec.pose
    middle = pose.R @ [(spec.cols - 1) / 2, (spec.rows - 1) / 2 * spec.aspect, 0] + pose.t
    fisheye = scene.model == "fisheye"
    sight = middle / np.linalg.norm(middle) if fisheye else np.array([0, 0, 1.0])
    return np.degrees(np.arccos(sight @ pose.R[:, 2])), scene.focal / (np.linalg.norm(middle) if fisheye else middle[2])


def test_hard_boards_keep_to_their_ranges():
    seen = [(spec, *tilt(scene, spec)) for scene in hard_scenes() for spec in scene.boards]
    angles, pitches = np.array([a for _, a, _ in seen]), np.array([p for *_, p in seen])
    assert angles.max() <= 75 + 1e-6
    assert (angles > 60).mean() > 0.2
    assert pitches.min() >= 6 - 1e-6
    assert pitches.max() <= 60 + 1e-6
    for spec, *_ in seen:
        assert 3 <= min(spec.cols, spec.rows) <= max(spec.cols, spec.rows) <= 14
        assert 0.8 <= spec.aspect <= 1.25
        assert abs(spec.bleed) <= 0.06
        assert spec.white - spec.black >= 0.35


def test_hard_scenes_keep_to_their_ranges():
    for scene in hard_scenes():
        s = scene.sensor
        assert 0.4 <= s.blur <= 4
        assert s.disk <= 6
        assert 0 < s.noise <= min(60, 110 * s.gain)
        assert 0.12 <= s.gain <= 0.9
        assert s.offset + s.gain <= 0.95 + 1e-9
    share = np.mean(
        [[len(s.boards) == 0, len(s.boards) > 1, s.model == "fisheye", s.sensor.invert] for s in hard_scenes()], axis=0
    )
    assert share == pytest.approx([0.12, 0.18, 0.3, 0.5], abs=0.08)


@pytest.mark.parametrize("size", [(640, 480), (320, 240)])
def test_ordinary_boards_are_wholly_inside(size):
    for seed in range(25):
        scene = random_scene(np.random.default_rng(seed), ORDINARY, size)
        (known,) = truth(scene)
        assert len(scene.boards) == 1
        assert known.visible.all()
        assert (known.xy >= 10).all()
        assert (known.xy <= np.array(size) - 11).all()
        assert tilt(scene, scene.boards[0])[0] <= 50 + 1e-6
        assert known.pitch.min() > 6.5


def test_a_frame_too_small_is_refused():
    with pytest.raises(ConfigError, match="40 × 30"):
        random_scene(np.random.default_rng(0), ORDINARY, (40, 30))


def test_the_middle_of_a_board_is_seen_where_it_was_put():
    """Every board of any lens lies at least partly in the frame's inner part."""
    for scene in hard_scenes()[:60]:
        for spec in scene.boards:
            middle = np.array([[(spec.cols - 1) / 2, (spec.rows - 1) / 2]])
            if spec.bend is None and np.isfinite(unproject(scene.camera, np.array([[128, 96], [512, 384.0]]))).all():
                x, y = board_to_pixels(spec, scene.camera, middle)[0] / [640, 480]
                assert 0.2 - 1e-6 <= x <= 0.8 + 1e-6
                assert 0.2 - 1e-6 <= y <= 0.8 + 1e-6


def test_a_seed_is_a_scene():
    for ranges in PRESETS.values():
        one, same, other = (random_scene(np.random.default_rng(s), ranges) for s in (3, 3, 4))
        assert one == same != other
    assert random_scene(np.random.default_rng(0), Ranges(none_p=1.0)).boards == ()


def test_a_seed_is_a_crop():
    picture, labels = random_crop(5, 64, HARD)
    again, same = random_crop(5, 64, HARD)
    assert np.array_equal(picture, again)
    assert np.array_equal(labels, same)
    assert not np.array_equal(picture, random_crop(6, 64, HARD)[0])
    assert picture.shape == (64, 64)
    assert picture.dtype == np.uint8


def test_labels_are_the_truth_in_the_window():
    sure = doubtful = 0
    for seed in range(20):
        scene, (x, y, w, h) = crop_scene(seed, 112, HARD, 0)
        assert (w, h) == (112, 112)
        assert 0 <= x <= 640 - 112
        assert 0 <= y <= 480 - 112
        labels = random_crop(seed, 112, HARD)[1]
        assert labels.shape[1] == 3
        assert ((labels[:, :2] > -8) & (labels[:, :2] < 120)).all()
        known = truth(scene)
        for lx, ly, kind in labels:
            spot = [(b, k) for b in known for k in np.flatnonzero((np.abs(b.xy - [x + lx, y + ly]) < 1e-9).all(axis=1))]
            assert spot
            assert all(b.visible[k] or (b.ignore[k] and kind == 0) for b, k in spot)
        sure, doubtful = sure + int(labels[:, 2].sum()), doubtful + int((labels[:, 2] == 0).sum())
    assert min(sure, doubtful) > 50


def test_most_windows_hold_a_corner():
    hits = []
    for seed in range(60):
        scene, (x, y, w, h) = crop_scene(seed, 112, HARD, 0)
        inside = [
            ((b.xy[b.visible] >= [x, y]) & (b.xy[b.visible] < [x + w, y + h])).all(axis=1).any() for b in truth(scene)
        ]
        hits += [any(inside)] if scene.boards else []
    assert np.mean(hits) > 0.85


def test_photographs_stand_behind_the_boards():
    photo = np.tile(np.arange(0, 250, dtype=np.uint8), (200, 1))
    spec = Background("image", seed=1, image=5)
    picture = paint(spec, 80, 60, [photo, photo // 2])
    assert picture.shape == (60, 80)
    assert picture.max() <= 125 / 255  # the index wraps: the second picture
    assert np.array_equal(paint(spec, 80, 60), paint(Background("noise", seed=1), 80, 60))
    kinds = {random_scene(np.random.default_rng(s), TRAINING, image_count=2).background.kind for s in range(40)}
    assert "image" in kinds


@pytest.mark.parametrize("kind", KINDS)
def test_backgrounds_fill_the_frame(kind):
    spec = Background(kind, seed=3)
    picture = paint(spec, 90, 50)
    assert picture.shape == (50, 90)
    assert picture.dtype == np.float32
    assert 0 <= picture.min() <= picture.max() <= 1
    assert np.array_equal(picture, paint(spec, 90, 50))
    assert (picture.std() > 0.01) == (kind != "plain")
