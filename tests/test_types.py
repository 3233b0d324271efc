"""Corners, boards, cameras and poses: shapes, frozen arrays, grids."""

import numpy as np
import pytest

from rcdn.errors import RcdnError
from rcdn.types import Board, Camera, Corners, Pose, Status

XY = np.array([[5.0, 1], [2, 9], [2, 3], [7, 7]])


def corners(**changes):
    parts = {
        "xy": XY,
        "response": [1, 2, 2, 0.5],
        "status": [0, 1, 2, 3],
        "axes": XY / 10,
        "sigma": [0.1, 0.2, 0.3, 0.4],
    }
    return Corners(**(parts | changes))


def board(cols, rows, drop=(), shift=(0, 0)):
    """A board whose corner (i, j) lies at (10 i, 10 j)."""
    ij = np.array([(i, j) for j in range(rows) for i in range(cols) if (i, j) not in drop])
    n = len(ij)
    return Board(ij * 10.0, ij + np.array(shift), (640, 480), np.ones(n), np.zeros(n), "unique")


def test_corners_sort_and_take_keep_rows_together():
    ordered = corners().sort()
    assert ordered.xy.tolist() == [[2, 3], [2, 9], [5, 1], [7, 7]]
    assert ordered.sigma.tolist() == [0.3, 0.2, 0.1, 0.4]
    assert ordered.axes == pytest.approx(ordered.xy / 10)
    picked = corners().take(np.array([False, True, False, True]))
    assert picked.xy.tolist() == [[2, 9], [7, 7]]
    assert picked.status.tolist() == [Status.SEED, Status.COMPLETED]
    assert len(corners(axes=None, sigma=None).take([0, 1])) == 2
    assert corners(axes=None).take([0]).axes is None


@pytest.mark.parametrize("index", [np.array([3, 0]), np.array([True, False, True, False]), slice(1, 4, 2), [2]])
def test_corners_that_are_taken_are_values_of_their_own(index):
    whole = corners()
    picked = whole.take(index)
    for name in ("xy", "response", "status", "axes", "sigma"):
        one, other = getattr(whole, name), getattr(picked, name)
        assert np.array_equal(other, one[index])
        assert other.dtype == one.dtype
        assert other.flags.c_contiguous
        assert not other.flags.writeable
        assert not np.shares_memory(one, other)
    with pytest.raises(RcdnError):
        whole.take(1)


@pytest.mark.parametrize("empty", [[], np.zeros((0, 2)), np.zeros(0)])
def test_no_corners(empty):
    none = Corners(empty, [], [], axes=empty)
    assert len(none) == len(none.sort()) == 0
    assert none.xy.shape == none.axes.shape == (0, 2)
    assert none.response.shape == (0,)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"xy": np.ones((4, 3))}, r"Corners.xy must have shape \(N, 2\)"),
        ({"xy": np.ones(4)}, "Corners.xy"),
        ({"response": np.ones((4, 1))}, "Corners.response"),
        ({"response": [1, 2]}, "Corners.response has 2 rows, but xy has 4"),
        ({"status": [1] * 5}, "Corners.status"),
        ({"axes": np.ones((3, 2))}, "Corners.axes"),
        ({"sigma": [0.1]}, "Corners.sigma"),
    ],
)
def test_corners_refuse(changes, words):
    with pytest.raises(RcdnError, match=words):
        corners(**changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ij": [[0, 0], [1, 0], [0, 0]]}, "twice"),
        ({"ij": [[0, 0], [1, 0]]}, "one row a corner"),
        ({"response": [1]}, "one row a corner"),
        ({"ij": [0, 1, 2]}, "Board.ij"),
    ],
)
def test_boards_refuse(changes, words):
    parts = {"xy": XY[:3], "ij": [[0, 0], [1, 0], [0, 1]], "image_size": (9, 9), "response": [1] * 3, "status": [0] * 3}
    with pytest.raises(RcdnError, match=words):
        Board(**(parts | changes), orientation="unique")


def test_arrays_are_copies_and_frozen():
    xy = XY.copy()
    held = corners(xy=xy)
    xy[0] = 99
    assert held.xy.tolist() == XY.tolist()
    pose = Pose(np.eye(4))
    camera = Camera(np.eye(3), (), (4, 4), "pinhole")
    b = board(3, 3)
    for array in (held.xy, held.response, held.axes, held.sigma, held.status, b.xy, b.ij, pose.R, pose.t, camera.K):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        held.xy = XY


def test_camera_counts_its_distortion():
    for model, n in (("pinhole", 1), ("brown", 3), ("fisheye", 5)):
        with pytest.raises(RcdnError, match=model):
            Camera(np.eye(3), np.zeros(n), (4, 4), model)
    assert Camera(np.eye(3), np.zeros(4), (4, 4)).model == "brown"


@pytest.mark.parametrize("K", [np.diag([-500.0, 500, 1]), np.diag([500.0, 0, 1]), np.diag([1e10, 1e10, 1])])
def test_focal_lengths_of_no_camera_are_refused(K):
    with pytest.raises(RcdnError, match=r"Camera\.K: the focal lengths must be 1e-09 to 1e"):
        Camera(K, None, (640, 480))
    with pytest.raises(RcdnError, match=r"Camera\.K must be a finite"):
        Camera(K * np.nan, None, (640, 480))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e13, -1.1e12])
@pytest.mark.parametrize(("model", "many"), [("brown", 5), ("brown", 4), ("rational", 8), ("fisheye", 4)])
def test_coefficients_of_no_lens_are_refused(model, many, wrong):
    K, coefficients = np.diag([500.0, 500, 1]), np.zeros(many)
    coefficients[-1] = wrong
    for given in (coefficients, coefficients.tolist(), coefficients[None], coefficients[:, None]):
        with pytest.raises(RcdnError, match=r"Camera\.distortion: its numbers must be finite and within ±1e\+12, not"):
            Camera(K, given, (640, 480), model)
    largest = np.full(many, np.copysign(1e12, wrong))
    assert np.array_equal(Camera(K, largest, (640, 480), model).distortion, largest)


def test_a_solver_may_pass_through_cameras_that_are_none():
    camera = Camera(np.diag([500.0, 500, 1]), None, (640, 480))
    far = camera.with_parameters(np.append(camera.parameters[:8], 1e13))
    assert far.distortion.tolist() == [0, 0, 0, 0, 1e13]
    moved = camera.with_parameters(camera.parameters * [-1, 1, 1, 1, 1, 1, 1, 1, 1])
    assert moved.K.tolist() == [[-500, 0, 0], [0, 500, 0], [0, 0, 1]]
    assert not moved.K.flags.writeable
    for wrong in (np.nan * camera.parameters, camera.parameters[:6]):
        with pytest.raises(RcdnError, match=r"Camera\.(K|distortion)"):
            camera.with_parameters(wrong)


def test_a_correction_of_another_kind_is_refused():
    with pytest.raises(RcdnError, match=r"Camera\.correction must be a LensCorrection or None, not 3"):
        Camera(np.diag([500.0, 500, 1]), None, (640, 480), correction=3)


def test_a_camera_with_other_parameters_keeps_its_own_copy_and_is_checked():
    camera = Camera(np.array([[500.0, 2, 320], [0, 510, 240], [0, 0, 1]]), None, (640, 480))
    given = camera.parameters + 0.25
    other = camera.with_parameters(given)
    given[:] = 7
    assert other.parameters == pytest.approx(camera.parameters + 0.25)
    assert (other.K[0, 1], other.image_size, other.model) == (2, (640, 480), "brown")
    for array in (other.K, other.distortion):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    assert camera.with_parameters(camera.parameters[:8]).distortion.shape == (4,)
    with pytest.raises(RcdnError, match=r"Camera\.distortion of model 'brown' takes 4 or 5 numbers, not 3"):
        camera.with_parameters(camera.parameters[:7])
    for wrong in (np.nan, np.inf):
        with pytest.raises(RcdnError, match=r"Camera\.K must be a finite"):
            camera.with_parameters(np.full(9, wrong))


def turned(**changes):
    """T (4, 4) of a quarter turn about z, with changes of single entries: `a01=2.0`."""
    T = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    for name, value in changes.items():
        T[int(name[1]), int(name[2])] = value
    return T


@pytest.mark.parametrize(
    "T",
    [
        turned(a03=np.nan), turned(a23=np.inf), turned(a01=np.nan), 2 * turned(), turned(a22=-1.0), turned(a30=0.5),
        turned().T, turned(a33=0.0), turned(a01=-1.01), turned(a02=0.01), np.zeros((4, 4)), turned(a01=1e200),
    ],
)  # fmt: skip
def test_poses_that_are_no_rigid_motions_are_refused(T):
    with pytest.raises(RcdnError, match=r"Pose\.T_cam_board must be a finite rotation and translation"):
        Pose(T)


def test_rounded_poses_are_taken():
    """Of four digits, as files of other programs and products of them have."""
    angle = np.radians(33)
    R = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    T = np.eye(4)
    T[:3, :3] = np.round(R, 4)
    assert np.array_equal(Pose(T).T_cam_board, T)


def test_deviations_are_not_negative():
    with pytest.raises(RcdnError, match=r"Corners\.sigma must not be negative"):
        corners(sigma=[0.1, 0.1, -1e-9, np.nan])
    assert corners(sigma=[0.1, 0.0, np.inf, np.nan]).sigma[1] == 0  # rounded in a file; unknown


def test_grid_has_nan_where_a_corner_is_missing():
    seen = board(4, 3, drop={(2, 1)}, shift=(5, -2))
    assert seen.size == (4, 3)
    assert not seen.complete
    assert board(4, 3).complete
    grid = seen.grid()
    assert grid.shape == (3, 4, 2)
    assert np.argwhere(np.isnan(grid[..., 0])).tolist() == [[1, 2]]
    assert grid[2, 3].tolist() == [30, 20]
    empty = Board([], [], (4, 4), [], [], "unique")
    assert (empty.size, empty.complete, empty.grid().shape) == ((0, 0), True, (0, 0, 2))


def handedness(grid):
    """Sign of the turn from growing columns to growing rows."""
    return np.sign(np.linalg.det(np.stack([grid[0, 1] - grid[0, 0], grid[1, 0] - grid[0, 0]])))


@pytest.mark.parametrize(("cols", "rows"), [(9, 6), (6, 9), (4, 3), (3, 4), (8, 5), (7, 5), (8, 6)])
def test_grid_of_turns_but_never_mirrors(cols, rows):
    b = board(cols, rows, drop={(1, 2)})
    same, turned = b.grid_of((cols, rows)), b.grid_of((rows, cols))
    assert np.array_equal(same, b.grid(), equal_nan=True)
    assert turned.shape == (cols, rows, 2)
    assert handedness(turned) == handedness(same) == 1
    assert sorted(turned[np.isfinite(turned[..., 0])].tolist()) == sorted(b.xy.tolist())
    assert b.grid_of((cols + 1, rows)) is None
    assert b.grid_of((cols * rows, 1)) is None
    if (cols + rows) % 2:  # the board has one labelling: the square inside the origin keeps its colour
        middle = board(cols, rows).grid_of((rows, cols))[:2, :2].reshape(4, 2).mean(axis=0) / 10 - 0.5
        assert middle.sum() % 2 == 0


def test_grid_of_there_and_back():
    """Turned twice, a board comes back, or by half a turn, which its colours allow."""
    b = board(9, 6)
    turned = b.grid_of((6, 9))
    again = Board(
        turned.reshape(-1, 2), np.argwhere(np.ones((9, 6)))[:, ::-1], (640, 480), np.ones(54), np.zeros(54), "unique"
    )
    assert np.array_equal(again.grid_of((9, 6)), b.grid())
