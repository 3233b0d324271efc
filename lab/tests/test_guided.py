"""The judge of guidance: its error is zero for the same lens turned, its counting right, its people different."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration.candidates import frame_grid
from rcdn_lab import guided as suite
from rcdn_lab.camera_scenes import CAMERAS
from rcdn_lab.guided import Curve, Scene

BROWN = CAMERAS["brown"]


def test_the_same_camera_is_not_off():
    assert suite.corner_error(BROWN, BROWN) == pytest.approx(0, abs=1e-9)


def test_a_shift_that_a_rotation_makes_up_for_hardly_counts():
    """The principal point by 1 px: most of it is a rotation; the focal length by 1 % isn't,
    and moves corners 400 px off by 4 px."""
    K = BROWN.K.copy()
    K[0, 2] += 1
    assert suite.corner_error(replace(BROWN, K=K), BROWN) < 0.4
    K = BROWN.K * [[1.01, 1, 1], [1, 1.01, 1], [1, 1, 1]]
    assert suite.corner_error(replace(BROWN, K=K), BROWN) > 1.5


@pytest.mark.parametrize(
    ("off", "needed"),
    [
        ([0.4, 0.2, 0.05, 0.04], 7.0),
        ([0.05, 0.04, 0.03, 0.02], 4.0),
        ([0.4, 0.05, 0.2, 0.05], 9.0),
        ([0.4, 0.3, 0.2, 0.2], np.inf),
        ([np.inf, np.inf, 0.05, 0.04], 8.0),
    ],
)
def test_pictures_needed(off, needed):
    """Between two counts the error is a straight line on a logarithmic scale; what rises again isn't reached."""
    curve = Curve(np.array([4, 6, 8, 10]), np.array([off]), np.array([off]))
    assert curve.needed(0.1) == pytest.approx(needed, abs=1e-9)


def test_deviations_that_are_true_are_called_so():
    """Errors drawn with the stated deviations, one run without a camera; and errors three times as large."""
    rng = np.random.default_rng(5)
    stated = rng.uniform(0.1, 1, (400, 4))
    off = stated * np.abs(rng.normal(size=stated.shape))
    off[0] = stated[0] = np.nan
    counts = np.array([4, 6, 8, 10])
    assert Curve(counts, off, stated).stated_by_true == pytest.approx(1, abs=0.05)
    assert Curve(counts, 3 * off, stated).stated_by_true == pytest.approx(1 / 3, abs=0.02)


def test_an_evaluation_goes_on_where_it_was_ended(tmp_path, monkeypatch):
    """Only people that the file doesn't hold, or of other code, are simulated again; the figures are the same."""
    done = []

    def errors_of(run):
        done.append(run)
        return np.array([[0.4 / (1 + run.seed), np.nan], [0.1, 0.2]])

    monkeypatch.setattr(suite, "errors_of", errors_of)
    monkeypatch.setattr(suite, "COUNTS", (6, 10))
    kept = suite.Kept(tmp_path / "people.jsonl", "a")
    first = suite.rows_of(1, 10, 1, kept=kept)
    people = len(done)
    assert people == len(suite.PEOPLE) * len(suite.LENSES) * len(suite.BOARDS)
    assert suite.rows_of(1, 10, 1, kept=kept) == first
    assert len(done) == people
    suite.rows_of(2, 10, 1, kept=kept)
    assert {run.seed for run in done[people:]} == {1}
    suite.rows_of(1, 10, 1, kept=replace(kept, code="b"))
    assert len(done) == 3 * people
    kept.path.write_text(kept.path.read_text()[:-9])  # the last line is of "b"; it was cut off
    suite.rows_of(1, 10, 1, kept=replace(kept, code="b"))
    assert len(done) == 3 * people + 1
    assert suite.rows_of(2, 10, 1, kept=replace(kept, code="b"))
    assert len(done) == 4 * people + 1


def test_poses_at_random_fill_the_frame():
    scene, rng = Scene(BROWN, None), np.random.default_rng(1)
    middles = np.array([scene.anywhere(rng).xy.mean(axis=0) for _ in range(100)])
    assert (np.ptp(middles, axis=0) > 0.6 * np.array(BROWN.image_size)).all()


def test_going_where_nothing_was_covers_more_than_chance():
    scene = Scene(BROWN, None)

    def covered(person, monkey):
        boards = []
        monkey.setattr(suite, "_calibrated", lambda scene, some: boards.extend(some))
        person(scene, 0, 3)
        return np.any([suite._cells(b) for b in boards], axis=0).mean()

    with pytest.MonkeyPatch.context() as monkey:
        assert covered(suite.by_coverage, monkey) > 1.1 * covered(suite.at_random, monkey)
    assert len(frame_grid(BROWN.image_size)) == 130
