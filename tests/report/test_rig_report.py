"""The page of a rig: what is drawn is where cameras and boards are, and the tables say what the calibration says."""

import re
from dataclasses import replace

import numpy as np
import pytest
from test_calibration_report import Page, photograph, simulated
from test_space import polygons

from rcdn.geometry import rotation
from rcdn.report.calibration import page, rig_space, space, write_rig_report
from rcdn.report.calibration import rig as rig_page
from rcdn.types import NOT_JUDGED, MissingLink, Pose, Rig, RigCalibration, RigPair, TimeShift


def found(covariance=1e-6, cameras=3):
    """A rig of cameras side by side that each saw its own boards."""
    names = tuple(f"c<{k}>" for k in range(cameras))
    each = [simulated(many=6, seed=k) for k in range(cameras)]
    poses = []
    for k in range(cameras):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = rotation(np.array([0, 0.1 * k, 0])), (-0.2 * k, 0, 0.01 * k)
        poses.append(Pose(T))
    scale = np.repeat(np.arange(cameras, dtype=float), 6)
    rig = Rig(names, tuple(c.camera for c in each), tuple(poses), covariance * np.diag(scale**2))
    pairs = (RigPair(names[0], names[1], 5, 4, 0.2, 0.15), RigPair(names[1], names[2], 3, 3, 0.9, 0.1))
    views = {name: replace(c, verdict=NOT_JUDGED) for name, c in zip(names, each, strict=True)}
    boards = {(str(k), 0): v.pose.T_cam_board for k, v in enumerate(each[0].views)}
    return RigCalibration(
        rig, views, boards, 0.3, pairs, (names,), given=(names[0],), shifts={names[1]: TimeShift(0.01, 0.02)}
    )


def test_cameras_boards_and_ellipsoids_are_drawn_where_they_are():
    rig = found()
    art = rig_space.rig_in_space(rig, "c<2>").art
    assert len(polygons(art, "board faint")) == 18
    rims = [p for _, p in polygons(art, "ray") + polygons(art, "ray weak") if len(p) == 4 * space.RIM]
    assert len(rims) == 3
    edges = [p for _, p in polygons(art, "ray") + polygons(art, "ray weak") if len(p) == 2]
    apexes = np.unique(np.round([p[0] for p in edges], 3), axis=0)
    assert apexes == pytest.approx(np.unique(np.round([rig.rig.centre(n) for n in rig.rig.names], 3), axis=0), abs=2e-3)
    assert art.count(">c&lt;2&gt;</text>") == 1


def test_ellipsoids_are_three_deviations_by_the_factor_that_is_told():
    rig = found()
    drawing = rig_space.rig_in_space(rig)
    (factor,) = re.findall(r"drawn (\d+) times larger", drawing.caption)
    rings = [p for _, p in polygons(drawing.art, "unsure")]
    assert len(rings) == 6  # three of each camera but the first
    for name, mine in zip(rig.rig.names[1:], (rings[:3], rings[3:]), strict=True):
        points = np.concatenate(mine)
        away = np.linalg.norm(points - rig.rig.centre(name), axis=1) / float(factor)
        deviation = np.sqrt(np.linalg.eigvalsh(rig.rig.centre_covariance(name)))
        assert away == pytest.approx(3 * deviation[0], rel=0.02)  # all deviations of one camera are equal here


def test_a_rig_known_badly_is_drawn_true_to_scale_and_one_without_covariance_has_no_ellipsoids():
    assert "true to scale" in rig_space.rig_in_space(found(covariance=1e-2)).caption
    rig = found()
    bare = replace(rig, rig=replace(rig.rig, covariance=None))
    assert "unsure" not in rig_space.rig_in_space(bare).art


def test_the_page_says_which_is_weakest_and_what_to_film(tmp_path):
    path = tmp_path / "rig.html"
    write_rig_report(path, found())
    text = path.read_text("utf-8")
    Page(text)
    assert "c&lt;2&gt; <span" in text
    assert "the board before c&lt;2&gt; and c&lt;1&gt;" in text
    assert text.index("c&lt;0&gt; – c&lt;1&gt;") < text.index(
        "c&lt;1&gt; – c&lt;2&gt;"
    )  # the larger epipolar distance first
    assert '<span class="tag out">high</span>' in text
    assert "<c" not in text.replace("<caption", "").replace("<code", "").replace("<circle", "")


def test_cameras_that_arent_connected_are_named(tmp_path):
    rig = found()
    more = {**rig.cameras, "far": rig.cameras["c<0>"]}
    apart = replace(
        rig, cameras=more, components=(rig.rig.names, ("far",)), links=(MissingLink("c<0>", "far", "a", "b", False),)
    )
    write_rig_report(tmp_path / "rig.html", apart)
    assert "far: no board connects them" in (tmp_path / "rig.html").read_text("utf-8")


@pytest.mark.parametrize(("module", "limit"), [(rig_page, "OVERLAYS"), (page, "LARGEST")])
def test_drawings_that_are_too_large_are_left_away_with_a_note(monkeypatch, module, limit):
    photographs = {name: lambda _: photograph() for name in found().cameras}
    assert 'id="view-' in rig_page.report(found(), photographs)
    monkeypatch.setattr(module, limit, 1000)
    text = rig_page.report(found(), photographs)
    assert "There are too many pictures to draw each" in text
    assert 'id="view-' not in text
    assert "data:image" not in text
