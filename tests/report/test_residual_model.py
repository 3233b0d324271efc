"""Residuals beside their model, and pictures that open large."""

from dataclasses import replace

import numpy as np
import pytest
from test_calibration_report import BROWN, FISHEYE, Page, photograph, simulated, written

from rcdn.report.calibration import charts, histogram
from rcdn.report.calibration.environment import script, sheet


def with_residuals(calibration, draw):
    """The calibration with residuals that `draw(shape)` gives, in px; its noise and sigmas are 0.1 px each."""
    views = tuple(replace(v, residuals=draw(v.residuals.shape)) for v in calibration.views)
    return replace(calibration, views=views)


def test_residuals_are_divided_by_what_is_stated_of_them():
    calibration = simulated(many=4)
    values = histogram.whitened(calibration)
    residuals = np.concatenate([v.residuals for v in calibration.views])
    assert values == pytest.approx((residuals / np.hypot(0.1, 0.1)).ravel())


@pytest.mark.parametrize(
    ("draw", "caption"),
    [
        (lambda r, s: r.normal(0, 0.1414, s), "err as the model says"),
        (lambda r, s: 0.1 * r.standard_t(2, s), "The tails are heavy"),
        (lambda r, s: 0.14 * r.uniform(-0.9, 0.9, s), "The middle is narrow"),
    ],
)
def test_how_residuals_differ_from_their_model_is_said(draw, caption):
    rng = np.random.default_rng(3)
    calibration = with_residuals(simulated(), lambda shape: draw(rng, shape))
    drawing = histogram.histogram(calibration)
    assert caption in drawing.caption
    assert "deviations (0.27 % expected)" in drawing.caption
    assert "<svg" in drawing.art


def test_no_residuals_make_a_histogram_still():
    calibration = simulated(many=3)
    views = tuple(replace(v, reason="bent", used=np.zeros(len(v), bool)) for v in calibration.views)
    assert "no residuals" in histogram.histogram(replace(calibration, views=views)).caption


@pytest.mark.parametrize("camera", [BROWN, FISHEYE])
def test_a_radial_error_shows_against_the_angle(camera):
    """Residuals that point outwards by 0.3 px everywhere: so says the running mean."""
    calibration = simulated(camera, noise=0.0)
    views = []
    for v in calibration.views:
        away = v.xy - camera.K[:2, 2]
        views.append(replace(v, residuals=0.3 * away / np.linalg.norm(away, axis=1, keepdims=True)))
    drawing = charts.angle_chart(replace(calibration, views=tuple(views)))
    assert "The running mean stays within ±0.30 px" in drawing.caption


def test_every_picture_opens_large_with_and_without_script(tmp_path):
    text = written(tmp_path, simulated(many=5), lambda name: photograph())
    page = Page(text)
    links = [value for value in page.values("href") if value.startswith("#shot-")]
    assert len(links) == 5
    assert {link[1:] for link in links} <= set(page.values("id"))
    assert [v for v in page.values("aria-label") if v == "Enlarge view000.png"]
    assert "To solve without it: --leave-out view003.png" in page.text
    assert ".shot:target" in sheet()
    assert script() in text
    assert text.count("data:image/jpeg") == 5 + 2  # no picture is in it twice
