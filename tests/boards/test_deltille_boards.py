"""Recovery of deltilles from ideal and from bad answers of a network; no network is needed."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.boards.deltille import find_deltilles
from rcdn.config import DetectorConfig
from rcdn.corners import find_maxima
from rcdn.corners.six_sector import six_candidates
from rcdn.geometry.order import ordered
from rcdn.geometry.rules import TRIANGLES
from rcdn.metrics import match
from rcdn.synthetic import Background, BoardSpec, Cover, Light, Scene, Sensor, render, truth
from rcdn.synthetic.lattice import labels, steps
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Status

CONFIG = DetectorConfig(pattern="deltille")
BROWN = {"model": "brown", "distortion": (-0.25, 0.05, 0.001, -0.001, 0.0)}


def board(cols=8, rows=7, pitch=26.0, roll=0.3, tilt=0.5, lean=0.7, at=(0.0, 0.0), **changes):
    R = cv2.Rodrigues(tilt * np.array([np.cos(lean), np.sin(lean), 0]))[0] @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    t = np.array([at[0] / pitch, at[1] / pitch, 1.0]) * [1, 1, 500.0 / pitch] - R @ [
        cols / 2 - 0.25,
        (rows - 1) * 0.433,
        0,
    ]
    return BoardSpec(
        cols, rows, tuple(cv2.Rodrigues(R)[0].ravel()), tuple(t), **({"pattern": "deltille", "margin": 1.0} | changes)
    )


def scene(*boards, noise=3.0, **changes):
    sensor = Sensor(noise=noise, gain=0.8, offset=0.1)
    values = {"sensor": sensor, "background": Background("noise", 3), "seed": 2} | changes
    return Scene(420, 320, 500.0, (209.5, 159.5), boards=boards or (board(),), **values)


def heat(shape, xy):
    """What a good network answers: a Gaussian at each of `xy`."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    out = np.zeros(shape, np.float32)
    for a, b in xy:
        part = np.s_[max(int(b) - 5, 0) : int(b) + 7, max(int(a) - 5, 0) : int(a) + 7]
        out[part] = np.maximum(out[part], np.exp(-((x[part] - a) ** 2 + (y[part] - b) ** 2) / 2))
    return out


def rim(of):
    """Vertices of triangles around a board that are no inner corners."""
    spec = of.boards[0]
    held = {tuple(a) for a in labels(spec).tolist()}
    around = {tuple(a) for s in steps(spec) for a in (labels(spec) + s).tolist()} - held
    return board_to_pixels(spec, of.camera, np.array(sorted(around)))


def found(of, answers=None, image=None):
    image = render(of, samples=2) if image is None else image
    if answers is None:
        answers = np.concatenate([b.xy[b.visible] for b in truth(of)])
    response = heat(image.shape, answers)
    return find_deltilles(image, six_candidates(image, response, find_maxima(response, CONFIG), CONFIG))


def check(got, known, swapped=False, least=1.0):
    """Every corner of `got` is one of `known`, labels agree up to a shift and the turns that the colours
    leave; how many there are."""
    pairs, _ = match(got.xy, known.xy[known.visible], 1.0)
    assert len(pairs) == len(got)
    assert len(got) >= least * known.visible.sum()
    ij, expected = got.ij[pairs[:, 0]], known.ij[known.visible][pairs[:, 1]]
    turns = []
    u, v = ij.T
    for sixth in range(6):
        shift = np.stack([u, v], axis=1) - expected
        turns += [sixth] * bool((shift == shift[0]).all())
        u, v = -v, u + v
    assert len(turns) == 1
    assert turns[0] % 2 == swapped
    assert got.pattern == "deltille"
    assert not got.complete
    assert got.orientation == "ambiguous_120"
    assert got.ij.min(axis=0).tolist() == [0, 0]
    assert np.lexsort((got.ij[:, 0], got.ij[:, 1])).tolist() == list(range(len(got)))


@pytest.mark.parametrize("roll", [0.0, 0.8, 2.0, 4.0])
@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.0])
def test_a_board_is_whole_and_its_labels_are_right(roll, tilt):
    of = scene(board(roll=roll, tilt=tilt))
    (got,) = found(of)
    check(got, truth(of)[0])


@pytest.mark.parametrize("changes", [{"swap": True}, {}], ids=["swapped", "inverted"])
def test_colours_decide_a_sixth_of_a_turn(changes):
    of = scene(board(**changes))
    image = render(of, samples=2)
    (got,) = found(of, image=image if changes else 255 - image)
    check(got, truth(of)[0], swapped=True)


def test_distortion_and_small_triangles():
    of = scene(board(12, 9, pitch=11.0), noise=2.0, **BROWN)
    (got,) = found(of)
    check(got, truth(of)[0], least=0.97)


def test_answers_at_the_rim_are_not_believed():
    for changes in ({}, {"margin_value": 0.05}, {"margin": 0.3}, {"margin": 0.15}):
        of = scene(replace(board(), **changes), background=Background("plain", 4))
        known = truth(of)[0]
        (got,) = found(of, np.concatenate([known.xy, rim(of)]))
        check(got, known)


def test_corners_that_the_network_missed_are_found_where_the_lattice_predicts_them():
    of = scene()
    known = truth(of)[0]
    keep = np.random.default_rng(3).random(len(known.xy)) > 0.25
    (got,) = found(of, known.xy[keep])
    check(got, known, least=0.95)
    late = got.status == Status.COMPLETED
    assert late.sum() > 5
    assert (got.response[late] == 0).all()
    assert np.linalg.norm(match(got.xy, known.xy, 1.0)[1]) / np.sqrt(len(got)) < 0.1


def test_a_covered_board_is_one_board_without_the_covered_part():
    known = truth(scene())[0]
    x, y = known.xy[known.xy.shape[0] // 2]
    of = scene(covers=(Cover(x - 8, y, x + 8, y, 16, 0.0),))
    (got,) = found(of, known.xy)
    check(got, truth(of)[0], least=0.7)


def test_a_hard_shadow_does_not_split_the_board():
    known = truth(scene())[0]
    x, y = known.xy.mean(axis=0)
    dark = Cover(x - 300, y + 150, x + 300, y + 150, 148.0, 0.3, True, 2.0)
    of = scene(light=Light(shadows=(dark,)), noise=1.0)
    (got,) = found(of)
    check(got, truth(of)[0], least=0.8)


def test_two_boards():
    of = scene(board(5, 6, 20.0, at=(-95, 0)), board(6, 5, 20.0, roll=1.9, at=(95, 10)))
    both = found(of)
    assert len(both) == 2
    for known in truth(of):
        check(min(both, key=lambda b: np.linalg.norm(b.xy.mean(axis=0) - known.xy.mean(axis=0))), known)


def test_nothing_is_made_of_checkerboards_noise_or_nothing():
    of = scene(board(pattern="checker", cols=8, rows=7))
    known = truth(of)[0]
    middles = board_to_pixels(of.boards[0], of.camera, known.ij + 0.5)
    assert found(of, np.concatenate([known.xy, middles])) == []
    rng = np.random.default_rng(4)
    clutter = rng.integers(0, 255, (320, 420)).astype(np.uint8)
    for image in (clutter, cv2.GaussianBlur(clutter, (0, 0), 2.0), np.full((320, 420), 80, np.uint8)):
        spots = rng.uniform(10, 310, (150, 2))
        assert found(of, spots, image) == []
        assert found(of, np.zeros((0, 2)), image) == []


def test_few_tiny_triangles_are_no_board():
    """As woven cloth has them; many of them are one."""
    few, many = (scene(board(n, n, pitch=7.4, tilt=0.0), noise=1.0) for n in (4, 7))
    assert found(few) == []
    (got,) = found(many)
    check(got, truth(many)[0], least=0.9)


def test_the_same_picture_gives_the_same_board():
    of = scene()
    (a,), (b,) = found(of), found(of)
    assert a.xy.tobytes() == b.xy.tobytes()
    assert a.ij.tobytes() == b.ij.tobytes()


def test_order_depends_on_the_print_and_the_place_only():
    """However the labels come, right-handed: the triangle inside (0, 0) is dark and i runs nearest
    to +x of what is left."""
    plane = np.array([(i, j) for i in range(5) for j in range(4)])
    for angle in np.radians(np.arange(7, 360, 25)):
        c, s = np.cos(angle), np.sin(angle)
        xy = np.stack([plane[:, 0] + plane[:, 1] / 2, plane[:, 1] * 0.866], axis=1) @ np.array([[c, s], [-s, c]])
        u, v = plane.T
        answers = []
        for sixth in range(6):
            own = np.stack([u + 3, v - 7], axis=1)
            answers.append(ordered(own, xy, -1 if sixth % 2 == 0 else 1, TRIANGLES))
            u, v = -v, u + v
        assert all((a == answers[0]).all() for a in answers)
        step = np.linalg.lstsq(np.column_stack([answers[0], np.ones(len(xy))]), xy, rcond=None)[0]
        assert abs(np.degrees(np.arctan2(step[0, 1], step[0, 0]))) <= 60 + 1e-6
        assert step[0, 0] * step[1, 1] - step[0, 1] * step[1, 0] > 0
        assert answers[0].min(axis=0).tolist() == [0, 0]
