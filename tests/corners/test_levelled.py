"""Pictures without their light: the same wherever the sun stands, and boards under hard shadows are found."""

import numpy as np
import pytest

import rcdn
from rcdn import views
from rcdn.config import DetectorConfig
from rcdn.corners.levelled import DARK, GAIN, MIDDLE, PARTS, SIDE, levelled
from rcdn.metrics import match
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render, truth

SIZE = (640, 480)


def board(seed, pitch=34.0):
    sensor = Sensor(blur=0.7, noise=0.0)
    t = (3.3 / pitch - 4, -2.2 / pitch - 2.5, 500 / pitch)
    centre = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
    return Scene(
        *SIZE,
        500,
        centre,
        boards=(BoardSpec(9, 6, (0.15, -0.1, 0.1), t),),
        sensor=sensor,
        background=Background("plain", 3),
        seed=seed,
    )


def shaded(grey, light, width=37, seed=0):
    """Under a fence: bars of shadow with `light` of the sun's in two directions, and noise."""
    y, x = np.mgrid[: grey.shape[0], : grey.shape[1]]
    bars = (((0.9 * x + 0.4 * y) // width).astype(int) % 2) | (((0.3 * x - 0.95 * y) // (2 * width)).astype(int) % 2)
    noise = np.random.default_rng(seed).normal(0, 1.5, grey.shape)
    return np.clip(grey * np.where(bars == 1, light, 1.0) + noise, 0, 255).astype(np.uint8)


def test_an_edge_is_as_high_in_the_shadow_as_in_the_sun():
    """Ink to paper, 1 : 6; `DARK` lowers it where there is hardly any light."""
    edge = np.full((100, 100), 180, np.uint8)
    edge[:, 50:] = 30
    sun, shadow = (levelled((edge * light).astype(np.uint8)).astype(int) for light in (1.0, 0.3))
    step = sun[50, 49] - sun[50, 50]
    assert step == pytest.approx(GAIN * np.log((180 + DARK) / (30 + DARK)), abs=6)
    assert 0.8 * step < shadow[50, 49] - shadow[50, 50] < step
    assert (levelled(np.full((60, 80), 7, np.uint8)) == MIDDLE).all()


def box_mean(values):
    """The mean over the window, by integers, rounded half up."""
    sums = np.pad(values, SIDE // 2, mode="symmetric").cumsum(axis=0).cumsum(axis=1)
    sums = np.pad(sums, ((1, 0), (1, 0)))
    windows = sums[SIDE:, SIDE:] - sums[:-SIDE, SIDE:] - sums[SIDE:, :-SIDE] + sums[:-SIDE, :-SIDE]
    return (windows + SIDE * SIDE // 2) // (SIDE * SIDE)


def test_every_byte_is_that_of_plain_integers():
    """So that it is the same on every processor."""
    grey = np.random.default_rng(7).integers(0, 256, (131, 203)).astype(np.uint8)
    values = np.rint(PARTS * GAIN * np.log(grey + DARK)).astype(np.int64)
    mean = box_mean(box_mean(box_mean(values)))
    exact = np.clip((values - mean + MIDDLE * PARTS + PARTS // 2) // PARTS, 0, 255)
    assert (levelled(grey) == exact).all()


@pytest.mark.parametrize("light", [0.5, 2.0])
def test_bytes_and_floats_give_the_same(light):
    grey = render(board(3))
    lit = np.clip(grey * light, 0, 255).astype(np.uint8)
    assert (levelled(lit) == levelled(lit.astype(np.float32))).all()
    assert levelled(lit).shape == lit.shape


@pytest.mark.parametrize("seed", range(4))
def test_boards_under_a_fence_are_found(seed, monkeypatch):
    scene = board(seed)
    grey, (exact,) = shaded(render(scene), 0.12, seed=seed), truth(scene)
    found = rcdn.Detector().boards(grey)
    hit = [match(b.xy, exact.xy, 2.0)[0] for b in found]
    assert max(map(len, hit), default=0) >= 53
    assert sum(map(len, found)) == sum(len(match(b.xy, exact.xy, 4.0)[0]) for b in found)
    monkeypatch.setattr(views.Views, "_is_open", lambda *_: False)
    assert max(len(match(b.xy, exact.xy, 2.0)[0]) for b in rcdn.Detector().boards(grey)) < 50


@pytest.mark.parametrize("quick", [{"sharpen": None}, {"pyramid": False}])
def test_quick_detections_look_once(quick, monkeypatch):
    monkeypatch.setattr(views, "levelled", lambda _: pytest.fail("looked at again"))
    found = rcdn.Detector(DetectorConfig.auto(**quick)).boards(shaded(render(board(0)), 0.12))
    assert not any(b.complete and len(b) == 54 for b in found)


def test_a_whole_board_and_a_picture_of_none_are_looked_at_once(monkeypatch):
    monkeypatch.setattr(views, "levelled", lambda _: pytest.fail("looked at again"))
    rcdn.Detector().boards(render(board(1)))
    noise = np.random.default_rng(1).normal(128, 20, SIZE[::-1]).clip(0, 255).astype(np.uint8)
    assert rcdn.Detector().boards(noise) == []
