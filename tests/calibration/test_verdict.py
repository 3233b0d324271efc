"""The verdict on a calibration: each fault where it belongs, none where all is well, the same words everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.advice import judged, notes
from rcdn.calibration.facts import measure, measure_board
from rcdn.calibration.fit_checks import projections
from rcdn.calibration.limits import LIMITS, STEREO_LIMITS, growth, reason
from rcdn.calibration.verdict import fails, headline, judge, verdict_of
from rcdn.calibration.view_checks import THIRDS
from rcdn.calibration.view_facts import measure_views, places, tilts
from rcdn.errors import two_digits
from rcdn.types import LEVELS, BoardShape, Camera, ModelScore, Pose, Reason, Verdict
from rcdn_lab import bad_cases
from rcdn_lab.camera_scenes import CAMERAS, SPACING, board, random_boards
from rcdn_lab.real_boards import curved_board

BROWN = CAMERAS["brown"]


@pytest.fixture(scope="module")
def good():
    return calibrate(random_boards(BROWN, 3, 40)[0], SPACING, model="brown")


def found(calibration, key):
    """The reason of the check `key`."""
    return {r.key: r for r in judge(calibration).reasons}[key]


def test_a_good_calibration_is_good(good):
    assert good.verdict.judged
    assert good.verdict.level == "good"
    assert good.verdict == judge(good)
    assert good.verdict.against == judged(good).advice == good.advice == ()
    assert headline(good.verdict) == "Good: use this camera."
    assert headline(good.verdict, several=True) == "Good: use these cameras."


def with_model(good, ratio):
    return replace(good, models=(ModelScore("brown", 0.3, 0.3 * ratio),))


def with_cov(good, entry, std):
    cov = good.cov.copy()
    cov[entry, entry] = std**2
    return replace(good, cov=cov)


def scaled(good, factor):
    return replace(good, views=tuple(replace(v, residuals=v.residuals * factor) for v in good.views))


def without(good, out):
    """Corners for which `out(view)` (M,) is true are left out."""
    return replace(good, views=tuple(replace(v, used=v.used & ~out(v)) for v in good.views))


def shifted(good, shift):
    """`shift(view)` (M, 2) px added to the residuals."""
    return replace(good, views=tuple(replace(v, residuals=v.residuals + shift(v)) for v in good.views))


def left_out(good, many):
    views = [
        replace(v, reason="wrong", used=np.zeros(len(v), bool)) if k < many else v for k, v in enumerate(good.views)
    ]
    return replace(good, views=tuple(views))


def in_thirds(good, fold):
    """Every board's picture repeated `fold` times, moved by half a pixel: near-duplicates."""
    return replace(good, views=tuple(replace(v, xy=v.xy + 0.5 * k) for v in good.views[:4] for k in range(fold)))


def slowly(good, step=10):
    """The first board, moved by `step` px from picture to picture of a slow video."""

    def later(view, k):
        T = view.pose.T_cam_board.copy()
        T[0, 3] += k * step * T[2, 3] / good.camera.K[0, 0]
        return replace(view, pose=Pose(T))

    return replace(good, views=tuple(later(good.views[0], k) for k in range(20)))


WEAK = {
    "few": (lambda c: replace(c, views=c.views[:6]), "views", "fair", "Only 6 views"),
    "very few": (lambda c: replace(c, views=c.views[:4]), "views", "unsure", "Only 4 views"),
    "near-duplicates": (lambda c: in_thirds(c, 5), "views", "unsure", "only 4 different places"),
    "loose focal length": (lambda c: with_cov(c, 0, 7.8), "focal", "fair", "only to ±1.5%"),
    "no focal length": (lambda c: with_cov(c, 0, 100.0), "focal", "bad", "only to ±"),
    "loose centre": (lambda c: with_cov(c, 2, 25.0), "centre", "unsure", "only to ±25 px"),
    "worse in new pictures": (lambda c: with_model(c, 1.5), "held_out", "fair", "1.5 times worse"),
    "much worse in new ones": (lambda c: with_model(c, 4.0), "held_out", "bad", "4.0 times worse"),
    "nothing held out": (lambda c: with_model(c, np.nan), "held_out", "fair", "Too few pictures"),
    "millimetres": (lambda c: replace(c, spacing=25.0), "spacing", "unsure", "25 m"),
    "rough": (lambda c: scaled(c, 4), "rms", "unsure", "An RMS of 1."),
    "very rough": (lambda c: scaled(c, 10), "rms", "bad", "An RMS of 2."),
    "corners left out": (lambda c: without(c, lambda v: np.arange(len(v)) % 6 == 0), "dropped", "unsure", "(1"),
    "views left out": (lambda c: left_out(c, 10), "left_out", "unsure", "10 of 40 views"),
    "a region left out": (
        lambda c: without(c, lambda v: np.hypot(*(v.xy - [440, 280]).T) < 60), "crowded", "unsure", "sit together",
    ),
    "a lens that isn't followed": (
        lambda c: shifted(c, lambda v: np.column_stack([np.sin(v.xy[:, 0] / 60), 0 * v.xy[:, 0]]) * 0.7), "systematic",
        "unsure", "systematically off",
    ),
    "a bent board": (
        lambda c: shifted(c, lambda v: 1.0 * np.sin(v.ij + v.xy.sum() % 7)), "smooth", "unsure", "err alike",
    ),
}  # fmt: skip


def test_of_a_board_that_moves_slowly_the_places_count(good):
    """Of 20 pictures that are .8 of a near-duplicate's distance apart every other one is a new place."""
    assert measure_views(slowly(good)).distinct == 10
    assert measure_views(slowly(good, 0.1)).distinct == 1


@pytest.mark.parametrize("case", WEAK)
def test_each_weakness_is_said(good, case):
    change, key, level, text = WEAK[case]
    weak = change(good)
    against = found(weak, key)
    assert against.level == level
    assert text in against.sentence
    assert against.action
    assert LEVELS.index(judge(weak).level) >= LEVELS.index(level)
    assert any(against.sentence in line for line in judged(weak).advice)


def test_a_simpler_lens_is_advised_where_none_was_tried_or_one_predicts_better(good):
    asked = with_model(good, 1.5)
    other = replace(asked.models[0], model="pinhole")
    tried = replace(asked, models=(*asked.models, other))
    splined = replace(asked, models=(*asked.models, replace(other, held_out=0.8 * other.held_out)))
    assert "a simpler lens model" in found(asked, "held_out").action
    assert "lens model" not in found(tried, "held_out").action
    assert "a simpler lens model" in found(splined, "held_out").action  # asked for, though another predicts better


def test_views_of_which_half_are_rougher_are_said(good):
    views = tuple(replace(v, residuals=v.residuals * (6 if k % 2 else 1)) for k, v in enumerate(good.views))
    assert found(replace(good, views=views), "uneven").level == "unsure"
    quiet = replace(good, views=tuple(replace(v, residuals=v.residuals / 20) for v in views))
    assert found(quiet, "uneven").level == "good"  # a tenth of a pixel doesn't matter


def test_a_stretched_print_is_said(good):
    camera = good.camera.with_parameters(good.camera.parameters * np.r_[1, 1.05, np.ones(7)])
    assert found(replace(good, camera=camera), "aspect").level == "unsure"
    unknown = with_cov(replace(good, camera=camera), 1, 0.05 * 515)
    assert found(unknown, "aspect").level == "good"  # it isn't known


@pytest.mark.parametrize("seed", [0, 1])
def test_the_shape_of_the_board_is_measured(seed):
    """A print stretched by 4 % and a board bent by 2 and −1.5 mm of 240 both come out, and a flat one is flat."""
    rng = np.random.default_rng(seed)
    for offsets, stretch in ((None, 0.0), (bad_cases.OBLONG, 0.04), (curved_board((0.002, -0.0015)), 0.0)):
        boards = bad_cases.views(lambda T, s=offsets: bad_cases.view(BROWN, T, rng, offsets=s), rng)
        shape = measure_board(calibrate(boards, SPACING, model="brown"))
        bend = 0.0 if offsets is None else BoardShape(offsets.reshape(6, 9, 3)).bend / 0.24
        assert shape.stretch == pytest.approx(stretch, abs=0.0025)
        assert shape.bend == pytest.approx(bend, abs=0.0006)


def test_a_lens_that_turns_back_inside_the_picture_is_said(good):
    """x·(1 − 0.9·r²) turns back at r = 0.61; the picture's corners lie at 0.77."""
    parameters = good.camera.parameters.copy()
    parameters[4:] = [-0.9, 0, 0, 0, 0]
    folded = replace(good, camera=good.camera.with_parameters(parameters))
    assert "breaks down inside the picture" in found(folded, "reach").sentence
    assert found(folded, "reach").level in ("unsure", "bad")
    assert "another model (fisheye for a wide lens)" in found(folded, "reach").action


def test_corners_without_a_ray_are_told_from_unknown_ones(good):
    facts = measure(good)
    sentences = [projections(good, replace(facts, at_corners=v))[1].sentence for v in (40.0, np.inf, np.nan)]
    assert sentences == [
        "Towards the corners of the picture projections are known only to ±40 px.",
        "Towards the corners of the picture projections are not known at all: the lens model has no rays there.",
        "Towards the corners of the picture projections are not known at all.",
    ]


def test_a_fisheye_is_not_told_to_become_one(good):
    fisheye = Camera(good.camera.K, np.array([-3.0, 0, 0, 0]), good.camera.image_size, "fisheye")  # turns back at 19°
    short = np.delete(np.arange(len(good.cov)), 8)  # without k3
    reach = found(replace(good, camera=fisheye, cov=good.cov[np.ix_(short, short)]), "reach")
    assert "breaks down inside the picture" in reach.sentence
    assert reach.action == "Bring the board into the corners of the picture."


def test_empty_thirds_are_named(good):
    views = tuple(replace(v, used=v.used & (v.xy[:, 0] < 300)) for v in good.views)
    sentence = found(replace(good, views=views), "coverage").sentence
    assert all(row[2] in sentence for row in THIRDS)
    assert "lower left" not in sentence


def test_a_board_named_by_its_squares_is_noticed():
    boards, _ = random_boards(BROWN, 3, 12, whole=True)
    named = calibrate(boards, SPACING, model="brown", size=(10, 7))
    assert named.verdict.against[0].key == "board_size"
    assert "9×6" in named.verdict.against[0].action
    assert named.verdict.level == "unsure"
    assert not any(r.key == "board_size" for r in calibrate(boards, SPACING, model="brown").verdict.reasons)


@pytest.mark.parametrize("size", [(9, 7), (6, 10), (20, 20)], ids=str)
def test_a_board_that_is_never_seen_is_noticed(size):
    boards, _ = random_boards(BROWN, 3, 12, whole=True)
    verdict = calibrate(boards, SPACING, model="brown", size=size).verdict
    (against,) = [r for r in verdict.against if r.key == "board_size"]
    assert "100% show exactly 9×6 corners: was another board named" in against.sentence
    assert ("6×9" if size == (6, 10) else "9×6") in against.action


def test_one_view_that_is_a_row_and_a_column_smaller_names_no_board():
    boards, _ = random_boards(BROWN, 3, 12, whole=True)
    inside = (boards[0].ij < [8, 6]).all(axis=1)
    boards[0] = board(boards[0].ij[inside], boards[0].xy[inside], boards[0].image_size)
    verdict = calibrate(boards, SPACING, model="brown", size=(9, 7)).verdict
    (against,) = [r for r in verdict.against if r.key == "board_size"]
    assert "92% show exactly 9×6" in against.sentence


def test_parts_of_a_large_board_are_no_other_board():
    boards, _ = random_boards(BROWN, 3, 12, whole=True)
    inside = [(b.ij < [4 + k % 5, 3 + k % 3]).all(axis=1) for k, b in enumerate(boards)]
    parts = [board(b.ij[i], b.xy[i], b.image_size) for b, i in zip(boards, inside, strict=True)]
    found = calibrate(parts, SPACING, model="brown", size=(9, 6))
    assert not any(r.key == "board_size" for r in found.verdict.reasons)


def test_pictures_of_another_size_are_said():
    boards, _ = random_boards(BROWN, 3, 20)
    odd = [replace(b, image_size=(1280, 720)) if k < 4 else b for k, b in enumerate(boards)]
    verdict = calibrate(odd, SPACING, model="brown").verdict
    assert verdict.against[0].key == "picture_size"
    assert "4 pictures of 20" in headline(verdict)


def test_boards_that_hardly_tilt_are_said():
    flat = calibrate(random_boards(CAMERAS["pinhole"], 1, 10, 0.05, tilt=0.15)[0], SPACING, model="pinhole")
    assert "nearly faces the camera" in headline(flat.verdict)


def test_tilts_are_between_board_and_sensor():
    boards, poses = random_boards(BROWN, 3, 8, whole=True)
    tilted = calibrate(boards, SPACING, model="brown")
    true = np.degrees(np.arccos(np.abs([T[2, 2] for T in poses])))
    assert tilts(tilted) == pytest.approx(true, abs=2)


def test_tilts_to_one_side_have_no_spread(good):
    assert measure(good).views.spread > 10
    one = good.views[0]
    axis = np.linalg.svd(one.pose.R[:2, 2][None])[2][0]
    alike = [v for v in good.views if abs(axis[0] * v.pose.R[1, 2] - axis[1] * v.pose.R[0, 2]) < 0.1]
    assert len(alike) > 3
    assert measure(replace(good, views=tuple(alike))).views.spread < 5


def test_places_tell_duplicates(good):
    twice = replace(good, views=good.views[:10] * 2)
    group = places(twice, list(twice.views))
    assert len(set(group.tolist())) == 10
    assert (group[:10] == group[10:]).all()


def test_noise_is_not_systematic_and_has_no_correlation():
    """Cells beyond three standard errors: one in 90 by chance; smoothing by the fit leaves a little
    negative correlation."""
    share, correlation = [], []
    for seed in range(4):
        residuals = measure(calibrate(random_boards(BROWN, seed, 30, noise=0.5)[0], SPACING, model="brown")).residuals
        share.append(residuals.cells.share)
        correlation.append(residuals.correlation)
    assert np.mean(share) < 0.05
    assert abs(np.mean(correlation)) < 0.1


@pytest.mark.parametrize("limit", [*LIMITS.values(), *STEREO_LIMITS.values()], ids=lambda x: x.what)
def test_every_limit_goes_from_good_to_bad(limit):
    away = -1 if limit.rising else 1
    bounds = np.array([b for b in limit.bounds if np.isfinite(b)])
    assert (np.diff(bounds) * away >= 0).all()
    assert limit.level(limit.good) == "good"
    assert limit.level(limit.good + 1e-9 * away) != "good"
    levels = [LEVELS.index(limit.level(v)) for v in np.sort([*bounds, *(bounds + 1e-9), *(bounds - 1e-9)])[::away]]
    assert levels == sorted(levels)
    assert limit.level(float("nan")) == "unsure"
    assert limit.why
    assert limit.words("good")


def test_limits_grow_with_large_pictures_only():
    assert growth((640, 480)) == 1
    assert growth((3200, 2400)) == 2
    assert reason("rms", 0.9, "", "", "").level == "fair"
    assert reason("rms", 0.9, "", "", "", factor=2.0).level == "good"
    assert reason("rms", 1.5, "", "", "", factor=2.0).limit == 1.0
    assert reason("focal", 0.01, "", "", "", factor=2.0).level == "fair"


def test_the_verdict_is_its_gravest_reason():
    reasons = [
        Reason(str(k), level, "", 0, 0, "", f"{k}.", "Do.")
        for k, level in enumerate(("good", "unsure", "fair", "unsure"))
    ]
    verdict = verdict_of(reasons)
    assert verdict.level == "unsure"
    assert [r.key for r in verdict.reasons] == ["1", "3", "2", "0"]
    assert headline(verdict) == "Unsure: 1. Do."
    assert headline(verdict_of(reasons[2:3])) == "Fair: usable with care. 2. Do."


@pytest.mark.parametrize(
    ("value", "text"), [(0.1234, "0.12"), (5.7, "5.7"), (99.4, "99"), (99.6, "100"), (202.8, "203"), (5105.3, "5105")]
)
def test_uncertainties_have_two_digits_or_all_before_the_point(value, text):
    assert two_digits(value) == text


def test_fails_counts_from_the_level_on():
    unsure = Verdict("unsure")
    assert [fails(unsure, level) for level in LEVELS] == [True, True, True, False]


def test_notes_are_no_judgement(good):
    symmetric = replace(good, size=(8, 6), orientation="ambiguous_180")
    assert "half a turn" in notes(symmetric)[0]
    assert judge(symmetric).level == "good"
    assert "quarter turns" in notes(replace(good, size=(6, 6), orientation="ambiguous_90"))[-1]
    assert "name its size" in notes(replace(good, size=None, orientation=None))[0]
    assert notes(good) == ()
