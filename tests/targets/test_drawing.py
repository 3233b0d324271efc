"""What is printed is read by each target's own tools, with the numbers and at the places that we say,
and by our own detector, told nothing."""

import cv2
import numpy as np
import pytest
from raster import raster

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.targets.dictionaries import dictionary_name, dictionary_names, family_name, marker_bits, tag_bits
from rcdn.targets.drawing import draw, extent, outline
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Printed, PuzzlePart
from rcdn.types.shapes import Area
from rcdn_lab.coded.drawings import MARGIN, aprilgrid_drawing

CHARUCO = [
    Charuco(5, 7, "DICT_4X4_50", 0.75),
    Charuco(8, 8, "DICT_4X4_250", 0.6, legacy=True),
    Charuco(6, 6, "DICT_7X7_50", 0.9),
    Charuco(7, 5, "DICT_6X6_250", 0.8, first_id=100),
    Charuco(9, 6, "DICT_5X5_100", 0.7, first_id=11, legacy=True),
    Charuco(6, 5, "DICT_APRILTAG_36h11", 0.8),
    Charuco(5, 6, "DICT_ARUCO_ORIGINAL", 0.7, first_id=900),
]


def opencv_board(board: Charuco):
    """The same board for OpenCV, squares of 1."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    odd = not (board.legacy and board.rows % 2 == 0)
    count = sum((c + r) % 2 == odd for c in range(board.columns) for r in range(board.rows))
    made = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), 1.0, board.marker, known, board.first_id + np.arange(count)
    )
    made.setLegacyPattern(board.legacy)
    return made


def picture(target, scale, margin=30):
    """A flat picture with `scale` px a side of a square or tag, and where its corners are, px."""
    drawing = draw(Printed(target, 1.0))
    image = raster(drawing.shapes, drawing.width, drawing.height, scale)
    image = cv2.copyMakeBorder(image, *[margin] * 4, cv2.BORDER_CONSTANT, value=255)
    return image, drawing.corners * scale + margin - 0.5


@pytest.mark.parametrize("board", CHARUCO, ids=str)
def test_charuco_boards_look_as_opencv_draws_them(board):
    modules = marker_bits(board.dictionary).shape[1] + 2
    whole = lambda v: abs(v - round(v)) < 1e-9  # noqa: E731
    scale = next(s for s in range(20, 2000) if whole(s * board.marker / modules) and whole(s * (1 - board.marker) / 2))
    image, _ = picture(board, scale, 0)
    theirs = opencv_board(board).generateImage((board.columns * scale, board.rows * scale), marginSize=0)
    np.testing.assert_array_equal(image, theirs)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("board", CHARUCO, ids=str)
def test_opencv_reads_charuco_boards(board, inverted):
    board = Charuco(**vars(board) | {"inverted": inverted})
    image, corners = picture(board, 60)
    settings = cv2.aruco.DetectorParameters()
    settings.detectInvertedMarker = inverted
    detector = cv2.aruco.CharucoDetector(opencv_board(board), detectorParams=settings)
    found, ids, _, markers = detector.detectBoard(image)
    assert len(markers) == len(opencv_board(board).getIds())
    assert sorted(np.ravel(ids)) == Printed(board, 1.0).ids.tolist()
    np.testing.assert_allclose(found.reshape(-1, 2), corners[np.ravel(ids)], atol=0.6)


@pytest.mark.parametrize(
    "grid",
    [
        AprilGrid(4, 3, "tag36h11", 0.3),
        AprilGrid(3, 4, "tag36h11", 0.25, border=1, first_id=200),
        AprilGrid(3, 2, "tag25h9", 0.3),
        AprilGrid(2, 3, "tag16h5", 0.4, first_id=7),
    ],
    ids=str,
)
class TestAprilGrids:
    SCALE = 120

    def corners_of_tags(self, grid):
        """Where tag n's corners are by the numbers: bottom left, bottom right, top right, top left,
        as Kalibr counts them."""
        image, corners = picture(grid, self.SCALE)
        wide, places = 2 * grid.columns, {}
        for tag in range(grid.columns * grid.rows):
            row, column = divmod(tag, grid.columns)
            start = 2 * row * wide + 2 * column
            places[grid.first_id + tag] = corners[[start, start + 1, start + wide + 1, start + wide]]
        return image, places

    def test_the_aprilgrid_package_reads_them(self, grid):
        package = pytest.importorskip("aprilgrid")
        name = f"t{grid.family[3:]}" + ("b1" if grid.border == 1 else "")
        image, places = self.corners_of_tags(grid)
        found = {d.tag_id: np.array(d.corners).reshape(4, 2) for d in package.Detector(name).detect(image)}
        assert sorted(found) == sorted(places)
        for tag, at in found.items():
            np.testing.assert_allclose(at, places[tag], atol=2)

    def test_opencv_reads_their_tags(self, grid):
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, grid.family.replace("tag", "DICT_APRILTAG_")))
        settings = cv2.aruco.DetectorParameters()
        settings.markerBorderBits = grid.border
        image, places = self.corners_of_tags(grid)
        found, ids, _ = cv2.aruco.ArucoDetector(known, settings).detectMarkers(image)
        assert sorted(np.ravel(ids)) == sorted(places)
        for tag, at in zip(
            np.ravel(ids), found, strict=True
        ):  # its pictures are turned by half: it begins at our third
            np.testing.assert_allclose(np.roll(at.reshape(4, 2), 0, axis=0), places[tag][[1, 0, 3, 2]], atol=2)


def test_puzzleboards_look_as_another_program_prints_them():
    """calib-targets counts from an origin that is 334 off in both directions."""
    other = pytest.importorskip("calib_targets")
    column, row, columns, rows, side = 7, 30, 6, 9, 18.0
    document = other.puzzleboard_document(rows + 1, columns + 1, side, origin_row=row, origin_col=column)
    page = cv2.imdecode(np.frombuffer(other.render_target_bundle(document).png_bytes, np.uint8), cv2.IMREAD_GRAYSCALE)
    scale = side / 25.4 * 300
    image, _ = picture(PuzzlePart(columns, rows, column + 334, row + 334), scale, 0)
    left, top = ((n - m) / 2 for n, m in zip(page.shape[::-1], image.shape[::-1], strict=True))
    theirs = cv2.warpAffine(page, np.array([[1, 0, -left], [0, 1, -top]]), image.shape[::-1], flags=cv2.INTER_LINEAR)
    differs = np.abs(cv2.GaussianBlur(image, (0, 0), 2).astype(int) - cv2.GaussianBlur(theirs, (0, 0), 2)) > 100
    assert not differs.any()


CODED = [
    Charuco(8, 6, "DICT_5X5_100", 0.75, legacy=True),
    Charuco(5, 4, "DICT_4X4_50", 0.75, inverted=True),
    AprilGrid(4, 3, "tag36h11", 0.3),
    PuzzlePart(9, 7, 120, 333),
]


@pytest.mark.parametrize("target", CODED, ids=str)
def test_our_detector_reads_them_at_the_places_that_we_print(target):
    image, corners = picture(target, 90 if isinstance(target, AprilGrid) else 50, 60)
    turn = cv2.getRotationMatrix2D((image.shape[1] / 2, image.shape[0] / 2), 20, 0.8)
    seen = cv2.GaussianBlur(cv2.warpAffine(image, turn, image.shape[::-1], borderValue=255), (0, 0), 0.8)
    (board,) = Detector(DetectorConfig(target="auto")).boards(seen)
    printed = Printed(target, 0.03)
    assert sorted(board.ids) == printed.ids.tolist()
    place = dict(zip(printed.ids.tolist(), corners @ turn[:, :2].T + turn[:, 2], strict=True))
    np.testing.assert_allclose(board.xy, [place[n] for n in board.ids.tolist()], atol=0.5)
    flat, _ = cv2.findHomography(printed.points(board.ids), board.xy)
    mapped = cv2.perspectiveTransform(printed.points(board.ids)[:, None], flat)[:, 0]
    np.testing.assert_allclose(mapped, board.xy, atol=0.3)
    np.testing.assert_allclose(printed.points(board.ids), board.points * 0.03, rtol=0.02, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_outlines_fill_the_cells_that_they_go_around(seed):
    cells = np.random.default_rng(seed).random((7, 9)) < 0.55
    loops = tuple(tuple((float(x), float(y)) for x, y in loop) for loop in outline(cells))
    np.testing.assert_array_equal(raster([Area(loops)], 9, 7, 1.0) == 0, cells)
    for loop in loops:  # nothing but turns, of edges along one axis
        steps = np.abs(np.diff([*loop, loop[0]], axis=0)) > 0
        assert (steps.sum(axis=1) == 1).all()
        assert (steps[:, 0] != np.roll(steps[:, 0], 1)).all()


@pytest.mark.parametrize(
    "target", [*CHARUCO, AprilGrid(3, 2, "tag25h9", 0.3), Checkerboard(5, 4), Deltille(4, 3)], ids=str
)
def test_drawings_stay_within_their_extent_and_scale(target):
    one, two = draw(Printed(target, 1.0)), draw(Printed(target, 0.02))
    assert (one.width, one.height) == pytest.approx(extent(target))
    np.testing.assert_allclose(two.corners, one.corners * 0.02)
    np.testing.assert_array_equal(
        raster(two.shapes, two.width, two.height, 2000), raster(one.shapes, one.width, one.height, 40)
    )
    dark = raster(one.shapes, one.width + 1, one.height + 1, 20) < 128
    assert not dark[round(one.height * 20) + 1 :].any()
    assert not dark[:, round(one.width * 20) + 1 :].any()


def test_names_of_dictionaries_are_taken_as_people_write_them():
    assert dictionary_name("4x4_50") == dictionary_name("dict_4X4_50") == "DICT_4X4_50"
    assert dictionary_name("DICT_APRILTAG_36H11") == "DICT_APRILTAG_36h11"
    assert family_name("t36h11") == family_name("36H11") == family_name("DICT_APRILTAG_36h11") == "tag36h11"
    assert [len(marker_bits(f"DICT_5X5_{n}")) for n in (50, 100, 250, 1000)] == [50, 100, 250, 1000]
    np.testing.assert_array_equal(np.rot90(tag_bits("tag36h11")[5], 2), marker_bits("DICT_APRILTAG_36h11")[5])
    for name in dictionary_names():
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert len(marker_bits(name)) == len(known.bytesList)


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (Charuco(12, 12, "DICT_4X4_50", 0.75), "has 50 markers, but the board needs 72; take DICT_4X4_100"),
        (Charuco(5, 7, "DICT_4X4_1000", 0.75, first_id=990), "needs 17 from 990; take a smaller board"),
        (Charuco(5, 7, "DICT_9X9", 0.75), "take one of DICT_4X4_50, "),
        (Charuco(5, None, "DICT_4X4_50", 0.75), "rows"),
        (AprilGrid(6, 6, "tag36h12", 0.3), "take one of .*tag36h11"),
        (AprilGrid(6, 6, "tag16h5", 0.3), "has 30 tags, but the board needs 36"),
    ],
)  # fmt: skip
def test_what_has_no_markers_can_t_be_drawn(target, message):
    with pytest.raises(ConfigError, match=message):
        draw(Printed(target, 0.02))


@pytest.mark.parametrize("scale", [60, 110, 240])
@pytest.mark.parametrize("border", [1, 2])
@pytest.mark.parametrize("family", ["tag36h11", "tag25h9", "tag16h5"])
def test_sharp_tags_of_any_size_and_border_are_read(family, border, scale):
    """Their white gaps shine in nowhere: how bright white is can't be told from the inside alone."""
    grid = AprilGrid(4, 3, family, 0.3, border)
    image, corners = picture(grid, scale, 2 * scale)
    (board,) = Detector(DetectorConfig(target="auto")).boards(cv2.GaussianBlur(image, (0, 0), 0.8))
    assert board.target == grid
    np.testing.assert_allclose(board.xy, corners[board.ids], atol=0.6)


@pytest.mark.parametrize("grid", [AprilGrid(4, 3, "tag36h11", 0.25), AprilGrid(3, 2, "tag16h5", 0.5, 1, 4)], ids=str)
def test_aprilgrids_are_those_that_opencv_s_tags_make(grid):
    """The renderer of the tests has its own drawing, of tags that OpenCV draws."""
    name = grid.family.replace("tag", "DICT_APRILTAG_")
    theirs = aprilgrid_drawing(grid.columns, grid.rows, name, grid.border, grid.gap, grid.first_id)
    image, corners = picture(grid, theirs.unit, MARGIN)
    np.testing.assert_allclose(corners, theirs.xy, atol=1e-6)
    np.testing.assert_array_equal(Printed(grid, 1.0).ids, np.sort(theirs.ids))
    assert image.shape == theirs.image.shape
    assert (np.abs(image.astype(int) - theirs.image) > 128).mean() < 0.01  # modules aren't whole numbers of pixels


@pytest.mark.parametrize(
    "target", [Charuco(7, 6, "DICT_4X4_50", 0.75, 3, legacy=True), AprilGrid(4, 3, "tag36h11", 0.3, 2, 24)], ids=str
)
def test_boards_that_begin_with_another_number_are_read_where_they_are_told(target):
    """Untold, and without paper around them, they could be parts of larger boards: the lower rows of 7 × 7 squares,
    tags from the seventh row on."""
    image, corners = picture(target, 80, 60)
    (board,) = Detector(DetectorConfig(target=target)).boards(cv2.GaussianBlur(image, (0, 0), 0.8))
    assert sorted(board.ids) == Printed(target, 1.0).ids.tolist()
    np.testing.assert_allclose(board.xy, corners[board.ids], atol=0.6)
