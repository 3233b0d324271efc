"""Light, covers, optics, sensor, and what can still be told after them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from plain_scene import board, empty

from rcdn.synthetic import Cover, Light, Sensor, truth
from rcdn.synthetic.degrade import coverage, disk_kernel, expose, illuminate, legible, motion_kernel, signed_distance
from rcdn.synthetic.render import irradiance

FLAT = np.full((40, 60), 0.5, np.float32)
CLEAN = Sensor(blur=0, noise=0)


def exposed(image=FLAT, seed=0, **sensor):
    return expose(image, replace(CLEAN, **sensor), np.random.default_rng(seed)).astype(float)


def test_signed_distance_of_capsule_and_box():
    x, y = np.array([10.0, 5, 18, 18, 0]), np.array([0.0, 5, 0, 8, 0])
    assert signed_distance(Cover(0, 0, 10, 0, 3), x, y) == pytest.approx([-3, 2, 5, np.hypot(8, 8) - 3, -3])
    assert signed_distance(Cover(0, 0, 10, 0, 3, square=True), x, y) == pytest.approx([0, 2, 8, 8, 0])
    assert signed_distance(Cover(4, 4, 4, 4, 2), np.array([4.0]), np.array([7.0])) == pytest.approx([1])


def test_coverage_is_half_at_the_rim():
    soft = Cover(0, 0, 0, 0, 10, soft=4)
    assert coverage(soft, np.array([0.0, 8, 10, 12, 13]), np.zeros(5)) == pytest.approx([1, 1, 0.5, 0, 0])


def test_light():
    x, y = np.meshgrid(np.arange(60.0), np.arange(40.0))
    lit = illuminate(FLAT, Light(gx=1.0, gy=-0.5), x, y, (60, 40))
    assert lit[20, 30] == pytest.approx(0.5)  # the middle of the frame
    assert np.log(lit[0, 30] / lit[20, 30]) == pytest.approx(0.25, abs=1e-5)
    assert np.log(lit[20, 45] / lit[20, 30]) == pytest.approx(0.25, abs=1e-5)
    shade = illuminate(FLAT, Light(shadows=(Cover(10, 20, 10, 20, 5, 0.3),)), x, y, (60, 40))
    assert shade[20, 10] == pytest.approx(0.15)
    assert shade[20, 30] == pytest.approx(0.5)
    glare = illuminate(FLAT, Light(glares=((10.0, 20.0, 5.0, 0.4),)), x, y, (60, 40))
    assert glare[20, [10, 15]] == pytest.approx([0.9, 0.5 + 0.4 * np.exp(-0.5)])


@pytest.mark.parametrize("kernel", [disk_kernel(1.5), disk_kernel(6), motion_kernel(2, 0.3), motion_kernel(9, 2.0)])
def test_kernels_neither_shift_nor_brighten(kernel):
    reach = len(kernel) // 2
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    assert kernel.sum() == pytest.approx(1, abs=1e-5)
    assert [(kernel * x).sum(), (kernel * y).sum()] == pytest.approx([0, 0], abs=1e-5)
    assert kernel[0, 0] == 0


def test_motion_runs_along_its_angle():
    kernel = motion_kernel(9, np.pi / 4)
    y, x = np.mgrid[-6:7, -6:7]
    along, across = x + y, x - y
    assert (kernel * along**2).sum() > 20 * (kernel * across**2).sum()
    assert np.sqrt((kernel * along**2).sum() / 2 * 12) == pytest.approx(9.5, abs=0.7)  # a stroke's length, with its cap


def test_sensor_curve():
    """offset + gain · light, clipped, to the power of gamma, inverted."""
    assert (exposed() == 128).all()
    assert (exposed(gain=0.5, offset=0.1) == np.rint(0.35 * 255)).all()
    assert (exposed(gain=3.0) == 255).all()
    assert (exposed(gamma=2.0) == 64).all()
    assert (exposed(gamma=2.0, invert=True) == 191).all()
    ramp = np.tile(np.linspace(0, 1, 64, dtype=np.float32), (16, 1))
    assert np.array_equal(exposed(ramp) + exposed(ramp, invert=True), np.full((16, 64), 255.0))


def test_noise_has_its_size_and_seed():
    big = np.full((200, 200), 0.5, np.float32)
    assert exposed(big, noise=8.0).std() == pytest.approx(8, rel=0.03)
    assert exposed(big, noise=3.0, shot=4.0).std() == pytest.approx(np.hypot(3, 4 * np.sqrt(0.5)), rel=0.03)
    assert np.array_equal(exposed(big, noise=8.0), exposed(big, noise=8.0))
    assert not np.array_equal(exposed(big, noise=8.0), exposed(big, seed=1, noise=8.0))
    assert np.abs(exposed(big, noise=8.0, jpeg=50) - exposed(big, noise=8.0)).max() > 0
    assert exposed(big, noise=8.0, smooth=1.0).std() < 4 < 8 < exposed(big, noise=8.0, sharpen=1.0).std()


def test_blur_has_its_size():
    step = np.zeros((21, 81), np.float32)
    step[:, 41:] = 1
    for sensor, sigma in (
        ({"blur": 3.0}, 3.0),
        ({"disk": 6.0}, 3.0),
        ({"motion": 10.0}, 11 / np.sqrt(12)),
    ):
        slope = np.diff(exposed(step, **sensor)[10])
        x = np.arange(80)
        middle = (slope * x).sum() / slope.sum()
        assert middle == pytest.approx(40, abs=0.02)
        assert np.sqrt((slope * (x - middle) ** 2).sum() / slope.sum()) == pytest.approx(sigma, rel=0.06)


def test_legible_falls_with_noise_blur_and_contrast():
    scene = empty()
    scene = replace(scene, boards=(board(scene, (0.9, 0.3, 0.2), pitch=14.0),))
    light, known = irradiance(scene, samples=2), truth(scene)[0]

    def count(**sensor):
        return legible(light, replace(CLEAN, **sensor), known.xy, known.pitch)

    assert count().all()
    for setting, values in {
        "noise": (0, 40, 80, 120, 160, 200, 300),
        "shot": (0, 80, 160, 240, 400),
        "blur": (0.5, 2, 4, 6, 8),
        "disk": (0, 3, 6, 9),
        "motion": (0, 5, 10, 20),
        "gain": (1, 0.5, 0.2, 0.1, 0.03),
    }.items():
        readable = [count(**({"noise": 60, "blur": 1.0} | {setting: value})) for value in values]
        assert all((b <= a).all() for a, b in pairwise(readable)), setting
        assert readable[0].sum() > readable[-1].sum(), setting


@pytest.mark.parametrize(
    ("sensor", "blur"),
    [({}, 0.3), ({"blur": 1.0}, 1.3), ({"disk": 4.0}, 2.3), ({"motion": 3.0}, 1.2), ({"blur": 0.6, "disk": 1.6}, 1.3)],
)
@pytest.mark.parametrize(("pitch", "edge"), [(8.0, 8.0), (40.0, 15.0)])
def test_legible_to_the_bound(sensor, blur, pitch, edge):
    """σ·sqrt(√π·blur / L) / C = 0.6 px on a step of 102 grey levels."""
    step = np.full((40, 60), 0.3, np.float32)
    step[:, 30:] = 0.7
    limit = 0.6 * 102 / np.sqrt(np.sqrt(np.pi) * blur / edge)
    for noise, expected in ((limit * 0.97, True), (limit * 1.03, False)):
        for kind in ({"noise": noise}, {"shot": noise / 0.7}):
            readable = legible(step, replace(CLEAN, **sensor, **kind), np.array([[30.0, 20.0]]), np.array([pitch]))
            assert readable.tolist() == [expected]


def test_legible_needs_contrast_at_its_corner():
    assert not legible(FLAT, CLEAN, np.array([[30.0, 20.0]]), np.array([15.0])).any()
    low = FLAT.copy()
    low[:, 30:] += 5.4 / 255
    assert not legible(low, CLEAN, np.array([[30.0, 20.0]]), np.array([15.0])).any()  # 5 levels
    low[:, 30:] += 2 / 255
    assert legible(low, CLEAN, np.array([[30.0, 20.0], [-5.0, 90.0], [45.0, 20.0]]), np.full(3, 15.0)).tolist() == [
        True,
        False,
        False,
    ]
