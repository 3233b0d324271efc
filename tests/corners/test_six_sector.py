"""Six-sector corners: refinement by antisymmetry, three axes, and what isn't one."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.corners.six_sector import antisymmetry, refine_six, ring, six_axes
from rcdn.corners.symmetry import symmetry_centre
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render, truth
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Status


def scene(tilt=0.5, roll=0.4, pitch=20.0, noise=5.0, blur=1.0, pattern="deltille", **sensor):
    """A board of 8 × 7 corners in the middle of 320 × 240 px."""
    R = cv2.Rodrigues(tilt * np.array([0.8, 0.6, 0.0]))[0] @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    t = np.array([0, 0, 500.0 / pitch]) - R @ [3.75, 3 * 0.866, 0]
    spec = BoardSpec(8, 7, tuple(cv2.Rodrigues(R)[0].ravel()), tuple(t), margin=1.0, pattern=pattern)
    sensor = Sensor(blur=blur, noise=noise, gain=0.8, offset=0.1, **sensor)
    return Scene(
        320, 240, 500.0, (159.3, 119.8), boards=(spec,), sensor=sensor, background=Background("plain", 3), seed=5
    )


def corners(of):
    known = truth(of)[0]
    return known.xy[known.visible], known.pitch[known.visible], known.ij[known.visible]


@pytest.mark.parametrize("tilt", [0.0, 0.5, 0.9])
def test_error_is_below_a_twentieth_of_a_pixel(tilt):
    """At blur 1, noise 5 and edges of 20 px, from anywhere within half a pixel."""
    at = scene(tilt)
    xy, pitch, _ = corners(at)
    start = xy + np.random.default_rng(0).uniform(-0.5, 0.5, xy.shape)
    gap = np.linalg.norm(antisymmetry(render(at), start, pitch) - xy, axis=1)
    assert gap.mean() < 0.05
    assert gap.max() < 0.2


def test_without_noise_it_is_exact():
    at = scene(0.0, noise=0.0, pitch=24.0)
    xy, pitch, _ = corners(at)
    assert np.linalg.norm(antisymmetry(render(at), xy + 0.6, pitch) - xy, axis=1).max() < 0.01


def test_symmetry_is_not_antisymmetry():
    """The centre of a deltille's corner is none of point symmetry, nor that of an X-corner one of antisymmetry."""
    at = scene(0.0, noise=0.0)
    xy = corners(at)[0]
    assert np.linalg.norm(symmetry_centre(render(at), xy, 7, anti=True) - xy, axis=1).max() < 0.02
    found = symmetry_centre(render(at), xy, 7)
    assert not (np.linalg.norm(found - xy, axis=1) < 0.02).any()


def test_a_start_on_nothing_is_kept_and_said():
    image = np.full((60, 60), 90, np.uint8)
    xy, status = refine_six(image, np.zeros((60, 60), np.float32), np.array([[30, 30]]), np.array([20.0]))
    assert status.tolist() == [Status.SEED]
    assert xy.tolist() == [[30, 30]]


@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.0])
def test_axes_are_the_three_families_of_edges(tilt):
    at = scene(tilt, pitch=26.0)
    xy, pitch, ij = corners(at)
    seen = six_axes(render(at), xy, ring(pitch))
    assert (seen.polarity != 0).all()
    steps = [board_to_pixels(at.boards[0], at.camera, ij + 0.3 * np.array(s)) - xy for s in ((1, 0), (0, 1), (-1, 1))]
    angle = np.stack([np.arctan2(s[:, 1], s[:, 0]) for s in steps], axis=1)
    turn = np.abs((angle[:, :, None] - seen.axes[:, None] + np.pi / 2) % np.pi - np.pi / 2).min(axis=2)
    assert np.degrees(np.median(turn)) < 1.5
    assert np.degrees(turn.max()) < 10
    assert (np.diff(seen.axes, axis=1) > 0).all()


def test_polarity_tells_the_colour_after_the_first_axis():
    at = scene(noise=0.0)
    xy, pitch, _ = corners(at)
    image = render(at)
    seen, negative = six_axes(image, xy, ring(pitch)), six_axes(255 - image, xy, ring(pitch))
    assert (seen.polarity == -negative.polarity).all()
    middle = seen.axes[:, :2].mean(axis=1)
    x, y = np.rint(xy + 5 * np.stack([np.cos(middle), np.sin(middle)], axis=1)).astype(int).T
    assert (np.sign(image[y, x].astype(int) - int(image.mean())) == seen.polarity).all()


def test_x_corners_edges_and_flat_parts_have_none():
    at = scene(0.3, noise=2.0, pattern="checker")
    xy, pitch, _ = corners(at)
    assert not six_axes(render(at), xy, ring(pitch)).polarity.any()
    edge = np.full((80, 80), 60, np.uint8)
    edge[:, 40:] = 180
    noisy = np.clip(edge + np.random.default_rng(1).normal(0, 3, edge.shape), 0, 255).astype(np.uint8)
    spots = np.array([[39.5, 30.0], [40.0, 50.0], [20.0, 40.0], [38.5, 44.0]])
    for image in (edge, cv2.GaussianBlur(noisy, (0, 0), 1.5)):
        assert not six_axes(image, spots, np.full(4, 6.0)).polarity.any()


def test_no_corners_give_empty_arrays():
    seen = six_axes(np.zeros((20, 20), np.uint8), np.zeros((0, 2)), np.zeros(0))
    assert seen.axes.shape == (0, 3)
    xy, status = refine_six(np.zeros((20, 20), np.uint8), np.zeros((20, 20), np.float32), np.zeros((0, 2)), np.zeros(0))
    assert xy.shape == (0, 2)
    assert len(status) == 0


def test_wide_blur_keeps_the_centre():
    at = replace(scene(0.0, noise=1.0), sensor=Sensor(blur=3.0, noise=1.0))
    xy, pitch, _ = corners(at)
    gap = np.linalg.norm(antisymmetry(render(at), xy + 0.4, pitch) - xy, axis=1)
    assert gap.mean() < 0.1
