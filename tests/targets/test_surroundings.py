"""What is printed beside corners is known from the code, and no longer moves them."""

from dataclasses import replace

import numpy as np
import pytest
from coded_scene import aprilgrid as drawing_of_tags
from coded_scene import seen as seen_by_camera

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.precision import sharpen
from rcdn.synthetic import Background, Scene, Sensor
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn.targets.surroundings import surroundings
from rcdn.types import AprilGrid, Board, Camera, Charuco, PuzzleBoard
from rcdn_lab.coded.drawings import MARGIN, SQUARE, aprilgrid_drawing, charuco_drawing, puzzleboard_drawing
from rcdn_lab.coded.views import drawing_truth, posed, render_drawing

CHARUCO = [
    ((6, 5), "DICT_4X4_50", {}),
    ((5, 6), "DICT_6X6_250", {"ratio": 0.5}),
    ((6, 4), "DICT_4X4_50", {"ratio": 0.875, "legacy": True}),
    ((5, 4), "DICT_4X4_50", {"inverted": True, "first": 7}),
]


START = (40, 31)
CODES = (CODE_1, CODE_2)


def puzzle():
    """(target, drawing, places of its corners)."""
    drawing = puzzleboard_drawing(6, 5, START, CODES)
    exact_circles(drawing)
    return PuzzleBoard(), drawing, np.stack([drawing.ids % 501, drawing.ids // 501], axis=1)


def exact_circles(drawing):
    """Draw the circles again: those of OpenCV are larger by half a pixel."""
    old, image = drawing.image.copy(), plain(drawing).image
    steps = np.arange(-0.45, 0.5, 0.1)
    for middle in (drawing.xy[:, None] + SQUARE / 2 * np.array([(1, 0), (0, 1)])).reshape(-1, 2):
        x, y = np.meshgrid(*(np.arange(round(m - 20.5), round(m + 21.5)) for m in middle))
        part = np.ix_(y[:, 0], x[0])
        if len(set(old[part][18:24, 18:24].ravel().tolist())) == 1:  # there is one
            near = [np.hypot(x + a - middle[0], y + b - middle[1]) < SQUARE / 6 for a in steps for b in steps]
            image[part] = np.round(image[part] + np.mean(near, axis=0) * (float(old[part][21, 21]) - image[part]))
    drawing.image[:] = image


def aprilgrid(gap=0.3125, border=2):
    """(target, drawing, labels of its corners)."""
    target, drawing = AprilGrid(3, 2, "tag36h11", gap, border), aprilgrid_drawing(3, 2, gap=gap, border=border)
    return target, drawing, target.ij_of(drawing.ids)


def target_of(size, dictionary, ratio=0.75, first=0, **more):
    return Charuco(*size, dictionary, ratio, first, **more)


def board_of(target, ij, xy, size):
    ones, pattern = np.ones(len(xy)), "aprilgrid" if isinstance(target, AprilGrid) else "checker"
    return Board(
        xy, ij, size, ones, np.zeros(len(xy), np.uint8), "unique", pattern=pattern, target=target, ids=target.ids(ij)
    )


def described(around, k, u, v):
    """What the description says at places (K,) in squares from corner k: white is 1, black is −1;
    and how near an edge is."""
    edge, cells, which, at, sign, following = around.drawn[0]
    value, near = sign[k] * np.sign(u) * np.sign(v), np.minimum(np.abs(u), np.abs(v))
    for side, place in zip(following[k], (-u, u, -v, v), strict=True):
        value = np.where(place > side, -value, value)
        near = np.minimum(near, np.abs(place - side))
    for part, middle in zip(which[k], at[k], strict=True):
        if part >= 0:
            steps = [(p - m)[:, None] - e for p, m, e in zip((u, v), middle, edge[part], strict=True)]
            value = value + cells[part][tuple((s > 0).sum(axis=1) for s in steps)]
            near = np.minimum(near, np.minimum(*(np.abs(s).min(axis=1) for s in steps)))
    return value, near


def compared(target, drawing, ij, axes, near_edges=0.012):
    """(description, drawing) at places around all corners, white 1, black −1; those near edges are left out."""
    around = surroundings(drawing.image, board_of(target, ij, drawing.xy, drawing.image.shape[::-1]))
    rng, out = np.random.default_rng(0), []
    for k, xy in enumerate(drawing.xy):
        low, high = -around.ends[k, ::2], around.ends[k, 1::2]
        place = rng.uniform(1.4 * low, 1.4 * high, (400, 2))
        value, near = described(around, k, *place.T)
        x, y = np.round(xy + drawing.unit * place @ axes).astype(int).T
        far = near > near_edges
        out.append(np.stack([value, drawing.image[y, x] / 127.5 - 1], axis=1)[far])
    return np.concatenate(out).T


@pytest.mark.parametrize(("size", "dictionary", "more"), CHARUCO)
def test_markers_are_described_as_they_are_drawn(size, dictionary, more):
    drawing = charuco_drawing(*size, dictionary, **more)
    target = target_of(size, dictionary, **more)
    ij = np.stack([drawing.ids % (size[0] - 1), drawing.ids // (size[0] - 1)], axis=1)
    value, seen = compared(target, drawing, ij, np.eye(2))
    assert len(value) > 3000
    np.testing.assert_allclose(value, seen, atol=0.01)


def test_circles_are_described_as_they_are_drawn():
    value, seen = compared(*puzzle(), np.eye(2))
    assert len(value) > 3000
    assert (np.abs(value - seen) > 0.02).mean() < 0.004  # circles are made of strips


@pytest.mark.parametrize("border", [1, 2])
def test_tags_are_described_as_they_are_drawn(border):
    value, seen = compared(*aprilgrid(border=border), -np.eye(2))
    assert len(value) > 3000
    np.testing.assert_allclose(value, seen, atol=0.01)


def plain(drawing):
    """The drawing with nothing but its squares: each has the grey of its corner."""
    image = drawing.image.copy()
    for y in range(MARGIN, image.shape[0] - MARGIN, SQUARE):
        for x in range(MARGIN, image.shape[1] - MARGIN, SQUARE):
            image[y : y + SQUARE, x : x + SQUARE] = image[y + 1, x + 1]
    return replace(drawing, image=image)


def pair(target, drawing, ij, share, seed, blur=1.0, noise=0.0, size=(360, 300), geometry=False):
    """Fits of a coded board and of a plain one in the same picture, the board taking a `share` of it: ((errors (N, 2),
    sigma (N,)), the same)."""
    rng = np.random.default_rng(seed)
    camera = Camera([[500, 0, (size[0] - 1) / 2], [0, 500, (size[1] - 1) / 2], [0, 0, 1]], [], size, "pinhole")
    off = (1 - share) / 2 * np.array(size)
    spec = posed(drawing, camera, (*off, *(size - off)), rng.uniform(0, 0.5), *rng.uniform(0, 6, 2))
    scene = Scene(
        *size, 500.0, (camera.K[0, 2], camera.K[1, 2]), boards=(replace(spec, black=0.16, white=0.83),),
        sensor=Sensor(blur=blur, noise=noise), background=Background("plain", seed), seed=seed,
    )  # fmt: skip
    xy = drawing_truth(drawing, scene).xy
    start = board_of(target, ij, xy + rng.normal(0, 0.15, xy.shape), size)
    image = render_drawing(drawing, scene, samples=8)
    cases = [(image, surroundings(image, start))]
    if not isinstance(target, AprilGrid):
        cases.append((render_drawing(plain(drawing), scene, samples=8), None))
    for picture, around in cases:
        board = sharpen(picture, start, geometry, around)
        yield board.xy - xy, board.sigma


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(("size", "dictionary", "more"), CHARUCO)
@pytest.mark.parametrize("blur", [0.7, 1.4])
def test_markers_do_not_move_corners(size, dictionary, more, blur):
    drawing = charuco_drawing(*size, dictionary, **more)
    ij = np.stack([drawing.ids % (size[0] - 1), drawing.ids // (size[0] - 1)], axis=1)
    target, off, alone = target_of(size, dictionary, **more), [], []
    for seed in range(3):
        (coded, _), (bare, _) = pair(target, drawing, ij, 0.9, seed, blur)
        off.append(coded - bare)
        alone.append(bare)
    assert rms(off) < (0.007 if target.marker > 0.8 else 0.006)
    assert rms(np.add(off, alone)) < 0.008


def test_sigma_is_honest_beside_markers():
    errors = []
    for seed in range(6):
        drawing = charuco_drawing(8, 6, "DICT_5X5_50")
        ij = np.stack([drawing.ids % 7, drawing.ids // 7], axis=1)
        ((off, sigma), _) = pair(target_of((8, 6), "DICT_5X5_50"), drawing, ij, 0.9, seed, noise=8)
        errors.append(off / sigma[:, None])
    assert 0.8 < rms(errors) < 1.3


def test_circles_do_not_move_corners():
    target, drawing, ij = puzzle()
    off, alone = [], []
    for seed in range(3):
        (coded, _), (bare, _) = pair(target, drawing, ij, 0.9, seed)
        off.append(coded - bare)
        alone.append(bare)
    assert rms(off) < 0.008
    assert rms(np.add(off, alone)) < 0.008


def test_squares_of_the_other_colours_are_no_circles_of_the_code():
    """A print whose colours aren't those that go with its code: what the circles do to it is not known."""
    target, drawing, ij = puzzle()
    other = replace(drawing, image=255 - drawing.image)
    ((off, _), _) = pair(target, other, ij, 0.9, 1)
    assert rms(off) < 0.05


@pytest.mark.parametrize("blur", [0.7, 1.4])
def test_tags_do_not_move_corners(blur):
    target, drawing, ij = aprilgrid()
    off = [next(pair(target, drawing, ij, 0.95, seed, blur))[0] for seed in range(3)]
    assert rms(off) < 0.01
    assert rms(np.mean(off, axis=0)) < 0.007


@pytest.mark.parametrize("claimed", [0.3125, 0.307])
def test_sigma_is_honest_on_tags(claimed):
    """Their gap is read to hundredths only."""
    target, drawing, ij = aprilgrid()
    errors, off = [], []
    for seed in range(6):
        ((error, sigma),) = pair(replace(target, gap=claimed), drawing, ij, 0.95, seed, noise=8, geometry=True)
        errors.append(error / sigma[:, None])
        off.append(error)
    assert 0.5 < rms(errors) < 1.3
    assert rms(off) < 0.025


def test_detected_tags_have_a_sigma():
    drawing = drawing_of_tags(4, 3)
    image, xy = seen_by_camera(drawing, width=960, height=720, size=0.75)
    (board,) = Detector(DetectorConfig(target="auto")).boards(image)
    assert np.isfinite(board.sigma).all()
    place = dict(zip(drawing.ids.tolist(), xy, strict=True))
    off = board.xy - np.array([place[number] for number in board.ids.tolist()])
    assert rms(off) < 0.03
