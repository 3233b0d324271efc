"""Pictures that tell most: they are found among many that tell little, and make nearly the camera of all."""

from itertools import combinations

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.candidates import frame_grid
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.selection import (
    _by_picture,
    _exchanged,
    _greedy,
    _with_one_more,
    informative_subsets,
    selected,
)
from rcdn.calibration.uncertainty import unrotated_jacobian
from rcdn.errors import CalibrationError, ConfigError
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards, random_pose, see

BROWN = CAMERAS["brown"]


def seen(T, rng):
    """The board at `T`, with noise."""
    ij, xy = see(BROWN, T)
    return board(ij, xy + rng.normal(0, 0.2, xy.shape), BROWN.image_size, np.full(len(xy), 0.2))


@pytest.fixture(scope="module")
def mixed():
    """24 pictures of a far board in the middle, hardly tilted, and among them 8 all over the frame."""
    rng = np.random.default_rng(3)
    dull = [seen(random_pose(rng, 0.05, 0.15, (0.9, 1.0)), rng) for _ in range(24)]
    informative = random_boards(BROWN, 4, 8, noise=0.2, whole=True, spread=0.3)[0]
    boards, names = [], []
    for k in range(32):
        boards.append(informative[k // 4] if k % 4 == 3 else dull[k - k // 4])
        names.append(f"{'telling' if k % 4 == 3 else 'dull'} {k:02d}")
    return boards, names, calibrate(boards, SPACING, names=names, model="brown", flat=True)


def test_telling_pictures_are_found(mixed):
    _, _, done = mixed
    (chosen,) = informative_subsets(done, 8, 1)
    assert len(chosen) == 8
    assert sum(name.startswith("telling") for name in chosen) >= 7
    assert list(chosen) == sorted(chosen, key=lambda name: int(name.split()[1]))


def test_they_make_nearly_the_camera_of_all(mixed):
    boards, names, done = mixed

    def calibrated(some):
        return calibrate([boards[names.index(n)] for n in some], SPACING, names=list(some), model="brown", flat=True)

    def off(found):
        return camera_difference(done.camera, found.camera).rms

    chosen, found = selected(done, 8, calibrated)
    assert tuple(v.name for v in found.views) == chosen
    first = off(calibrated(informative_subsets(done, 8, 1)[0]))
    rng = np.random.default_rng(1)
    assert off(found) <= first
    assert off(found) < 0.3 * np.median([off(calibrated(rng.choice(names, 8, replace=False))) for _ in range(9)])


def test_they_come_nearer_to_the_true_camera():
    """Not only to the estimate of all: 10 of 24 random pictures of three cameras, geometric mean of the distances from
    the true one, relative to the pictures with the most information and to the first ten."""
    ratios = []
    for seed in range(3):
        boards, _ = random_boards(BROWN, seed, 24, noise=0.3)
        names = [f"{k:02d}" for k in range(24)]
        done = calibrate(boards, SPACING, names=names, model="brown", flat=True)

        def calibrated(some, boards=boards, names=names):
            kept = [boards[names.index(n)] for n in some]
            return calibrate(kept, SPACING, names=list(some), model="brown", flat=True)

        def off(found):
            return camera_difference(BROWN, found.camera).rms

        mine = off(selected(done, 10, calibrated)[1])
        ratios.append((mine / off(calibrated(informative_subsets(done, 10, 1)[0])), mine / off(calibrated(names[:10]))))
    of_first, of_random = np.exp(np.log(ratios).mean(axis=0))
    assert of_first < 1
    assert of_random < 0.5


def test_subsets_that_determine_no_camera_are_passed_over(mixed):
    _, _, done = mixed
    first, *others = informative_subsets(done, 8, 4)

    def solve(names):
        if names == first:
            raise CalibrationError("no camera")
        return done

    assert selected(done, 8, solve)[0] == others[0]

    def never(names):
        raise CalibrationError("no camera")

    with pytest.raises(CalibrationError, match="no camera"):
        selected(done, 8, never)


def test_hardly_any_other_set_of_three_tells_more(mixed):
    """All 1,140 choices of 3 of 20 pictures, by their mean variance."""
    _, _, done = mixed
    views = done.used_views
    information = _by_picture(done, views, [v.name for v in views])[:20]
    slopes, there = unrotated_jacobian(done.camera, frame_grid(done.camera.image_size))
    rows = slopes[there].reshape(-1, slopes.shape[2])

    def variance(some):
        return _with_one_more(list(some[:2]), information, rows)[some[2]]

    every = sorted(variance(list(some)) for some in combinations(range(20), 3))
    found = _exchanged(_greedy(3, information, rows), information, rows)
    assert variance(found) <= every[len(every) // 100]


def test_all_are_taken_where_there_are_no_more(mixed):
    _, names, done = mixed
    (every,) = informative_subsets(done, 100, 8)
    assert set(every) <= set(names)
    assert len(every) == len({v.name for v in done.used_views})


def test_pictures_with_several_boards_count_once():
    boards, _ = random_boards(BROWN, 6, 12, noise=0.2)
    names = [f"{k // 2}" for k in range(12)]
    done = calibrate(boards, SPACING, names=names, model="brown", flat=True)
    (chosen,) = informative_subsets(done, 4, 1)
    assert len(set(chosen)) == len(chosen) == 4


def test_too_few_are_refused(mixed):
    with pytest.raises(ConfigError, match="many must be at least 3"):
        informative_subsets(mixed[2], 2, 1)
