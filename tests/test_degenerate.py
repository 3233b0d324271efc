"""Boards in a line, in a point, of two corners, far away or without places: an answer or one clear error,
and nothing is printed."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from rcdn import estimate_pose
from rcdn.calibration import calibrate
from rcdn.errors import CalibrationError, RcdnError
from rcdn.geometry import unproject
from rcdn.precision import sharpen
from rcdn.precision.lattice import lattice
from rcdn.types import BoardShape
from rcdn_lab.camera_scenes import CAMERAS, random_boards

CAMERA = CAMERAS["brown"]
LINE = np.array([1.0, 0.5])


def scattered(xy, ij, to=0.0):
    """All corners along a line, `to` px beside it."""
    return xy.mean(axis=0) + np.outer(ij @ [10.0, 3.0], LINE) + np.random.default_rng(1).normal(0, to, xy.shape)


def at(index, value):
    """A change of some positions."""

    def change(xy, ij):
        xy = xy.copy()
        xy[index] = value
        return xy

    return change


PLACES = {
    "a point": lambda xy, ij: np.full_like(xy, 100.0),
    "a line": scattered,
    "nearly a line": lambda xy, ij: scattered(xy, ij, 1e-9),
    "a line, rounded": lambda xy, ij: scattered(xy, ij, 1e-3),
    "a line and a corner": lambda xy, ij: at(0, xy[0] + [30.0, -40.0])(scattered(xy, ij), ij),
    "half in a point": at(slice(None, None, 2), 100.0),
    "all but one in a point": at(slice(1, None), 100.0),
    "some unknown": at(slice(0, 3), np.nan),
    "all unknown": at(slice(None), np.nan),
    "infinite": at(0, np.inf),
    "one far away": at(3, 1e6),
    "all far away": lambda xy, ij: xy + 1e6,
    "huge": lambda xy, ij: xy * 1e4,
    "small": lambda xy, ij: xy.mean(axis=0) + 1e-3 * (xy - xy.mean(axis=0)),
    "tiny": lambda xy, ij: xy.mean(axis=0) + 1e-9 * (xy - xy.mean(axis=0)),
    "shuffled": lambda xy, ij: np.random.default_rng(2).permutation(xy),
    "mirrored": lambda xy, ij: xy * [-1.0, 1.0] + [640.0, 0.0],
    "random": lambda xy, ij: np.random.default_rng(3).uniform(0, 480, xy.shape),
}
PARTS = {
    "none": lambda ij: np.zeros(len(ij), bool),
    "one": lambda ij: np.arange(len(ij)) < 1,
    "two": lambda ij: np.arange(len(ij)) < 2,
    "a row": lambda ij: ij[:, 1] == 0,
    "a row and a corner": lambda ij: (ij[:, 1] == 0) | (ij == [0, 1]).all(axis=1),
    "a row and a column": lambda ij: (ij == 0).any(axis=1),
}
SIGMAS = {"no": 0.0, "unknown": np.nan, "endless": np.inf, "hardly any": 1e-12}


@pytest.fixture(scope="module")
def boards():
    return random_boards(CAMERA, 5, 8, whole=True)[0]


def part(board, keep):
    names = ("xy", "ij", "sigma", "response", "status")
    return replace(board, **{name: getattr(board, name)[keep] for name in names})


def degenerate(boards, kind):
    for board in boards:
        if kind in PLACES:
            yield replace(board, xy=PLACES[kind](board.xy, board.ij))
        elif kind in PARTS:
            yield part(board, PARTS[kind](board.ij))
        else:
            yield replace(board, sigma=np.full(len(board), SIGMAS[kind]))


@pytest.fixture
def quiet(capfd):
    """Nothing on stdout or stderr, LAPACK's own words included. Warnings are errors anyway."""
    capfd.readouterr()
    yield
    assert capfd.readouterr() == ("", "")


def test_no_board_is_infinitely_far(boards):
    with pytest.raises(RcdnError, match=r"Board\.xy"):
        next(degenerate(boards[:1], "infinite"))


@pytest.mark.parametrize("kind", [*(k for k in PLACES if k != "infinite"), *PARTS, *SIGMAS])
def test_a_pose_or_a_clear_error(boards, quiet, kind):
    for board in degenerate(boards[:1], kind):
        for camera in (CAMERA, CAMERAS["fisheye"]):
            with suppress(RcdnError):
                found = estimate_pose(board, camera, 0.03)
                assert np.isfinite(found.T_cam_board).all()


@pytest.mark.parametrize("kind", [*(k for k in PLACES if k != "infinite"), *PARTS, *SIGMAS])
def test_the_last_fit_leaves_such_boards_alone(boards, quiet, kind):
    noise = np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8)
    for board in degenerate(boards[:1], kind):
        for grey in (noise, noise.astype(np.float32), np.full_like(noise, 100)):
            found = sharpen(grey, board)
            assert (found.ij == board.ij).all()
            known = np.isfinite(board.xy)
            assert np.isfinite(found.xy[known]).all()


@pytest.mark.parametrize(
    "kind",
    ["a point", "a line", "all but one in a point", "all unknown", "infinite", "tiny", "none", "one", "two", "a row"]
)  # fmt: skip
def test_boards_that_are_none_are_no_camera(boards, quiet, kind):
    with pytest.raises(RcdnError):
        calibrate(list(degenerate(boards, kind)), 0.03, model="pinhole")


@pytest.mark.parametrize("kind", ["a point", "a line", "two", "a row"])
def test_such_boards_among_others_are_left_out_with_a_reason(boards, quiet, kind):
    odd = list(degenerate(boards[:2], kind))
    found = calibrate([*odd, *boards[2:]], 0.03, model="radtan", flat=True)
    assert [bool(view.reason) for view in found.views] == [True, True, *[False] * 6]


def test_positions_that_are_not_finite_have_no_maps_and_no_rays(quiet):
    ij = np.argwhere(np.ones((3, 4)))
    for value in (np.nan, np.inf):
        xy = ij * 20.0
        xy[5] = value
        with pytest.raises(np.linalg.LinAlgError, match="not finite"):
            lattice(ij, xy)
        seen = np.isfinite(unproject(CAMERA, xy)).all(axis=1)
        assert seen.tolist() == [k != 5 for k in range(12)]


def test_a_shape_must_be_finite():
    with pytest.raises(RcdnError, match="finite"):
        BoardShape(np.full((3, 4, 3), np.nan))


def test_too_few_corners_for_a_pose_are_told(boards, quiet):
    for kind in ("none", "one", "two", "a row"):
        with pytest.raises(CalibrationError, match="a pose needs 4 corners"):
            estimate_pose(next(degenerate(boards[:1], kind)), CAMERA)
