"""The HTML report of a calibration: simulated calibrations whose answers are known."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from rcdn.calibration.facts import GRID, measure
from rcdn.calibration.residual_facts import mean_residuals
from rcdn.calibration.sight import cell_centres, cells_of, out_of_sight
from rcdn.calibration.stereo_verdict import baseline_std
from rcdn.calibration.verdict import headline, judge
from rcdn.errors import OutputError
from rcdn.geometry import project, rotation, transform, unproject
from rcdn.geometry.undistort import HALF_VIEW, undistorted_camera
from rcdn.report.calibration import maps, pictures, rectified, relative, write_report, write_stereo_report
from rcdn.report.calibration.environment import script, sheet
from rcdn.report.calibration.formats import number, percent, value_and_std
from rcdn.report.calibration.svg import escape, tag
from rcdn.terminal.camera_text import camera_lines
from rcdn.types import BoardShape, BoardView, Calibration, Camera, ModelScore, Pose, StereoCalibration

SIZE = (640, 480)
BROWN = Camera([[560, 0, 322], [0, 560, 238], [0, 0, 1]], [-0.25, 0.06, 0.0004, -0.0003, 0.0], SIZE, "brown")
FISHEYE = Camera([[230, 0, 320], [0, 230, 240], [0, 0, 1]], [-0.01, 0.002, 0, 0], SIZE, "fisheye")
FOLDED = Camera([[400, 0, 320], [0, 400, 240], [0, 0, 1]], [-0.9, 0.0, 0, 0], SIZE, "brown")
IJ = np.array([(i, j) for j in range(6) for i in range(9)])
SPACING = 0.025
VOID = {"img", "meta", "link", "br"}


def board_pose(rng, spot, distance=0.42):
    """A board whose middle is seen near the direction `spot` (x, y), tilted by up to 35°."""
    R = rotation(np.array([*rng.uniform(-0.6, 0.6, 2), rng.normal(0, 0.3)]))
    middle = np.array([4, 2.5, 0]) * SPACING
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.array([*spot, 1.0]) * distance - R @ middle
    return Pose(T)


def view_of(camera, pose, name, rng, noise=0.1, reason="", board=0):
    """What `camera` sees of the board under `pose`, with `noise` px; corners out of the frame are missing."""
    points = transform(pose, np.column_stack([IJ * SPACING, np.zeros(len(IJ))]))
    exact = project(camera, points)
    seen = ((exact > 0) & (exact < np.array(camera.image_size) - 1)).all(axis=1)
    residuals = rng.normal(0, noise, (int(seen.sum()), 2))
    many = int(seen.sum())
    used = np.zeros(many, bool) if reason else np.ones(many, bool)
    return BoardView(name, board, IJ[seen], exact[seen] + residuals, np.full(many, 0.1), pose, residuals, used, reason)


def simulated(camera=BROWN, many=30, seed=1, names=None, noise=0.1, reach=(0.5, 0.36), **fields):
    """A calibration from boards all over the frame, with a covariance of a well-settled camera."""
    rng = np.random.default_rng(seed)
    spots = rng.uniform(-1, 1, (many, 2)) * reach
    names = names or [f"view{k:03d}.png" for k in range(many)]
    views = tuple(view_of(camera, board_pose(rng, s), n, rng, noise) for s, n in zip(spots, names, strict=True))
    std = np.concatenate([[0.2, 0.2, 0.2, 0.2], np.full(len(camera.distortion), 2e-4), np.full(6, 1e-5)])
    made = Calibration(camera, SPACING, views, np.diag(std**2), 0.1, (), (9, 6), "unique")
    return replace(made, **({"models": (ModelScore(camera.model, made.rms, 1.05 * made.rms),)} | fields))


def photograph(size=SIZE, seed=0):
    """A picture that JPEG can't make small."""
    return np.random.default_rng(seed).integers(0, 256, size[::-1], dtype=np.uint8)


class Page(HTMLParser):
    """Tags, attributes and text of a page, its white space as a browser shows it; fails on elements that aren't closed
    in order."""

    def __init__(self, text):
        super().__init__()
        self.stack, self.tags, self.text, self.attributes = [], [], "", []
        self.feed(text)
        self.close()
        self.text = " ".join(self.text.split())
        assert self.stack == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        self.text += data

    def values(self, name):
        return [value for _, key, value in self.attributes if key == name]


def written(tmp_path, *arguments, **options):
    """The page that `write_report` wrote."""
    write_report(tmp_path / "report.html", *arguments, **options)
    return (tmp_path / "report.html").read_text()


def test_a_well_settled_camera_is_good(tmp_path):
    calibration = simulated()
    assert judge(calibration).level == "good"
    page = Page(written(tmp_path, calibration))
    assert "Use this camera." in page.text
    for figure in (f"{calibration.rms:.3f} px", "1.05 × the RMS", "brown", "9 × 6", "25.00 mm"):
        assert figure in page.text


def test_the_page_says_the_verdict_of_the_terminal(tmp_path):
    few = simulated(many=4)
    page = Page(written(tmp_path, few))
    assert judge(few).level == "unsure"
    assert headline(judge(few)).removeprefix("Unsure: ") in page.text
    stored = replace(few, verdict=judge(simulated()))
    assert "Use this camera." in Page(written(tmp_path, stored)).text


EVIL = (
    '<script>alert("x")</script>.png',
    "a\"b'c & <img src=x onerror=alert(1)>.png",
    "line\nbreak\ttab.png",
    "Grüße 東京 😀.png",
    "half\udcff.png",
    "turned\u202egnp.exe",
    "]]>--><!-- {{x}} ${y} %s {0}.png",
    "C:\\photos\\<b>one</b>.png",
)


def test_what_comes_from_files_stays_text(tmp_path):
    names = [EVIL[k % len(EVIL)] + str(k) for k in range(16)]
    calibration = simulated(many=16, names=names)
    views = list(calibration.views)
    views[3] = replace(views[3], reason='<i>bent</i> & "torn"\n', used=np.zeros(len(views[3]), bool))
    views[8] = replace(views[8], reason="</title></style></script><script>evil()</script>")
    calibration = replace(calibration, views=tuple(views), advice=("Use <b>less</b> light & 'more' \"time\".",))
    text = written(tmp_path, calibration, lambda name: photograph(), title="</title><script>alert(1)</script>\"'\u2028")
    page = Page(text)
    assert page.tags.count("script") == 1
    assert not {"i", "b", "iframe", "object", "form"} & set(page.tags)
    assert not [a for _, a, _ in page.attributes if a.startswith("on")]
    for name in (
        'alert("x")</script>.png0',
        "& <img src=x onerror=alert(1)>.png",
        "Grüße 東京 😀.png",
        "]]>--><!-- {{x}}",
    ):
        assert name in page.text
    for seen in (
        "line␊break␉tab",
        "half\\udcff",
        "turned\\u202egnp.exe",
        '<i>bent</i> & "torn"␊',
        "Use <b>less</b> light & 'more'",
    ):
        assert seen in page.text
    assert "\u202e" not in text
    assert script() in text


def test_elements_of_drawings_escape_all_but_markup():
    assert tag("text", "<", tag("tspan", "&"), id='"') == '<text id="&#34;">&lt;<tspan>&amp;</tspan></text>'
    assert escape("'\0") == "&#39;␀"


def test_numbers_are_short():
    assert number(-0.01234) == "−0.0123"
    assert (number(float("nan")), number(0), number(1234567), number(2e-5)) == ("–", "0.00", "1.23e+06", "2.00e−05")
    assert (percent(0.711), percent(0.0049), percent(float("nan"))) == ("71 %", "0.49 %", "– %")
    assert value_and_std(535.41592, 0.8333) == ("535.42", "0.83")
    assert value_and_std(-0.000123456, 0.0000101) == ("−0.000123", "0.000010")
    assert value_and_std(3.0, float("nan")) == ("3", "–")


def test_the_page_needs_nothing_but_itself(tmp_path):
    page = Page(written(tmp_path, simulated(), lambda name: photograph()))
    assert all(s.startswith("data:image/jpeg;base64,") for s in page.values("src"))
    links = page.values("href")
    assert all(link.startswith("#") or link == "data:," for link in links)
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    assert {link[1:] for link in links if link.startswith("#")} <= set(ids)
    text = (tmp_path / "report.html").read_text()
    assert "url(" not in text
    assert "@import" not in text
    assert not re.search(r"(https?:)?//\w", re.sub(r"base64,[^\"]*", "", text))
    assert ("html", "lang", "en") in page.attributes
    assert all(page.values("alt"))
    assert page.tags.count("table") == page.tags.count("caption")
    assert page.tags.count("h1") == 1


def test_same_input_same_bytes_but_for_the_date(tmp_path, monkeypatch):
    from rcdn.report.calibration import page

    calibration = simulated(many=8)
    for folder, date in (("a", "2026-01-01T10:00:00+00:00"), ("b", "2027-02-02T11:11:11+00:00")):
        monkeypatch.setattr(page, "provenance", lambda date=date: {"rcdn": "1", "commit": "unknown", "date": date})
        write_report(tmp_path / folder / "r.html", calibration, lambda name: photograph())
    a, b = ((tmp_path / f / "r.html").read_text() for f in "ab")
    assert a != b
    assert a.replace("2026-01-01 10:00", "") == b.replace("2027-02-02 11:11", "")


def test_written_whole_or_not_at_all(tmp_path):
    def broken(name):
        raise RuntimeError("the disk was pulled out")

    file = tmp_path / "report.html"
    file.write_text("old")
    with pytest.raises(RuntimeError):
        write_report(file, simulated(many=5), broken)
    assert file.read_text() == "old"
    with pytest.raises(OutputError):
        write_report(tmp_path, simulated(many=5))
    assert list(tmp_path.iterdir()) == [file]


def test_a_hundred_noisy_pictures_stay_below_six_megabytes(tmp_path):
    noise = photograph()
    text = written(tmp_path, simulated(many=100), lambda name: noise)
    assert 3_000_000 < len(text.encode()) <= 6_000_000
    assert Page(text).tags.count("img") == 102  # all of them, and the sample before and after


def test_what_is_left_away_is_told(tmp_path):
    calibration = simulated(many=pictures.MOST_PICTURES + 40)
    views = list(calibration.views)
    views[77] = replace(views[77], reason="blurred", used=np.zeros(len(views[77]), bool))
    calibration = replace(calibration, views=tuple(views))
    blank = np.full(SIZE[::-1], 128, np.uint8)
    page = Page(written(tmp_path, calibration, lambda name: None if name == "view077.png" else blank))
    assert f"{pictures.MOST_PICTURES} of {pictures.MOST_PICTURES + 40} pictures are shown" in page.text
    assert "1 photograph couldn’t be shown" in page.text
    assert "view-78" in page.values("id")


def test_links_lead_somewhere_though_pictures_are_left_away(tmp_path):
    page = Page(written(tmp_path, simulated(many=pictures.MOST_PICTURES + 40)))
    assert {h[1:] for h in page.values("href") if h.startswith("#")} <= set(page.values("id"))


def test_thumbnails_shrink_to_the_budget():
    shots = pictures.shots(simulated(many=20))
    noise = photograph()
    for budget in (2_000_000, 200_000, 30_000, 0):
        done = pictures.with_jpegs(shots, lambda name: noise, budget)
        assert sum(4 * len(s.jpeg) / 3 for s in done if s.jpeg) <= budget
        if budget >= 200_000:
            assert all(s.jpeg for s in done)


def test_without_photographs_the_drawings_stand_alone(tmp_path):
    page = Page(written(tmp_path, simulated()))
    assert "img" not in page.tags
    assert page.tags.count("figure") == 10 + 30
    assert "Drawn without the photographs." in page.text


def test_pictures_with_several_boards_and_views_without_a_pose(tmp_path):
    calibration = simulated(many=12, names=[f"view{k // 2}.png" for k in range(12)])
    views = [replace(v, board=k % 2) for k, v in enumerate(calibration.views)]
    lost = views[4]
    views[4] = replace(
        lost,
        pose=None,
        residuals=np.full((len(lost), 2), np.nan),
        used=np.zeros(len(lost), bool),
        reason="no pose was found",
    )
    used = np.ones(len(views[5]), bool)
    used[:3] = False
    views[5] = replace(views[5], used=used)
    page = Page(written(tmp_path, replace(calibration, views=tuple(views)), lambda name: photograph()))
    assert page.tags.count("img") == 6 + 2
    assert "no pose was found" in page.text
    assert "11 boards, in 6 pictures" in page.text
    assert "outlier, not used" in page.text
    for k in range(1, 13):
        assert f"view-{k}" in page.values("id")


def test_nothing_used_still_makes_a_page(tmp_path):
    calibration = simulated(many=4)
    views = tuple(replace(v, reason="disagrees", used=np.zeros(len(v), bool)) for v in calibration.views)
    page = Page(written(tmp_path, replace(calibration, views=views)))
    assert "Don't use this camera." in page.text


@pytest.mark.parametrize(
    "camera",
    [
        Camera(BROWN.K, [], SIZE, "pinhole"),
        Camera(BROWN.K, [*BROWN.distortion, 0.0, 0.0, 0.0], SIZE, "rational"),
        FISHEYE,
        Camera([[900, 0, 240], [0, 900, 420], [0, 0, 1]], [-0.1, 0.02, 0, 0], (480, 848), "brown"),
    ],
    ids=["pinhole", "rational", "fisheye", "portrait"],
)
def test_every_camera_has_its_page(tmp_path, camera):
    offsets = np.zeros((6, 9, 3))
    offsets[::2, ::3, 0], offsets[3, 4, 2] = 0.0004, 0.0002
    shape = BoardShape(offsets)
    calibration = simulated(camera, 12, shape=shape)
    page = Page(written(tmp_path, calibration, lambda name: photograph(camera.image_size)))
    assert "corners off their places in the plane (RMS)" in page.text
    assert shape.print_error > 1e-4
    assert f"{number(1000 * shape.print_error, 2)} mm" in page.text
    assert "0.20 mm" in page.text
    for name in camera.parameter_names:
        assert name in page.text


def test_perfect_corners_make_a_page(tmp_path):
    perfect = simulated(noise=0.0, models=(ModelScore("brown", 0.0, 0.0),))
    assert "Use this camera." in Page(written(tmp_path, perfect)).text


@pytest.mark.parametrize(("rms", "held_out"), [(0.0039, 0.0042), (0.0, 0.0), (0.004, 0.002)])
def test_errors_too_small_to_compare_count_as_alike(rms, held_out):
    made = simulated(noise=0.0, models=(ModelScore("brown", rms, held_out), ModelScore("rational", held_out, np.nan)))
    assert measure(made).held_ratio == 1
    text = "\n".join(camera_lines(made))
    assert "in pictures held out 1.00 times that" in text
    assert "brown 1.00 (held out 1.00), rational 1.00" in text


def test_a_principal_point_that_was_held_has_no_deviation(tmp_path):
    made = simulated()
    cov = made.cov.copy()
    cov[2:4] = cov[:, 2:4] = 0
    cov[[2, 3], [2, 3]] = 1e-10  # what the prior that holds it leaves
    held = replace(made, cov=cov)
    lines = camera_lines(held)
    assert {"  cx  322.0 (held)", "  cy  238.0 (held)"} <= set(lines)
    assert not any("held)" in line for line in camera_lines(made))
    assert written(tmp_path, held).count('<td class="n">held</td>') == 2


def test_coverage_counts_cells():
    calibration = simulated(many=3, reach=(0, 0))
    xy = np.array([[1, 1], [638, 1], [1, 478], [638, 478], [320, 240], [322, 241]], float)
    view = BoardView("a", 0, IJ[:6], xy, np.full(6, 0.1), calibration.views[0].pose, np.zeros((6, 2)), np.ones(6, bool))
    facts = measure(replace(calibration, views=(view,)))
    assert facts.coverage.shape == (6, 8)
    assert facts.coverage.sum() == 6
    assert facts.covered == 5 / 48


def test_field_of_view_of_a_pinhole_camera():
    facts = measure(simulated(Camera([[320, 0, 319.5], [0, 240, 239.5], [0, 0, 1]], [], SIZE, "pinhole"), 5))
    assert facts.fov[:2] == pytest.approx((90, 90), abs=1e-9)


def test_a_fisheye_isnt_blamed_for_the_dark_around_its_circle_but_a_folded_lens_is():
    circle = Camera([[130, 0, 320], [0, 130, 240], [0, 0, 1]], [0, 0, 0, 0], SIZE, "fisheye")  # 90° at 204 px
    facts = measure(simulated(circle, 8))
    assert facts.reach == 1
    radius = np.hypot(*np.meshgrid(np.arange(8) - 3.5, np.arange(6) - 2.5)) * 80
    assert facts.in_view[radius < 204 - 57].all()  # half a cell's diagonal
    assert not facts.in_view[radius > 204 + 57].any()
    beyond, _ = out_of_sight(circle, cell_centres(SIZE, cells_of(SIZE, GRID)))
    assert beyond.mean() == pytest.approx(1 - np.pi * (130 * np.pi / 2) ** 2 / (640 * 480), abs=0.01)
    folded = measure(simulated(FOLDED, 8, reach=(0.1, 0.1)))
    # r·(1 − 0.9 r²) turns back at r = 1/√2.7; what it reaches is a disc of 2/3 of that
    disc = np.pi * (400 * 2 / 3 / np.sqrt(2.7)) ** 2 / (640 * 480)
    assert folded.reach == pytest.approx(disc, abs=0.01)
    assert folded.in_view.all()
    assert folded.at_corners == np.inf
    assert np.isnan(folded.fov[0])


def test_mean_residuals_find_what_is_systematic():
    calibration = simulated(many=60, noise=0.1)
    assert "Nothing stands out" in maps.mean_map(calibration, mean_residuals(calibration)).caption
    pushed = []
    for v in calibration.views:
        shift = np.where(v.xy[:, :1] > 427, [[0.3, 0.0]], [[0.0, 0.0]])
        pushed.append(replace(v, residuals=v.residuals + shift))
    off = replace(calibration, views=tuple(pushed))
    cells = mean_residuals(off)
    right = cells.where[:, 0] > 427 + 27  # cells that lie wholly there
    assert right.sum() >= 6
    assert np.abs(cells.mean[right] - [0.3, 0]).max() < 4 * cells.error[right].max()
    assert cells.systematic[right].all()
    assert "stand out from chance" in maps.mean_map(off, cells).caption


def test_bands_are_round_and_few():
    levels = maps.band_levels(np.geomspace(0.013, 700, 100))
    assert levels.tolist() == pytest.approx([0.02, 0.05, 0.1, 0.2, 0.5, 1.0])
    assert maps.band_levels(np.linspace(0.014, 0.048, 9)).tolist() == pytest.approx([0.015, 0.02, 0.03, 0.04])
    assert len(maps.band_levels(np.full(4, 0.3))) == 1
    assert len(maps.band_levels(np.full(4, np.nan))) == 1


@pytest.mark.parametrize("camera", [BROWN, FISHEYE], ids=["brown", "fisheye"])
def test_undistorting_makes_a_ramp_of_rays_a_ramp_of_pixels(camera):
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1)
    rays = unproject(camera, pixels)
    slope = rays[..., 0] / np.maximum(rays[..., 2], 0.2)
    picture = (128 + 40 * slope).clip(0, 255).astype(np.float32)
    flat = undistorted_camera(camera)
    after = pictures.undistort(picture, camera, flat)
    truth = 128 + 40 * unproject(flat, pixels)[..., 0]
    inside = np.zeros(truth.shape, bool)
    inside[20:-20, 20:-20] = True
    assert np.abs(after - truth)[inside].max() < 0.5
    assert np.degrees(np.arctan(320 / flat.K[0, 0])) <= HALF_VIEW + 1e-9


@pytest.mark.parametrize("centre", [(-200, 240), (900, 240), (320, -150)])
def test_a_sensor_beside_its_axis_is_shown_whole(centre):
    """A cropped sensor: the principal point lies outside of the picture."""
    camera = Camera([[800, 0, centre[0]], [0, 800, centre[1]], [0, 0, 1]], [], SIZE, "pinhole")
    flat = undistorted_camera(camera)
    np.testing.assert_allclose(flat.K, camera.K, rtol=1e-9, atol=1e-6)


def test_undistorting_turns_as_rectification_does():
    """A small bright spot lands where `rectified.rectify` says."""
    R = rotation(np.array([0.03, -0.05, 0.02]))
    flat = Camera([[500, 0, 320], [0, 500, 240], [0, 0, 1]], [], SIZE, "pinhole")
    for spot in ([150.0, 120.0], [480.0, 300.0]):
        x, y = np.meshgrid(np.arange(640) - spot[0], np.arange(480) - spot[1])
        picture = (250 * np.exp(-(x**2 + y**2) / 32)).astype(np.float32)
        after = pictures.undistort(picture, BROWN, flat, R)
        after = np.maximum(after - 100, 0)  # less the grey of what the lens didn't see
        found = np.array([(after * g).sum() for g in np.meshgrid(np.arange(640), np.arange(480))]) / after.sum()
        expected = rectified.rectify(BROWN, R, np.column_stack([flat.K, np.zeros(3)]), np.array([spot]))[0]
        assert found == pytest.approx(expected, abs=0.05)


def test_a_resized_camera_keeps_pixel_centres():
    rays = unproject(BROWN, np.array([[10.0, 20], [600, 400]]))
    small = project(BROWN.resized((320, 240)), rays)
    assert small == pytest.approx((np.array([[10.0, 20], [600, 400]]) + 0.5) / 2 - 0.5)


def test_the_sample_shows_bent_lines_straight():
    found = pictures.sample(simulated(noise=0.02), lambda name: photograph())
    assert found is not None
    assert found.bow[0] > 2
    assert found.bow[1] < 0.15
    assert pictures.sample(simulated(), lambda name: photograph((100, 100))) is None
    assert pictures.sample(simulated(), lambda name: None) is None


def contrast(a, b):
    """WCAG's contrast of two colours #rrggbb or #rgb."""

    def light(colour):
        digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
        v = np.array([int(digits[k : k + 2], 16) for k in (0, 2, 4)]) / 255
        v = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
        return float(v @ [0.2126, 0.7152, 0.0722]) + 0.05

    low, high = sorted((light(a), light(b)))
    return high / low


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_words_can_be_read(theme):
    colours = dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{3,6})", re.findall(r":root \{(.*?)\}", sheet(), re.S)[theme]))
    for ground in ("paper", "card"):
        for ink in ("ink", "soft", "accent", "good", "fair", "unsure", "bad"):
            assert contrast(colours[ink], colours[ground]) >= 4.5, (ink, ground)
    for tone in ("good", "fair", "unsure", "bad"):
        assert contrast(colours[tone], colours[f"{tone}-bg"]) >= 4.5
        assert contrast(colours["ink"], colours[f"{tone}-bg"]) >= 7


def simulated_pair(noise=0.0, many=14):
    """Two cameras 0.1 m apart that see the same boards; T_right_left known."""
    rng = np.random.default_rng(5)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.array([0.01, -0.03, 0.005])), [-0.1, 0.002, 0.001]
    second = Camera([[570, 0, 318], [0, 570, 243], [0, 0, 1]], [-0.2, 0.04, 0, 0, 0], SIZE, "brown")
    poses = [board_pose(rng, s, 0.6) for s in rng.uniform(-0.2, 0.2, (many, 2))]
    left = tuple(view_of(BROWN, p, f"left<{k}>.png", rng, noise) for k, p in enumerate(poses))
    right = tuple(view_of(second, Pose(T @ p.T_cam_board), f"right{k}.png", rng, noise) for k, p in enumerate(poses))
    R1, R2, P1, P2, Q = cv2.stereoRectify(
        BROWN.K,
        BROWN.distortion,
        second.K,
        second.distortion,
        SIZE,
        T[:3, :3].copy(),
        T[:3, 3:].copy(),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0,
    )[:5]
    a = replace(simulated(BROWN, 5), views=left)
    b = replace(simulated(second, 5), views=right)
    cov = np.diag([5e-4, 5e-4, 5e-4, 1e-4, 2e-4, 3e-4]) ** 2
    return StereoCalibration(a, b, T, cov, 0.15, 0.1, R1, R2, P1, P2, Q, ("Left: more <pairs>.",))


def test_only_pairs_are_compared_of_cameras_with_other_views_too(tmp_path):
    whole = simulated_pair(noise=0.1)
    left, right = whole.left.views, whole.right.views
    found = replace(
        whole,
        left=replace(whole.left, views=(*left[:10], *left[12:])),
        right=replace(whole.right, views=right[:11]),
        pairs=10,
    )
    assert found.view_pairs == list(zip(left[:10], right[:10], strict=True))
    assert rectified.row_gaps(found) == pytest.approx(rectified.row_gaps(whole)[:10])
    write_stereo_report(tmp_path / "pair.html", found)
    assert "from 10 pairs of boards" in " ".join((tmp_path / "pair.html").read_text().split())
    assert replace(found, pairs=None).view_pairs[10] == (left[12], right[10])  # of files without their number


def test_matching_corners_lie_on_one_row_after_rectification():
    pair = simulated_pair()
    assert rectified.row_gaps(pair) == pytest.approx(np.zeros(14), abs=1e-6)
    views = list(pair.left.views)
    xy, used = np.array(views[0].xy), np.array(views[0].used)
    xy[4], used[4] = xy[4] + 5, False
    views[0] = replace(views[0], xy=xy, used=used)
    odd = replace(pair, left=replace(pair.left, views=tuple(views)))
    assert rectified.row_gaps(odd)[0] == pytest.approx(0, abs=1e-6)  # an outlier has no partner
    noisy = rectified.row_gaps(simulated_pair(noise=0.1))
    assert np.sqrt((noisy**2).mean()) == pytest.approx(0.1 * np.sqrt(2), rel=0.15)


def test_the_baseline_and_its_standard_deviation():
    pair = simulated_pair()
    assert pair.baseline == pytest.approx(np.linalg.norm([0.1, 0.002, 0.001]))
    assert baseline_std(pair) == pytest.approx(1e-4, rel=0.01)  # nearly along x
    assert relative.turn_angle(pair) == pytest.approx(np.degrees(np.linalg.norm([0.01, -0.03, 0.005])))


def test_the_page_of_a_pair(tmp_path):
    pair = simulated_pair(noise=0.1)
    views = list(pair.right.views)
    views[2] = replace(views[2], reason="the cameras weren't triggered together", used=np.zeros(len(views[2]), bool))
    pair = replace(pair, right=replace(pair.right, views=tuple(views)))
    noise = photograph()
    write_stereo_report(tmp_path / "pair.html", pair, lambda name: noise, lambda name: noise)
    text = (tmp_path / "pair.html").read_text()
    page = Page(text)
    assert len(text.encode()) <= 6_000_000
    assert page.tags.count("img") == 28 + 2
    assert "100.02" in page.text  # mm
    assert "13of 14" in page.text.replace(" ", "").replace("of14", "of 14")
    assert "Left: more <pairs>." in page.text
    assert "left<3>.png" in page.text
    assert "weren't triggered together" in page.text
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    assert {h[1:] for h in page.values("href") if h.startswith("#")} <= set(ids)
    write_stereo_report(tmp_path / "bare.html", pair)
    assert "img" not in Page((tmp_path / "bare.html").read_text()).tags
