"""Where a lens model has rays: not where it folds, and not beyond a pole."""

import numpy as np
import pytest

from rcdn.calibration.choose import LOST
from rcdn.calibration.sight import out_of_sight, reach
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS


def camera(focal, *distortion, model):
    return Camera(np.array([[focal, 0, 320.0], [0, focal, 240.0], [0, 0, 1.0]]), distortion, (640, 480), model)


@pytest.mark.parametrize("lens", CAMERAS.values(), ids=CAMERAS)
def test_ordinary_lenses_have_rays_everywhere(lens):
    assert reach(lens) == 1


@pytest.mark.parametrize("k1", [-0.2, 0.1, 0.33])
def test_barrels_and_pincushions_have_rays_everywhere(k1):
    assert reach(camera(450, k1, 0, 0, 0, model="brown")) == 1


@pytest.mark.parametrize("focal", [140, 200, 300])
def test_wide_fisheyes_have_rays_everywhere(focal):
    assert reach(camera(focal, 0, 0, 0, 0, model="fisheye")) == 1


@pytest.mark.parametrize("radius", [0.6, 0.75])
def test_pixels_beyond_a_pole_have_no_ray_of_their_own(radius):
    """r (1 − r² / (a R)²) / (1 − r² / R²): numerator and denominator nearly cancel but at the pole R, where the map
    grows beyond all bounds."""
    pole = camera(400, -1 / (1.002 * radius) ** 2, 0, 0, 0, 0, -1 / radius**2, 0, 0, model="rational")
    y, x = np.mgrid[8:480:16, 8:640:16].astype(float)
    pixels = np.stack([x, y], axis=-1)
    beyond = np.hypot(x - 320, y - 240) / 400 > 1.1 * radius
    lost = out_of_sight(pole, pixels)[1]
    assert lost[beyond].mean() > 0.95
    assert not lost[np.hypot(x - 320, y - 240) / 400 < 0.9 * radius].any()
    assert reach(pole) < 1 - LOST
